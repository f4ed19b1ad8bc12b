"""Effects with equations of their own as suspects: what of each becomes free, and where a log says to begin.

Most have one number that goes from neutral to where it is felt. Those in STARTS begin where the log shows something:
a valve somewhat below the highest pressure, a bump of friction at one of several places.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from ..physics.effects import EFFECTS, EffectParameter
from .ripple import strongest_orders
from .suspect import Free, Suspect, letter_of, starts_of
from .twin import Twin

Starts = tuple[tuple[float, ...], ...]
#: Numbers that become free, and the values from which the search starts.
Way = tuple[tuple[Free, ...], Starts]

#: What is felt of an effect's first number, where it starts from neutral.
FELT = {
    "I_0": 0.02, "T_d": 1e-3, "tau_I": 1e-3, "K_e": 3e-14, "kappa": 0.03, "K_t": 1e-9, "c_f": 0.03, "k_sat": 0.05,
    "dA": 0.005, "a_FR": 0.03, "width": 2e-4, "I_db": 0.02, "k_w": 2e-7, "w_d": 0.5, "k_D": 5e-9, "k_f": 0.01,
}  # fmt: skip
#: What is felt of a pressure, at least [Pa].
FELT_PRESSURE = 1e4
#: Times of a drive that are looked for [s]; an engine runs with longer ones, no drive does.
WITHIN = {"T_d": (0.0, 0.06), "tau_I": (0.0, 0.1)}


def equations(twin: Twin, name: str) -> list[Suspect]:
    """An effect as suspects, one for each way to set it free; none where the log could not show it."""
    ways = STARTS.get(name, _from_neutral)(twin, name)
    return [Suspect(name, EFFECTS[name].place, frees, starts) for frees, starts in ways]


def _free(twin: Twin, name: str, letter: str, scale: float) -> Free:
    """A number of an effect within its own bounds."""
    kind = _kind(name, letter)
    return Free(letter, twin.plant[letter], scale, kind.lower, kind.upper)


def _kind(name: str, letter: str) -> EffectParameter:
    return next(p for p in EFFECTS[name].parameters if p.name == letter)


def _from_neutral(twin: Twin, name: str) -> list[Way]:
    first = EFFECTS[name].parameters[0]
    lower, upper = WITHIN.get(first.name, (first.lower, first.upper))
    frees = (Free(first.name, twin.plant[first.name], FELT[first.name], lower, upper),)
    return [(frees, starts_of(frees, *((1.0, 8.0) if lower == 0.0 else (0.0,))))]


def _with(twin: Twin, name: str, other: Free) -> list[Way]:
    """From neutral, alone and together with another number."""
    (alone,) = _from_neutral(twin, name)
    both = (*alone[0], other)
    return [alone, (both, tuple((*start, other.believed) for start in alone[1]))]


def _load_dependent_friction(twin: Twin, name: str) -> list[Way]:
    if twin.plant[twin.plant.structure.system.own("A_FR")] <= 0.0:
        return _from_neutral(twin, name)
    # Where it grows with the higher pressure, its part at the pressure of rest is in the Coulomb level.
    return _with(twin, name, letter_of(twin, "A_FR", 0.1))


def _asymmetric_friction(twin: Twin, name: str) -> list[Way]:
    return _with(twin, name, Free("b_FR", twin.plant["b_FR"], 0.03, -0.9, 0.9))


def _backlash(twin: Twin, name: str) -> list[Way]:
    # Without a spring there is nothing that the rod could come loose of.
    return _from_neutral(twin, name) if twin.plant["K_S"] != 0.0 else []


def _pressures(twin: Twin) -> list[np.ndarray]:
    return [twin.log[c] for c in ("p1", "p2") if c in twin.log.channels]


def _levels(name: str, free: Free, levels: Sequence[float], *others: Free) -> Way:
    """A level beyond which something happens, searched from each of `levels` and from the plant's own if it has one.

    Neutral is infinitely far, also for a plant that has one: where it is never reached its derivatives vanish.
    """
    known = [free.believed] if np.isfinite(free.believed) else []
    neutral = _kind(name, free.name).neutral
    starts = tuple((level, *(other.believed for other in others)) for level in [*levels, *known])
    return (replace(free, believed=neutral), *others), starts


def _relief_valve(twin: Twin, name: str) -> list[Way]:
    pressures = _pressures(twin)
    high = max((float(np.quantile(p, 0.998)) for p in pressures), default=2e7)
    low = twin.plant["P_0"]
    levels = [low + share * (high - low) for share in (0.95, 0.8, 0.6)]
    crack = _free(twin, name, "P_crack", max(0.05 * (high - low), FELT_PRESSURE))
    # How steeply it opens is a valve's own.
    gain = _free(twin, name, "K_relief", 0.3 * twin.plant["K_relief"])
    ways = [_levels(name, crack, levels), _levels(name, crack, levels[:2], gain)]
    if len(pressures) == 2:
        top = float(np.quantile(np.abs(pressures[0] - pressures[1]), 0.998))
        levels = [share * top for share in (0.95, 0.8, 0.6)]
        cross = _free(twin, name, "P_cross", max(0.05 * top, FELT_PRESSURE))
        ways += [_levels(name, cross, levels), _levels(name, cross, levels[:2], gain)]
    return ways


def _anti_cavitation(twin: Twin, name: str) -> list[Way]:
    low = min((float(np.quantile(p, 0.002)) for p in _pressures(twin)), default=0.0)
    top = twin.plant["P_0"]
    opening = replace(_free(twin, name, "P_open", max(0.05 * (top - low), FELT_PRESSURE)), lower=-1e5)
    # Where no pressure was ever below that of rest, such a valve was shut.
    levels = [low + share * (top - low) for share in (0.1, 0.3, 0.6)] if low < top else []
    frees, starts = _levels(name, opening, levels)
    return [(frees, starts)] if starts else []


def _end_stop(twin: Twin, name: str) -> list[Way]:
    if "position" not in twin.log.channels:
        return []
    reach = float(np.max(np.abs(twin.log["position"])))
    stop = replace(_free(twin, name, "x_stop", 0.02 * reach), lower=1e-3)
    return [_levels(name, stop, [share * reach for share in (1.002, 0.985, 0.9)])]


def _position_dependent_friction(twin: Twin, name: str) -> list[Way]:
    if "position" not in twin.log.channels or twin.plant[twin.plant.structure.system.own("A_FR")] == 0.0:
        return []
    low, high = np.quantile(twin.log["position"], [0.02, 0.98])
    width = float(np.clip(0.2 * (high - low), 3e-3, 0.015))
    bump = (
        _free(twin, name, "h_FR", 0.15),
        Free("x_h", 0.0, 0.3 * width, -1.0, 1.0),
        Free("w_h", width, 0.2 * width, 2e-3, 0.04),
    )
    return [(bump, tuple((0.3, float(x), width) for x in np.linspace(low, high, 7)[1:-1]))]


def _torque_ripple(twin: Twin, name: str) -> list[Way]:
    """The order of a ripple can't be found by going downhill: it is read off the torque balance, angle by angle."""
    if "speed" not in twin.log.channels:
        return []
    starts = tuple((amplitude, order, phase) for order, amplitude, phase in strongest_orders(twin.plant, twin.log))
    if not starts:
        return []
    frees = (
        Free("T_c", 0.0, 0.03, 0.0, inf),
        # As good as fixed: each start has its own.
        Free("n_c", starts[0][1], 1e-6, 1.0, 200.0),
        Free("phi_c", 0.0, 0.3, -7.0, 7.0),
    )
    return [(frees, starts)]


def _line_pressure_drop(twin: Twin, name: str) -> list[Way]:
    lines = (
        Free("R_turb", twin.plant["R_turb"], 2e12, 0.0, inf),
        Free("R_lam", twin.plant["R_lam"], 2e8, 0.0, inf),
    )
    return [(lines, ((2e12, 0.0),))]


def _viscosity_warmup(twin: Twin, name: str) -> list[Way]:
    warming = (_free(twin, name, "drop", 0.05), Free("tau_w", 10.0, 3.0, 0.5, 1e3))
    return [(warming, ((0.05, 10.0),))]


def _entrained_air(twin: Twin, name: str) -> list[Way]:
    air = _free(twin, name, "air_fraction", 0.003)
    # Slow changes are isothermal, fast ones adiabatic; what lies between is the log's to say.
    exponent = _free(twin, name, "n_air", 0.1)
    return [((air, exponent), tuple((share, exponent.believed) for share in (0.003, 0.02)))]


#: Effects that do not simply go from neutral to what is felt.
STARTS: Mapping[str, Callable[[Twin, str], list[Way]]] = {
    "anti_cavitation": _anti_cavitation,
    "asymmetric_friction": _asymmetric_friction,
    "backlash": _backlash,
    "end_stop": _end_stop,
    "entrained_air": _entrained_air,
    "line_pressure_drop": _line_pressure_drop,
    "load_dependent_friction": _load_dependent_friction,
    "position_dependent_friction": _position_dependent_friction,
    "relief_valve": _relief_valve,
    "torque_ripple": _torque_ripple,
    "viscosity_warmup": _viscosity_warmup,
}
