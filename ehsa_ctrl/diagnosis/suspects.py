"""Who may have done it: for each effect what becomes free, from which values the search starts, within which bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from ..physics.effects import EFFECTS
from .dry import dry_friction
from .ripple import strongest_orders
from .twin import BRISTLES, DAMPING, Twin

#: Letters that count as nominal parameters which a modeller has a little wrong, with the most that is believed of
#: their relative error.
NOMINAL = {
    "K_T": 0.05, "J_M": 0.1, "A_FM": 0.1, "B_FM": 0.1, "C_FM": 0.15, "K_L": 0.15, "V_10": 0.1, "V_20": 0.1, "V": 0.1,
    "M": 0.1, "A_FR": 0.1, "B_FR": 0.1, "C_FR": 0.15, "tau_FM": 0.15, "tau_FR": 0.15, "K_S": 0.1,
}  # fmt: skip


@dataclass(frozen=True)
class Free:
    """One number that a hypothesis sets free: its neutral or believed value, a size that is felt, bounds."""

    name: str
    believed: float
    scale: float
    lower: float = -inf
    upper: float = inf


@dataclass(frozen=True)
class Suspect:
    """One effect, with a channel if it is a sensor's.

    free: what it sets free, the size first. starts: values of these from which a search begins, several where the way
    from one to another is not downhill.
    """

    id: str
    place: str
    free: tuple[Free, ...]
    starts: tuple[tuple[float, ...], ...]
    channel: str | None = None

    @property
    def key(self) -> tuple[str, str | None]:
        return self.id, self.channel

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(free.name for free in self.free)

    def __str__(self) -> str:
        return self.id if self.channel is None else f"{self.id}({self.channel})"


def suspects(twin: Twin) -> tuple[Suspect, ...]:
    """Every effect that this plant and this log could show."""
    found: list[Suspect] = []
    for name, effect in EFFECTS.items():
        if effect.sensor is not None:
            found += _of_sensors(twin, name, effect.sensor)
        elif effect.letters:
            found += _of_letters(twin, name)
        elif effect.parameters and name in twin.plant.structure.effects:
            found += _of_equation(twin, name)
    found += _presliding(twin)
    return tuple(found)


def _letter(twin: Twin, name: str, relative: float, typical: float = 0.0) -> Free:
    """A letter of the plant: its bounds are physical, its scale a share of itself or `typical` where it is zero."""
    name = twin.plant.structure.system.own(name)
    value = twin.plant[name]
    kinds = {kind.name: kind for kind in twin.plant.structure.equations.parameters}
    lower = kinds[name].lower
    scale = WEARS.get(name, relative * abs(value))
    # A value that is next to nothing is as far from what it should be as nothing is.
    scale = typical if scale < 0.1 * typical else scale
    if kinds[name].lower_open and lower == 0.0:
        lower = 0.02 * value
    return Free(name, value, scale, lower, kinds[name].upper)


#: Leakage wears by factors and not by per cents.
WEARS = {"K_L": 5e-13}
#: Sizes at which a letter that is believed to be zero is felt.
TYPICAL = {
    "F_0": 50.0, "k_3": 2e6, "K_S": 2e3, "m_L": 20.0, "A_FM": 0.1, "C_FM": 0.02, "B_FM": 1e-4, "A_FR": 100.0,
    "C_FR": 50.0, "B_FR": 500.0,
}  # fmt: skip
#: Effects that a balance shows where the plant has none of them.
FROM_BALANCES = ("motor_friction", "rod_friction", "rod_viscous_friction", "constant_force")
#: The size of the rod's efforts for which these are typical [N].
TYPICAL_EFFORT = 1e3
#: What a letter's effect sets free, where it is not all of its letters, and other letters that go with them.
TOGETHER: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "payload_mass": (("M",), ("m_L",)),
    "rod_friction": (("A_FR", "C_FR"),),
    "motor_friction": (("A_FM", "C_FM"),),
}


def _typical(twin: Twin, letter: str) -> float:
    """TYPICAL in a system whose rod has other efforts."""
    rods = [contact for contact in twin.plant.structure.system.contacts if contact.suffix == "FR"]
    share = rods[0].effort_scale / TYPICAL_EFFORT if rods else 1.0
    return TYPICAL.get(letter, 0.0) * share


def _of_letters(twin: Twin, name: str) -> list[Suspect]:
    effect, system = EFFECTS[name], twin.plant.structure.system
    letters = tuple(letter for letter in effect.letters if system.own(letter) in twin.plant.parameters)
    if not letters:
        return []
    if name == "chamber_volume_variation":
        free = (*(_letter(twin, letter, 0.1) for letter in letters), Free("c_V", twin.plant["c_V"], 0.2, -1.0, 3.0))
        return [Suspect(name, effect.place, free, _starts(free, 0.0))]
    found = []
    for group in TOGETHER.get(name, (letters,)):
        if not set(group) <= set(letters):
            continue
        free = tuple(_letter(twin, letter, 0.1, _typical(twin, letter)) for letter in group)
        starts = _starts(free, 0.0)
        if name in FROM_BALANCES and free[0].believed == 0.0:
            # From none to all of it is too far for derivatives at none.
            seen = dry_friction(twin.plant, twin.log).get(group[0], 0.0)
            starts = ((seen, *(0.1 * seen for _ in group[1:])),) if seen else starts
        found.append(Suspect(name, effect.place, free, starts))
    if name == "constant_force" and "force" in twin.channels:
        # A force on the rod itself passes the load cell by: as if the cell had a bias of its own.
        free = (*found[0].free, Free("bias.force", 0.0, 20.0))
        found.append(Suspect(name, effect.place, free, _starts(free, 0.0)))
    return found


def _starts(free: Sequence[Free], *sizes: float) -> tuple[tuple[float, ...], ...]:
    """Starts with the first number moved by each of `sizes` scales, the others as believed."""
    return tuple((free[0].believed + s * free[0].scale, *(f.believed for f in free[1:])) for s in sizes)


def _of_equation(twin: Twin, name: str) -> list[Suspect]:
    effect, plant, log = EFFECTS[name], twin.plant, twin.log
    if name == "backlash" and plant["K_S"] == 0.0:
        return []
    A_FR = plant.structure.system.own("A_FR")
    by_name = {p.name: p for p in effect.parameters}

    def free(letter: str, scale: float) -> Free:
        return Free(letter, plant[letter], scale, by_name[letter].lower, by_name[letter].upper)

    def one(frees: tuple[Free, ...], starts: tuple[tuple[float, ...], ...]) -> Suspect:
        return Suspect(name, effect.place, frees, starts)

    pressures = [log[c] for c in ("p1", "p2") if c in log.channels]
    if name == "relief_valve":
        high = max((float(np.quantile(p, 0.998)) for p in pressures), default=2e7)
        low = plant["P_0"]
        levels = [low + share * (high - low) for share in (0.95, 0.8, 0.6)]
        crack, gain = Free("P_crack", inf, 0.05 * (high - low), 0.0, inf), free("K_relief", 0.3 * plant["K_relief"])
        found = [
            one((crack,), tuple((v,) for v in levels)),
            # How steeply it opens is a valve's own.
            one((crack, gain), tuple((v, gain.believed) for v in levels[:2])),
        ]
        if len(pressures) == 2:
            top = float(np.quantile(np.abs(pressures[0] - pressures[1]), 0.998))
            crosses = tuple((share * top,) for share in (0.95, 0.8, 0.6))
            cross = Free("P_cross", inf, 0.05 * top, 0.0, inf)
            found += [one((cross,), crosses), one((cross, gain), tuple((v, gain.believed) for (v,) in crosses[:2]))]
        return found
    if name == "anti_cavitation":
        low = min((float(np.quantile(p, 0.002)) for p in pressures), default=0.0)
        top = plant["P_0"]
        levels = [low + share * (top - low) for share in (0.1, 0.3, 0.6)]
        return [one((Free("P_open", -inf, 0.05 * (top - low), -1e5, inf),), tuple((v,) for v in levels))]
    if name == "end_stop":
        if "position" not in log.channels:
            return []
        reach = float(np.max(np.abs(log["position"])))
        return [
            one((Free("x_stop", inf, 0.02 * reach, 1e-3, inf),), ((1.002 * reach,), (0.985 * reach,), (0.9 * reach,)))
        ]
    if name == "position_dependent_friction":
        if "position" not in log.channels or plant[A_FR] == 0.0:
            return []
        low, high = np.quantile(log["position"], [0.02, 0.98])
        width = float(np.clip(0.2 * (high - low), 3e-3, 0.015))
        bump = (
            free("h_FR", 0.15),
            Free("x_h", 0.0, 0.3 * width, -1.0, 1.0),
            Free("w_h", width, 0.2 * width, 2e-3, 0.04),
        )
        places = np.linspace(low, high, 7)[1:-1]
        return [one(bump, tuple((0.3, float(x), width) for x in places))]
    if name == "torque_ripple":
        return _ripple(twin, name, effect.place)
    if name == "line_pressure_drop":
        lines = (Free("R_turb", plant["R_turb"], 2e12, 0.0, inf), Free("R_lam", plant["R_lam"], 2e8, 0.0, inf))
        return [one(lines, ((2e12, 0.0),))]
    if name == "viscosity_warmup":
        warming = (free("drop", 0.05), Free("tau_w", 10.0, 3.0, 0.5, 1e3))
        return [one(warming, ((0.05, 10.0),))]
    if name == "entrained_air":
        return [one((free("air_fraction", 0.003),), ((0.003,), (0.02,)))]
    scales = {"I_0": 0.02, "T_d": 1e-3, "tau_I": 1e-3, "K_e": 3e-14, "kappa": 0.03, "K_t": 1e-9, "c_f": 0.03,
              "k_sat": 0.05, "dA": 0.005, "a_FR": 0.03, "width": 2e-4, "I_db": 0.02, "k_w": 2e-7, "w_d": 0.5,
              "k_D": 5e-9, "k_f": 0.01}  # fmt: skip
    first = effect.parameters[0]
    lower, upper = {"T_d": (0.0, 0.06), "tau_I": (0.0, 0.1)}.get(first.name, (first.lower, first.upper))
    frees = (Free(first.name, plant[first.name], scales[first.name], lower, upper),)
    sizes = (1.0, 8.0) if lower == 0.0 else (0.0,)
    found = [one(frees, _starts(frees, *sizes))]
    if name == "load_dependent_friction" and plant[A_FR] > 0.0:
        # Where it grows with the higher pressure, its part at the pressure of rest is in the Coulomb level.
        both = (*frees, _letter(twin, "A_FR", 0.1))
        found.append(one(both, _starts(both, *sizes)))
    if name == "asymmetric_friction":
        both = (*frees, Free("b_FR", plant["b_FR"], 0.03, -0.9, 0.9))
        found.append(one(both, _starts(both, *sizes)))
    return found


def _ripple(twin: Twin, name: str, place: str) -> list[Suspect]:
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
    return [Suspect(name, place, frees, starts)]


def _of_sensors(twin: Twin, name: str, word: str) -> list[Suspect]:
    # What the load cell shows moves none of the signals that are scored.
    channels = [channel for channel in twin.channels if channel != "force"]
    system = twin.plant.structure.system
    if word in ("delay", "filter"):
        channels.append(system.drive)
    found = []
    for channel in channels:
        sd = float(np.std(twin.log[channel]))
        sensor = twin.plant.sensors[channel]
        free = {
            "bias": Free(f"bias.{channel}", sensor.bias, 0.03 * sd, -20.0 * sd, 20.0 * sd),
            "scale": Free(f"scale.{channel}", sensor.scale, 0.02, 0.2, 5.0),
            "delay": Free(f"delay.{channel}", 0.0, 1e-3, 0.0, 0.1),
            "filter": Free(f"filter.{channel}", 0.0, 1e-3, 0.0, 0.2),
        }[word]
        starts = _starts((free,), 2.0) if word in ("delay", "filter") else _starts((free,), 0.0)
        # The rod's place is defined by its sensor; only a load that depends on it could tell.
        sprung = "K_S" in twin.plant.parameters and twin.plant["K_S"] != 0.0
        if word == "bias" and channel == "position" and not sprung:
            continue
        found.append(Suspect(name, "sensor", (free,), starts, channel))
    return found


def _presliding(twin: Twin) -> list[Suspect]:
    if twin.bristles is None or twin.plant["A_FR"] + twin.plant["C_FR"] == 0.0:
        return []
    known = 1.0 / twin.plant["sigma_0_FR"] if "sigma_0_FR" in twin.plant.parameters else 0.0
    # Bristles take the place of static friction, so that its excess is free too.
    free = (
        Free(BRISTLES, known, max(5e-8, 0.1 * known), 0.0, 5e-6), _letter(twin, "C_FR", 0.3, TYPICAL["C_FR"])
    )  # fmt: skip
    starts = _starts(free, 0.0) if known else _starts(free, 1.0, 6.0)
    damped = (*free, Free(DAMPING, 5e3, 2e3, 0.0, 1e5))
    return [
        Suspect("presliding", "force", free, starts),
        Suspect("presliding", "force", damped, tuple((*start, 5e3) for start in starts)),
    ]
