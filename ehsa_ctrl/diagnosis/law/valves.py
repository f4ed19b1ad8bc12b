"""Valves of a chamber that open at a pressure: a log shows them by that pressure, and hardly by their flow.

Such a valve is open for some samples at a time, and keeps the pressure near the one at which it opens, so that its flow
looks like noise over the measured pressure. What it has let pass moves the pressure level for good, and that a free run
shows.
"""

from __future__ import annotations

import numpy as np

from ...core.expression import put
from ..regimes import Windows
from .grammar import Grammar, Term
from .law_fit import LawFit

# The numbers below are engineering judgement.

#: Shares of the samples beyond the pressure at which a valve opens.
BEYOND = (0.001, 0.005, 0.02, 0.08)
#: Terms of a pressure z, with the sign of their flow into the chamber: to the tank, and from it.
TERMS = {"max(z - at, 0)": -1.0, "max(at - z, 0)": 1.0}
#: Unknown inputs that such valves change: of one chamber, and of both alike.
OF_CHAMBERS = ("flow_1", "flow_2", "flows")


def valve_laws(grammar: Grammar, windows: Windows, fitted: np.ndarray) -> list[LawFit]:
    """Valves at the ends of the measured pressure, each alone; their factors are where a refit may start.

    windows: of the unknown input. fitted: samples that may be used, along the logs.
    """
    if grammar.name not in OF_CHAMBERS:
        return []
    found = []
    # The difference of the pressures, another variable, is no name in the equations.
    for variable in (v for v in grammar.variables if v.unit == "Pa" and v.text in grammar.known):
        for text, sign in TERMS.items():
            above = -sign * variable.values[fitted]
            most = float(np.max(above))
            for share in BEYOND:
                opens = float(np.quantile(above, 1.0 - share))
                if most > opens:
                    # At the highest pressure it passes the largest of the unknown flows.
                    factor = float(np.max(np.abs(windows.values))) / (most - opens)
                    term = Term(
                        put(text, z=variable.text), frozenset({variable.text}), {"at": -sign * opens}, {"at": "Pa"}
                    )
                    found.append(LawFit(grammar, (term,), (sign * factor,), (0.0,), 0.0))
    return found
