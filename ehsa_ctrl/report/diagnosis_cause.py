"""A cause as the page of a diagnosis shows it: numbers as they are read, what it closes, what it can't be told from."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..core.text import join_words
from ..diagnosis.diagnosis import Cause, Diagnosis, Estimated
from ..physics.effects import EFFECTS
from ..plant.file import both
from ..plant.plant import Plant, Sensor
from .channel import SHOWN
from .diagnosis_signals import signal_shown
from .figures.diagnosis import percent
from .figures.unknown_inputs import read_unit
from .number import number, uncertain, unit


@dataclass(frozen=True)
class Number:
    """A number of a cause as it is written: found, believed, unit and meaning."""

    name: str
    value: str
    unit: str
    nominal: str
    meaning: str


@dataclass(frozen=True)
class CauseSection:
    """One cause, as the page shows it."""

    cause: Cause
    diagnosis: Diagnosis

    @property
    def name(self) -> str:
        return self.cause.name

    @property
    def about(self) -> str:
        """What the catalogue says of it, and what it looks like in a log."""
        return f"{sentence(self.cause.summary)} In a log: {EFFECTS[self.cause.id].fingerprint}."

    @property
    def certain(self) -> bool:
        return self.cause.probability >= 0.9 and not self.cause.ambiguous_with

    @property
    def probability(self) -> str:
        return f"{self.cause.probability:.2f}"

    @property
    def numbers(self) -> list[Number]:
        return [_number(self.diagnosis, self.cause, name, found) for name, found in self.cause.parameters.items()]

    @property
    def alike(self) -> list[tuple[str, str]]:
        """Each effect that no log could tell from it, and why."""
        return [(other, why) for other, why in self.cause.why_same.items() if other in self.cause.ambiguous_with]

    @property
    def rivals(self) -> str:
        """Effects that this log does not tell from it, though another could."""
        return join_words([other for other in self.cause.ambiguous_with if other not in self.cause.why_same])

    @property
    def reach(self) -> list[tuple[str, str]]:
        """How much it closes, what a refit would have closed, what it makes alone."""
        named = self.diagnosis.verdict in ("effect", "ambiguous")
        rows = [("place", self.cause.place)]
        if named:
            part = number(round(100.0 * self.cause.gap_closed, 1))
            own = ", its own part" if len(self.diagnosis.effects) > 1 else ""
            rows.append(("closes", f"{part} % of the gap of all signals on held-out data{own}"))
            absorbed = number(round(100.0 * self.cause.absorbed_by_refit, 1))
            words = f"{absorbed} % of what is closed, so much refitted nominal parameters would have closed alone"
            rows.append(("hidden by a refit", words))
        alone = ", ".join(
            f"{signal_shown(name).words} {percent(gap)}" for name, gap in self.cause.alone.items() if name != "total"
        )
        if alone:
            rows.append(("alone it makes", f"a gap of {alone}, in the larger of fitted and held-out data"))
        return rows


def sentence(words: str) -> str:
    """Words with a capital letter and a full stop; letters of equations within stay as they are."""
    return f"{words[:1].upper()}{words[1:].rstrip('.')}."


def _number(diagnosis: Diagnosis, cause: Cause, name: str, found: Estimated) -> Number:
    """A number of a cause: symbols in SI units as everywhere, pressures and short times as a person reads them."""
    plant = diagnosis.plant
    if cause.channel is not None and name == "value":
        return _sensor_number(plant, cause.id, cause.channel, found)
    own = {parameter.name: parameter for parameter in EFFECTS[cause.id].parameters}
    meanings = {kind.name: kind.meaning for kind in plant.structure.equations.parameters}
    usual, scale = read(found) if name in own else (found.unit, 1.0)
    nominal = plant[name] if name in plant.parameters else own[name].neutral if name in own else math.inf
    meaning = own[name].meaning if name in own else meanings.get(name, "")
    return Number(
        both(name), uncertain(found.value / scale, found.sd / scale), unit(usual),
        "not there" if math.isinf(nominal) else number(nominal / scale), meaning,
    )  # fmt: skip


def _sensor_number(plant: Plant, id: str, channel: str, found: Estimated) -> Number:
    word = EFFECTS[id].sensor or ""
    usual, scale = read(found)
    sensor = plant.sensors.get(channel, Sensor(channel, found.unit))
    nominal = {"bias": sensor.bias, "scale": sensor.scale, "delay": sensor.delay, "filter": sensor.filter}[word]
    value = uncertain(found.value / scale, found.sd / scale)
    return Number(word, value, unit(usual), number(nominal / scale), f"{word} of the sensor of {channel}")


def read(found: Estimated) -> tuple[str, float]:
    """The unit in which a person reads a number, and the SI units in one of it."""
    if found.unit == "s":
        return ("ms", 1e-3) if abs(found.value) < 0.2 else ("s", 1.0)
    return read_unit(found.unit) if found.unit in SHOWN else (found.unit, 1.0)
