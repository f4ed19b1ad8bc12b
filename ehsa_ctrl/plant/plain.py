"""Evaluate the equations in plain Python, by calling the physics functions one after the other.

This is the slow reference for tests of the compiled engine, and for stepping through with a debugger.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from .wiring import Equations


def text(equations: Equations) -> str:
    """The wired equations as readable Python, one call per line."""
    lines = []
    for call in equations.calls:
        module = call.function.__module__.rsplit(".", 1)[-1]
        arguments = ", ".join(call.arguments.values())
        lines.append(f"{call.target} = {module}.{call.function.__name__}({arguments})")
    return "\n".join(lines)


def evaluator(equations: Equations, parameters: Mapping[str, float]) -> Callable[..., dict[str, Any]]:
    """A function of states, inputs and directions (by keyword) that returns every signal by name.

    >>> from ehsa_ctrl.plant.structure import Structure
    >>> frictionless = Structure("none", "none").equations
    >>> p = dict.fromkeys(frictionless.parameter_names, 1.0)
    >>> signals = evaluator(frictionless, p)
    >>> signals(omega=0, P_1=3, P_2=1, v=0, x=0, current=5, F_D=0, d_M=0, d_R=0)["omega_dot"]
    3.0
    """
    constants = dict(parameters)
    calls = [(call.target, call.function, tuple(call.arguments.items())) for call in equations.calls]
    finals = tuple((signal, name) for signal, name in equations.signals.items() if signal != name)

    def signals(**values: float) -> dict[str, Any]:
        known: dict[str, Any] = {**constants, **values}
        for target, function, arguments in calls:
            known[target] = function(**{argument: known[name] for argument, name in arguments})
        for signal, name in finals:
            known[signal] = known[name]
        return known

    return signals
