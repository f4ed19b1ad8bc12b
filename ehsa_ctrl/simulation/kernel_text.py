"""From the equations of a structure to the source text of its engine.

The physics functions are put on a tape (`plant/tape.py`), what depends on the parameters alone is split off, and the
rest is written into the template `kernel.py.j2` beside this file. The text holds everything that is compiled, so that
a compiled engine can never mix an edited equation with an old one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from ..plant.printer import Printer
from ..plant.structure import Structure
from ..plant.tape import build_tape

FOLDER = Path(__file__).parent

#: Dormand & Prince, "A family of embedded Runge-Kutta formulae", J. Comp. Appl. Math. 6 (1980): the 5(4) pair with
#: 7 stages; the last stage is evaluated at the result (row 7 = weights of the fifth-order solution).
TABLEAU = (
    (1 / 5, (1 / 5,)),
    (3 / 10, (3 / 40, 9 / 40)),
    (4 / 5, (44 / 45, -56 / 15, 32 / 9)),
    (8 / 9, (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729)),
    (1.0, (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656)),
    (1.0, (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)),
)
#: Fifth- minus fourth-order weights of the same pair.
ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)


@dataclass(frozen=True)
class _ContactText:
    name: str
    direction: str
    velocity: str
    sticks: bool
    band: str
    effort_scale: float
    net_text: str
    friction_text: str


#: What can be asked of an engine, and the templates that make it up.
PARTS = {
    "open_loop": ("kernel.py.j2", "open_loop.py.j2"),
    "closed_loop": ("kernel.py.j2", "closed_loop.py.j2"),
}


def kernel_text(structure: Structure, part: str = "open_loop") -> str:
    """Source of the module that simulates plants of this structure; `part` is one of PARTS."""
    equations = structure.equations
    tape = build_tape(equations)
    printer = Printer(tape, equations.parameter_names)
    contacts = []
    for contact in structure.system.contacts:
        law = structure.law(contact)
        band = "0.0" if law.band is None else printer.lines([tape.refs[contact.letter(law.band)]])[1][0]
        contacts.append(
            _ContactText(
                name=contact.name,
                direction=contact.direction,
                velocity=contact.velocity,
                sticks=law.sticks,
                band=band,
                effort_scale=contact.effort_scale,
                net_text=printer.function([tape.refs[contact.net]]) if law.sticks else "",
                friction_text=printer.function([tape.refs[contact.friction]]) if law.sticks else "",
            )
        )
    context: dict[str, Any] = {
        "title": f"the structure {structure}",
        "state_names": [state.name for state in equations.states],
        "scales": {state.name: state.scale for state in equations.states},
        "contacts": contacts,
        "rates_text": printer.function([tape.refs[rate] for rate in equations.rates]),
        "cell_text": printer.function([tape.refs["F_cell"]]),
        "tableau": [
            {"number": i + 2, "c": c, "a": [(a, j + 1) for j, a in enumerate(row) if a != 0.0]}
            for i, (c, row) in enumerate(TABLEAU)
        ],
        "error_weights": [(e, j + 1) for j, e in enumerate(ERROR) if e != 0.0],
    }
    context["constants_text"] = printer.constants()
    context["constants_count"] = max(len(printer.slots), 1)
    macros = (FOLDER / "macros.j2").read_text()
    source = macros + "\n\n\n".join((FOLDER / name).read_text() for name in PARTS[part])
    return (
        jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
        .from_string(source)
        .render(context)
    )
