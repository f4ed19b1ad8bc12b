"""Evaluate the equations for whole records: with arrays instead of numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .tape import Ref, Tape, build_tape
from .wiring import Equations

_OPERATIONS: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "select": np.where,
    "neg": np.negative,
    "abs": np.abs,
    "atan": np.arctan,
    "round": np.rint,
    **{name: getattr(np, name) for name in ("exp", "log", "sqrt", "sin", "cos", "tan", "tanh")},
}


def evaluate_tape(tape: Tape, refs: Sequence[Ref], values: Mapping[str, Any]) -> list[Any]:
    """Values of `refs`. values: of inputs and parameters by name, as arrays of one shape or numbers."""
    found: dict[Ref, Any] = {}
    with np.errstate(all="ignore"):
        for ref in tape.needed(refs):
            node = tape.nodes[ref]
            if node.op == "const":
                found[ref] = node.value
            elif node.op in ("input", "parameter"):
                found[ref] = values[str(node.value)]
            else:
                found[ref] = _OPERATIONS[node.op](*(found[arg] for arg in node.args))
    return [found[ref] for ref in refs]


def array_evaluator(equations: Equations, wanted: Sequence[str]) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """A function of states, inputs, directions, measured names and parameters that returns `wanted` signals by name.

    Values may be arrays of one shape; only those that the wanted signals depend on are needed. Floating-point errors
    are ignored, because both branches of a conditional are computed and the one not taken may overflow.
    """
    tape: Tape = build_tape(equations, residuals=True)
    refs = [tape.refs[name] for name in wanted]

    def evaluate(values: Mapping[str, Any]) -> dict[str, Any]:
        return dict(zip(wanted, evaluate_tape(tape, refs, values), strict=True))

    return evaluate


def needed_to_simulate(equations: Equations) -> set[str]:
    """Names that the rates of the states depend on; friction of a rod with prescribed motion is not among them."""
    return needs(equations, *equations.rates)


def needs(equations: Equations, *signals: str) -> set[str]:
    """Names of states, inputs, measurements and parameters that signals depend on."""
    tape = build_tape(equations, residuals=True)
    nodes = [tape.nodes[ref] for ref in tape.needed([tape.refs[signal] for signal in signals])]
    return {str(node.value) for node in nodes if node.op in ("input", "parameter")}
