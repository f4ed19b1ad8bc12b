"""A tape written out as Python text, for the compiled engine and for plain evaluation of derivatives."""

from __future__ import annotations

from collections.abc import Iterable

from .tape import Node, Ref, Tape


class Printer:
    """Writes parts of a tape as Python text; parametric operations end up in the tuple `c`, made once a run."""

    def __init__(self, tape: Tape, parameter_names: Iterable[str]) -> None:
        self.tape = tape
        self.slots: dict[Ref, int] = {}
        self.parameter_index = {name: i for i, name in enumerate(parameter_names)}

    def _atom(self, ref: Ref, node: Node) -> str | None:
        if node.op == "const":
            return repr(node.value) if node.value != float("inf") else "inf"
        if node.op == "input":
            return str(node.value)
        if node.parametric:
            return f"c[{self.slots.setdefault(ref, len(self.slots))}]"
        return None

    @staticmethod
    def _operation(node: Node, args: list[str]) -> str:
        if node.op == "select":
            return f"{args[1]} if {args[0]} else {args[2]}"
        if node.op == "neg":
            return f"-{args[0]}"
        if len(args) == 2:
            return f"{args[0]} {node.op} {args[1]}"
        return f"{node.op}({args[0]})"

    def lines(self, outputs: Iterable[Ref]) -> tuple[list[str], list[str]]:
        """Assignments that compute `outputs`, and the expressions that then hold them.

        An operation that is used once is written into the expression that uses it.
        """
        outputs = list(outputs)
        nodes = self.tape.nodes
        live = set()
        pending = list(outputs)
        uses: dict[Ref, int] = {}
        while pending:
            ref = pending.pop()
            uses[ref] = uses.get(ref, 0) + 1
            if ref in live:
                continue
            live.add(ref)
            if not nodes[ref].parametric:
                pending.extend(nodes[ref].args)
        text: dict[Ref, str] = {}
        assignments = []
        for ref in sorted(live):
            node = nodes[ref]
            atom = self._atom(ref, node)
            if atom is not None:
                text[ref] = atom
                continue
            expression = self._operation(node, [text[arg] for arg in node.args])
            if uses[ref] == 1 and node.op != "select":
                text[ref] = f"({expression})"
            else:
                assignments.append(f"t{ref} = {expression}")
                text[ref] = f"t{ref}"
        return assignments, [text[ref] for ref in outputs]

    def function(self, outputs: Iterable[Ref]) -> str:
        """Body of a function that returns `outputs`."""
        assignments, results = self.lines(outputs)
        return "".join(f"    {line}\n" for line in [*assignments, "return " + ", ".join(results)])

    def constants(self) -> str:
        """Body of the function that makes the tuple `c` from the parameter vector `p`; call it last."""
        nodes = self.tape.nodes
        lines = []
        for ref in self.tape.needed(self.slots):
            node = nodes[ref]
            if node.op == "parameter":
                lines.append(f"k{ref} = p[{self.parameter_index[str(node.value)]}]")
            elif node.op == "const":
                lines.append(f"k{ref} = {self._atom(ref, node)}")
            else:
                lines.append(f"k{ref} = {self._operation(node, [f'k{arg}' for arg in node.args])}")
        # At least two, so that it is a tuple whatever the equations are.
        slots = [f"k{ref}" for ref in self.slots] + ["0.0"] * max(2 - len(self.slots), 0)
        return "".join(f"    {line}\n" for line in [*lines, f"return ({', '.join(slots)})"])
