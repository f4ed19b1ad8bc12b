"""The law behind an unknown input: where no effect of the catalogue fits, an expression for what the rig does.

grammar.py has the variables and the terms, regression.py selects sums of terms by cross-validation, free_run.py refits
the best of them as effects in free run and judges them on held-out data, find.py joins the stages.
"""
