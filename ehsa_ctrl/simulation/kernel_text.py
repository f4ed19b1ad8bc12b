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

from ..core.errors import InputError
from ..plant.printer import Printer
from ..plant.structure import Structure
from ..plant.tangent import Tangent
from ..plant.tape import Tape, build_tape

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
    acceleration_text: str


#: What can be asked of an engine, and the templates that make it up.
PARTS = {
    "open_loop": ("kernel.py.j2", "open_loop.py.j2"),
    "closed_loop": ("kernel.py.j2", "closed_loop.py.j2"),
    "sensitivity": ("kernel.py.j2", "sensitivity.py.j2"),
}


def kernel_text(structure: Structure, part: str = "open_loop") -> str:
    """Source of the module that simulates plants of this structure; `part` is one of PARTS."""
    equations = structure.equations
    if part == "sensitivity" and structure.delay is not None:
        raise InputError(
            f"no derivatives by {structure.delay}: a dead time of the drive is the same as delays of all sensors; "
            f"free delay.CHANNEL instead"
        )
    tape = build_tape(equations)
    printer = Printer(tape, equations.parameter_names)
    cell = structure.system.cell
    contacts = []
    for contact in structure.system.contacts:
        law = structure.law(contact)
        rate = equations.rates[equations.index(contact.velocity)]
        band = "0.0" if law.band is None else printer.lines([tape.refs[contact.symbol(law.band)]])[1][0]
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
                acceleration_text=printer.function([tape.refs[rate]]) if law.sticks else "",
            )
        )
    context: dict[str, Any] = {
        "title": f"the structure {structure}",
        "n": len(equations.states),
        # Position of the dead time among the parameters; none for most plants.
        "late": None if structure.delay is None else equations.parameter_names.index(structure.delay),
        "state_names": [state.name for state in equations.states],
        # An effect's own states must not change the steps of a plant in which it is neutral.
        "weighed": len(structure.system.states),
        "scales": {state.name: state.scale for state in equations.states},
        "contacts": contacts,
        "rates_text": printer.function([tape.refs[rate] for rate in equations.rates]),
        "input_names": equations.inputs,
        "measured": [state if state in tape.refs else "0.0" for state in ("omega", "P_1", "P_2", "x")],
        "cell_text": printer.function([tape.refs[cell] if cell else tape.constant(0.0)]),
        "tableau": [{"number": i + 2, "c": c, "a": _terms(row)} for i, (c, row) in enumerate(TABLEAU)],
        "error_weights": _terms(ERROR),
    }
    context["sensitivities"] = part == "sensitivity"
    if part == "sensitivity":
        context |= _slopes(structure, tape, printer)
    context["constants_text"] = printer.constants()
    macros = (FOLDER / "macros.j2").read_text()
    source = macros + "\n\n\n".join((FOLDER / name).read_text() for name in PARTS[part])
    return (
        jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
        .from_string(source)
        .render(context)
    )


def _slopes(structure: Structure, tape: Tape, printer: Printer) -> dict[str, Any]:
    """What the sensitivities need: the rates with their exact derivatives by states, parameters and inputs."""
    equations = structure.equations
    names = [state.name for state in equations.states]
    parameters = [*equations.parameter_names, *equations.inputs]
    tangent = Tangent(tape, [*names, *parameters])
    rates = [tape.refs[rate] for rate in equations.rates]
    jacobian, by_parameter, outputs, parameter_outputs = [], [], [], []
    for row, rate in enumerate(rates):
        for seed, ref in tangent.of(rate).items():
            if seed in names:
                jacobian.append((row, names.index(seed)))
                outputs.append(ref)
            else:
                by_parameter.append((row, parameters.index(seed)))
                parameter_outputs.append(ref)
    assignments, expressions = printer.lines([*rates, *outputs, *parameter_outputs])
    split = len(rates) + len(outputs)
    stores = [
        f"F[{row}, columns[{column}]] = {expression}"
        for (row, column), expression in zip(by_parameter, expressions[split:], strict=True)
    ]
    lines = [*assignments, *stores, "return " + ", ".join(expressions[:split])]
    stages = [
        {"number": 1, "c": 0.0, "a": []},
        *({"number": i + 2, "c": c, "a": _terms(row)} for i, (c, row) in enumerate(TABLEAU[:-1])),
    ]
    return {
        "slopes_text": "".join(f"    {line}\n" for line in lines),
        "jacobian": jacobian,
        "stages": stages,
        "weights": _terms(TABLEAU[-1][1]),
    }


def _terms(row: tuple[float, ...]) -> list[tuple[float, int]]:
    """Non-zero weights of a row of the tableau with the number of their stage."""
    return [(weight, j + 1) for j, weight in enumerate(row) if weight != 0.0]
