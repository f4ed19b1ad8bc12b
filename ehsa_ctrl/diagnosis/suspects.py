"""Who may have done it: every effect that a plant and a log could show."""

from __future__ import annotations

from collections.abc import Mapping, Set

import numpy as np

from ..physics.effects import EFFECTS
from ..plant.arrays import needed_to_simulate
from .dry import dry_friction
from .suspect import Free, Suspect, letter_of, starts_of
from .suspected_equations import equations
from .twin import BRISTLES, DAMPING, Twin


def suspects(twin: Twin) -> tuple[Suspect, ...]:
    """Every effect that this plant and this log could show."""
    found: list[Suspect] = []
    structure = twin.plant.structure
    asked = needed_to_simulate(structure.equations)
    for name, effect in EFFECTS.items():
        if effect.sensor is not None:
            found += _of_sensors(twin, name, effect.sensor)
        elif effect.letters:
            found += _of_letters(twin, name, asked)
        elif name in structure.effects and (effect.delays or asked & {p.name for p in effect.parameters}):
            found += equations(twin, name)
    found += _presliding(twin)
    return tuple(found)


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


def _of_letters(twin: Twin, name: str, asked: Set[str]) -> list[Suspect]:
    """asked: what a simulation depends on."""
    effect, system = EFFECTS[name], twin.plant.structure.system
    letters = tuple(letter for letter in effect.letters if system.own(letter) in asked)
    if not letters:
        return []
    if name == "chamber_volume_variation":
        free = tuple(letter_of(twin, letter, 0.1) for letter in letters)
        if "c_V" in asked:
            free = (*free, Free("c_V", twin.plant["c_V"], 0.2, -1.0, 3.0))
        return [Suspect(name, effect.place, free, starts_of(free, 0.0))]
    found = []
    for group in TOGETHER.get(name, (letters,)):
        if not set(group) <= set(letters):
            continue
        free = tuple(letter_of(twin, letter, 0.1, _typical(twin, letter)) for letter in group)
        starts = starts_of(free, 0.0)
        if name in FROM_BALANCES and free[0].believed == 0.0:
            # From none to all of it is too far for derivatives at none.
            seen = dry_friction(twin.plant, twin.log).get(group[0], 0.0)
            starts = ((seen, *(0.1 * seen for _ in group[1:])),) if seen else starts
        found.append(Suspect(name, effect.place, free, starts))
    if name == "constant_force" and "force" in twin.channels:
        # A force on the rod itself passes the load cell by: as if the cell had a bias of its own.
        free = (*found[0].free, Free("bias.force", 0.0, 20.0))
        found.append(Suspect(name, effect.place, free, starts_of(free, 0.0)))
    return found


def _of_sensors(twin: Twin, name: str, word: str) -> list[Suspect]:
    # What the load cell shows moves none of the signals that are scored.
    channels = [channel for channel in twin.channels if channel != "force"]
    system, dt = twin.plant.structure.system, twin.log.sample_time
    if word in ("delay", "filter"):
        channels.append(system.drive)
    found = []
    for channel in channels:
        sd = float(np.std(twin.log[channel]))
        if sd == 0.0:
            continue
        sensor = twin.plant.sensors[channel]
        free = {
            "bias": Free(f"bias.{channel}", sensor.bias, 0.03 * sd, -20.0 * sd, 20.0 * sd),
            "scale": Free(f"scale.{channel}", sensor.scale, 0.02, 0.2, 5.0),
            # Sensors of slow logs may have clocks of their own.
            "delay": Free(f"delay.{channel}", 0.0, max(1e-3, 0.25 * dt), 0.0, max(0.1, 25.0 * dt)),
            "filter": Free(f"filter.{channel}", 0.0, 1e-3, 0.0, 0.2),
        }[word]
        starts = starts_of((free,), 2.0) if word in ("delay", "filter") else starts_of((free,), 0.0)
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
        Free(BRISTLES, known, max(5e-8, 0.1 * known), 0.0, 5e-6), letter_of(twin, "C_FR", 0.3, TYPICAL["C_FR"])
    )  # fmt: skip
    starts = starts_of(free, 0.0) if known else starts_of(free, 1.0, 6.0)
    damped = (*free, Free(DAMPING, 5e3, 2e3, 0.0, 1e5))
    return [
        Suspect("presliding", "force", free, starts),
        Suspect("presliding", "force", damped, tuple((*start, 5e3) for start in starts)),
    ]
