"""Figures and pages of results; nothing here runs a simulation.

`figures` draws results. The functions register by result type, so that `result.plot()` needs no import of this package.
`kinds` turns the JSON of each kind of result into a `page.Page`: sentences of the verdict, then sections with text,
facts, tables and figures. `results` renders the page of one result folder or an overview of several; `write` renders a
Python result, which it first stores in a temporary folder. `result_figures` lists the figures of each page.
"""
