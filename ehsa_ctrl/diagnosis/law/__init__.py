"""The law behind an unknown input: where no effect of the catalogue fits, an expression for what the rig does.

grammar.py has the variables and the terms. law_fit.py has a sum of terms with its factors, sum_problem.py what sums
explain by cross-validation, shapes.py fits the shapes of their terms, regression.py selects the best sums, promising.py
those worth a refit, which free_run.py refits as effects. judgement.py compares a law with none, tried.py laws with each
other. beside.py changes what acts beside the best law, fewer_terms.py leaves out terms that it does not need. find.py
joins the stages, found.py has the result. confirm.py checks a law on other logs.
"""
