"""Who may have done it: every effect that a plant and a log could show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from ..physics.effects import EFFECTS, Free
from ..plant.arrays import needed_to_simulate
from .dry import dry_friction
from .ripple import strongest_orders
from .suspect import Suspect, wears
from .twin import Twin

#: The size of the rod's efforts for which felt sizes of symbols are meant [N].
USUAL_EFFORT = 1e3


def suspects(twin: Twin) -> tuple[Suspect, ...]:
    """Every effect that this plant and this log could show."""
    rig = TwinRig(twin)
    wired = twin.plant.structure.effects
    return tuple(
        Suspect(effect.name, effect.place, candidate.free, candidate.starts, candidate.channel)
        for effect in EFFECTS.values()
        if not effect.wired or effect.symbols or effect.name in wired
        for candidate in effect.free_in(rig)
    )


class TwinRig:
    """A twin as effects ask it: see physics/effects/_candidate.py."""

    def __init__(self, twin: Twin) -> None:
        self._twin = twin
        self._system = twin.plant.structure.system
        self._asked = needed_to_simulate(twin.plant.structure.equations)

    @property
    def channels(self) -> tuple[str, ...]:
        return self._twin.channels

    @property
    def drive(self) -> str:
        return self._system.drive

    @property
    def sample_time(self) -> float:
        return self._twin.log.sample_time

    def shows(self, symbol: str) -> bool:
        return self._system.own(symbol) in self._asked

    def value(self, symbol: str) -> float:
        name = self._system.own(symbol)
        return self._twin.plant[name] if name in self._twin.plant.parameters else 0.0

    def symbol(self, symbol: str, relative: float, felt: float = 0.0) -> Free:
        name = self._system.own(symbol)
        value = self._twin.plant[name]
        kind = next(kind for kind in self._twin.plant.structure.equations.parameters if kind.name == name)
        scale = wears().get(name, relative * abs(value))
        # A value that is next to nothing is as far from what it should be as nothing is.
        felt *= self._effort
        scale = felt if scale < 0.1 * felt else scale
        lower = 0.02 * value if kind.lower_open and kind.lower == 0.0 else kind.lower
        return Free(name, value, scale, lower, kind.upper)

    @cached_property
    def _effort(self) -> float:
        """The size of this rod's efforts in USUAL_EFFORT."""
        rods = [contact for contact in self._system.contacts if contact.suffix == "FR"]
        return rods[0].effort_scale / USUAL_EFFORT if rods else 1.0

    def measured(self, channel: str) -> np.ndarray | None:
        log = self._twin.log
        return log[channel] if channel in log.channels else None

    def sensor(self, channel: str, word: str) -> float:
        return float(getattr(self._twin.plant.sensors[channel], word))

    def dry_friction(self) -> Mapping[str, float]:
        return dry_friction(self._twin.plant, self._twin.log)

    def ripples(self) -> Sequence[tuple[float, float, float]]:
        return strongest_orders(self._twin.plant, self._twin.log) if "speed" in self._twin.log.channels else ()

    def yields(self) -> bool:
        return self._twin.bristles is not None
