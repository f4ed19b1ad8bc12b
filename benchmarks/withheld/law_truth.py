"""The bench's laws as the tool would write them: place, variables and pieces of a right form."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: Most forms of a set that counts as right.
SET = 3
FLOWS = ("pump_flow", "flow_1", "flow_2", "flows")
SHAFT = ("torque", "drive")
#: A term without any variable.
CONSTANT = r"(?:^|\+ )c_\d(?: \+|$)"


@dataclass(frozen=True)
class Truth:
    """A law of the bench.

    places: unknown inputs that may have it. variables: pieces of the variables' names, all of which are needed. forms:
    regular expressions, one of which a right form contains.
    """

    places: tuple[str, ...]
    variables: tuple[str, ...]
    forms: tuple[str, ...]

    def variable_in(self, found: Mapping[str, Any] | None) -> bool:
        """Whether a proposed law has the right place and variables."""
        shown = " ".join(found["variables"]) if found else ""
        return bool(found) and found["place"] in self.places and all(word in shown for word in self.variables)

    def form_in(self, found: Mapping[str, Any] | None) -> bool:
        """Whether one of the first forms of a proposed law is right too."""
        forms = [one["expression"] for one in found["forms"][:SET]] if found else []
        return self.variable_in(found) and any(re.search(piece, text) for text in forms for piece in self.forms)


@dataclass(frozen=True)
class Removed:
    """An effect of the catalogue that is left out.

    truth: its law. also: ids that are left out with it, because their law contains it. laws: of the bench's forms,
    those that are more than a wrong number of the nominal plant; empty for all.
    """

    truth: Truth
    also: tuple[str, ...] = ()
    laws: tuple[str, ...] = field(default=())


def _any(*texts: str) -> tuple[str, ...]:
    return tuple(map(re.escape, texts))


#: Law outside the catalogue -> what would be right. The others have no expression.
OUTSIDE_TRUTHS = {
    "flow_ripple": Truth(("displacement",), ("angle",), _any("sin(")),
    "leak_growth": Truth(FLOWS, ("P_", "time"), _any("* c_m_")),
    "one_way_leak": Truth(FLOWS, ("(P_1 - P_2)",), _any("max((P_1 - P_2)", "abs((P_1 - P_2))")),
    "heat_droop": Truth(("torque",), ("current", "time"), _any("current * (1 - exp(", "current * c_m_")),
    "memory": Truth(("force",), ("reversal",), _any("(d_R - c_m_", "d_R * (1 - abs(c_m_")),
    "jam": Truth(("force",), ("time",), _any("d_R * 0.5 * (1 + tanh(")),
    "brake": Truth(("torque",), ("current",), _any("d_M * 0.5 * (1 + tanh(", "d_M * exp(-", "d_M * max(1 - ")),
    "drive_step": Truth(SHAFT, ("current",), _any("round(current")),
}

#: Effect of the catalogue that the grammar can write -> what would be right. Wrong numbers of the nominal plant are not
#: among them, because its refit needs no effect, nor are errors of sensors and effects in the balances of rod and
#: chambers at once.
REMOVED = {
    "torque_saturation": Removed(
        Truth(SHAFT, ("current",), _any("current * abs(current)", "current**3", "tanh(current", "max(current -"))
    ),
    "torque_ripple": Removed(Truth(SHAFT, ("angle",), _any("sin("))),
    "pump_torque_loss": Removed(Truth(("torque",), ("(P_1 - P_2)",), _any("d_M * abs((P_1 - P_2))"))),
    "windage": Removed(Truth(("torque",), ("omega",), _any("omega * abs(omega)", "omega**3"))),
    "current_offset": Removed(Truth(SHAFT, (), (CONSTANT,)), ("sensor_bias",)),
    "drive_dead_band": Removed(
        Truth(SHAFT, ("current",), (r"tanh\(current", r"max\((?:abs\()?current", r"max\(c_at_\d - current"))
    ),
    "drive_lag": Removed(Truth(SHAFT, ("current",), (r"\(c_m_\d - current\)",)), ("drive_delay",)),
    "orifice_leakage": Removed(Truth(FLOWS, ("(P_1 - P_2)",), _any("sqrt(abs((P_1 - P_2)))"))),
    "external_leakage": Removed(Truth(("flows",), ("P",), (r"c_\d \* P(?: \+|$)",))),
    "relief_valve": Removed(Truth(FLOWS, ("P",), (r"max\((?:abs\()?\(?P(?:_|\b)",)), ("relief_hysteresis",)),
    "anti_cavitation": Removed(Truth(FLOWS, ("P",), (r"max\(c_at_\d - P(?:_|\b)",))),
    "pump_dead_zone": Removed(Truth(FLOWS, ("omega",), _any("tanh(omega"))),
    "filling_loss": Removed(Truth(FLOWS, ("omega",), _any("omega**3", "omega * abs(omega)"))),
    "pressure_dependent_displacement": Removed(
        Truth(FLOWS, ("omega", "(P_1 - P_2)"), _any("omega * abs((P_1 - P_2))", "(P_1 - P_2) * abs(omega)"))
    ),
    "load_dependent_friction": Removed(Truth(("force",), ("(P_1 - P_2)",), _any("d_R * abs((P_1 - P_2))"))),
    "asymmetric_friction": Removed(Truth(("force",), (), (CONSTANT, re.escape("abs(v)"))), ("constant_force",)),
    "position_dependent_friction": Removed(
        Truth(("force",), ("x",), _any("d_R * exp(-((x", "d_R * max(1 - ((x", "d_R * 0.5 * (1 + tanh("))
    ),
    "presliding": Removed(Truth(("force",), ("x",), (r"c_\d \* c_m_\d",)), ("maxwell_slip",)),
    "line_pressure_drop": Removed(
        Truth(("force",), ("v",), _any("v * abs(v)", "v**3")),
        ("rod_drag",),
        ("turbulent, oil at the pump", "turbulent, oil at the cylinder"),
    ),
    "constant_force": Removed(Truth(("force",), (), (CONSTANT,)), ("asymmetric_friction",)),
    "load_spring": Removed(Truth(("force",), ("x",), (r"c_\d \* x(?: \+|$)",)), ("spring_hardening",), ("missing",)),
    "spring_hardening": Removed(Truth(("force",), ("x",), (r"c_\d \* x\*\*3", re.escape("x * abs(x)"), r"max\(x -"))),
    "end_stop": Removed(Truth(("force",), ("x",), (r"max\(x - c_at", r"max\(c_at_\d - x"))),
    "viscosity_warmup": Removed(Truth(("force", "torque"), ("time",), (r"(?:v|omega) \* (?:\(1 - exp\(-)?c_m_",))),
}  # fmt: skip
