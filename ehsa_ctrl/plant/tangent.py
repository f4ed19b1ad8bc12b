"""Exact derivatives of a tape: forward mode, sparse, on the same tape.

The derivative of each operation with respect to each seed is appended as further operations; zeros are left out. At a
kink (`abs`, `min`, `max`, conditionals) the derivative is one-sided, on the side of the branch taken.
"""

from __future__ import annotations

from collections.abc import Iterable

from .tape import Ref, Tape


class Tangent:
    """Derivatives of everything on `tape` with respect to `seeds` (names of inputs or parameters)."""

    def __init__(self, tape: Tape, seeds: Iterable[str]) -> None:
        self.tape = tape
        one = tape.constant(1.0)
        self._of: dict[Ref, dict[str, Ref]] = {tape.given[seed]: {seed: one} for seed in seeds}

    def of(self, ref: Ref) -> dict[str, Ref]:
        """Non-zero derivatives of one operation: seed -> position on the tape."""
        for needed in self.tape.needed([ref]):
            if needed not in self._of:
                self._of[needed] = self._differentiate(needed)
        return self._of[ref]

    def _differentiate(self, ref: Ref) -> dict[str, Ref]:
        tape = self.tape
        node = tape.nodes[ref]
        inner = [self._of.get(arg, {}) for arg in node.args]
        if not any(inner):
            return {}
        if node.op == "select":
            zero = tape.constant(0.0)
            condition, _, _ = node.args
            seeds = dict.fromkeys([*inner[1], *inner[2]])
            return {
                seed: tape.emit("select", condition, inner[1].get(seed, zero), inner[2].get(seed, zero))
                for seed in seeds
            }
        if node.op in ("<", "<=", ">", ">=", "==", "!=", "and", "or"):
            return {}
        result: dict[str, Ref] = {}
        for partial, derivatives in zip(self._partials(ref), inner, strict=True):
            for seed, derivative in derivatives.items():
                term = self._product(partial, derivative)
                result[seed] = tape.emit("+", result[seed], term) if seed in result else term
        return result

    def _product(self, a: Ref, b: Ref) -> Ref:
        one = self.tape.constant(1.0)
        minus = self.tape.constant(-1.0)
        if a == one:
            return b
        if b == one:
            return a
        if a == minus:
            return self.tape.emit("neg", b)
        return self.tape.emit("*", a, b)

    def _partials(self, ref: Ref) -> tuple[Ref, ...]:
        """Derivative of the operation by each of its arguments, as positions on the tape."""
        emit, constant = self.tape.emit, self.tape.constant
        node = self.tape.nodes[ref]
        one, minus = constant(1.0), constant(-1.0)
        args = node.args
        match node.op:
            case "+":
                return one, one
            case "-":
                return one, minus
            case "*":
                return args[1], args[0]
            case "/":
                inverse = emit("/", one, args[1])
                return inverse, emit("neg", emit("*", ref, inverse))
            case "**":
                less = emit("**", args[0], emit("-", args[1], one))
                return emit("*", args[1], less), emit("*", ref, emit("log", args[0]))
            case "neg":
                return (minus,)
            case "abs":
                return (emit("select", emit("<", args[0], constant(0.0)), minus, one),)
            case "round":
                return (constant(0.0),)
            case "exp":
                return (ref,)
            case "log":
                return (emit("/", one, args[0]),)
            case "sqrt":
                # At zero the slope is infinite, but the argument is constant there (max(x, 0)): the product is 0.
                zero = constant(0.0)
                return (emit("select", emit("<", zero, ref), emit("/", constant(0.5), ref), zero),)
            case "sin":
                return (emit("cos", args[0]),)
            case "cos":
                return (emit("neg", emit("sin", args[0])),)
            case "tan":
                return (emit("+", one, emit("*", ref, ref)),)
            case "tanh":
                return (emit("-", one, emit("*", ref, ref)),)
            case "atan":
                return (emit("/", one, emit("+", one, emit("*", args[0], args[0]))),)
        raise NotImplementedError(f"no derivative is implemented for the operation {node.op!r}")
