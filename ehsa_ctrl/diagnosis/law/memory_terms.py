"""The terms with a memory that an unknown input may have, by the place at which it acts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from ...physics.effects import ADDENDS
from ...plant.plant import Plant
from ...plant.system import Contact
from ..regressors import balance_contact
from .memory import (
    ACCELERATION,
    DAMPINGS,
    LAGS,
    QUICK,
    RESONANCES,
    SLIPS,
    SLOW_SHARES,
    STATE,
    MemoryTerm,
    following,
    late_direction,
    over_angle,
    over_time,
    resonance,
    slip,
)

Known = Mapping[str, np.ndarray]


def memory_terms(plant: Plant, name: str, known: Known, seconds: float) -> Iterator[MemoryTerm]:
    """Terms with a memory for one unknown input of a plant. seconds: length of the log."""
    place = ADDENDS[name].place
    if place in ("torque", "force"):
        yield from _of_motion(plant, place, known, seconds)
    elif place == "flow":
        yield from _of_flow(plant, name, known, seconds)


def _of_motion(plant: Plant, place: str, known: Known, seconds: float) -> Iterator[MemoryTerm]:
    contact = balance_contact(plant, place)
    direction, speed, position = contact.direction, contact.velocity, contact.position
    system = plant.structure.system
    drive = system.inputs[0]
    units = plant.structure.units
    driven = place == "torque" and drive in known and units.get(drive) == "A"
    bases = {"1": (), direction: (), speed: (speed,)} | ({drive: (drive,)} if driven else {})
    yield from over_time(bases, seconds)
    yield from _friction(contact, known)
    if speed in known:
        # The difference from a lag: a law of the rate itself would be a loop, because the rate depends on the law.
        size = float(np.std(known[speed]))
        text = f"({speed} - {STATE}) / tau"
        yield from following(text, speed, units[speed], size, QUICK, (ACCELERATION,))
    if position in known:
        unit, reach = units[position], float(np.ptp(known[position]))
        for share in SLIPS:
            shapes = {"width": share * reach}
            yield MemoryTerm(STATE, slip(speed, unit, share * reach), shapes, {"width": unit}, (position,))
    if place == "torque":
        yield from over_angle(speed)
    if driven:
        size = float(np.std(known[drive]))
        slow = [share * seconds for share in SLOW_SHARES]
        yield from following(f"{drive} * {STATE}", f"{drive}**2", "A2", size**2, slow, (drive,))
        yield from following(f"({STATE} - {drive})", drive, "A", size, LAGS, (drive,))
        for frequency, damping in product(RESONANCES, DAMPINGS):
            shapes = {"frequency": frequency, "damping": damping}
            memory = resonance(drive, "A", size)
            yield MemoryTerm(f"({STATE} - {drive})", memory, shapes, {"frequency": "1/s", "damping": "1"}, (drive,))


def _friction(contact: Contact, known: Known) -> Iterator[MemoryTerm]:
    """Dry friction that follows a reversal late, from what it was or anew. A log may begin soon after a reversal or
    long after."""
    d = contact.direction
    if d not in known:
        return
    first = float(known[d][np.argmax(known[d] != 0.0)])
    # With a short time constant both are alike. What begins anew has its full level until the contact moves.
    anew = [tau for tau in LAGS if tau > QUICK[0]]
    for forgets, taus in ((False, LAGS), (True, anew)):
        for begins in dict.fromkeys((0.0, first)):
            text, memory = late_direction(d, forgets=forgets, begins=begins)
            for tau in taus:
                yield MemoryTerm(text, memory, {"tau": tau}, {"tau": "s"}, ("reversal",))


def _of_flow(plant: Plant, name: str, known: Known, seconds: float) -> Iterator[MemoryTerm]:
    system = plant.structure.system
    if not set(system.pressures) <= set(known):
        return
    if ADDENDS[name].factors:
        yield from over_angle(balance_contact(plant, "torque").velocity)
        return
    first, second = system.pressures
    difference = f"({first} - {second})"
    either = "".join(ADDENDS[name].own)
    own = either or (system.entries[name].target if name in system.entries else "")
    bases = {difference: (difference,)} | ({own: (own,)} if own in known else {})
    yield from over_time(bases, seconds)
    # One state has one value in both chambers, so that the lag of either pressure is no term.
    if own in known and not either:
        size = float(np.std(known[own]))
        yield from following(f"({own} - {STATE}) / tau", own, "Pa", size, LAGS, (own,))
