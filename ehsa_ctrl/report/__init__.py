"""Figures and pages of results; nothing here runs a simulation.

`figures` draws results. They register by type, so that `result.plot()` works without an import from below.
`kinds` turns the JSON of each kind of result into a `page.Page`: sentences of the verdict, then sections of text,
facts, tables and figures. `results` renders pages from a folder, one alone or all in an overview; `write` does the same
for a result in Python, which it stores in a temporary folder first. `result_figures` lists the figures of each page.
"""
