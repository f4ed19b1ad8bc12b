"""Where a run leaves the range of the logs from which a law of one of the plant's effects was found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..core.unit import unit_suffix
from ..physics.effects import ADDENDS, EFFECTS
from ..plant.arrays import array_evaluator
from ..plant.plant import Plant

#: A variable has left a range if it is beyond it by this share of the range's width. Engineering judgement.
BEYOND = 0.05


@dataclass(frozen=True)
class Extrapolation:
    """A variable of a law that left the law's range in a run. known, reached: lowest and highest value, SI units."""

    effect: str
    variable: str
    unit: str
    known: tuple[float, float]
    reached: tuple[float, float]

    def __str__(self) -> str:
        (low, high), (lowest, highest) = self.known, self.reached
        unit = unit_suffix(self.unit)
        return (
            f"the law {self.effect} is known for {self.variable} from {low:.4g} to {high:.4g}{unit}, but this "
            f"run goes from {lowest:.4g} to {highest:.4g}{unit}; its values beyond the range are extrapolated"
        )


def extrapolations(
    plant: Plant, extremes: Mapping[str, tuple[float, float]], sampled: Mapping[str, np.ndarray]
) -> Iterator[Extrapolation]:
    """Variables that left the `[range]` of a law that acts in the plant.

    extremes: state or input -> lowest and highest value in a run, SI units. sampled: state, input or direction of a
    contact -> (N,) in the run, from which the efforts on a contact follow.
    """
    system, units = plant.structure.system, plant.structure.units
    ranges = list(_ranges(plant))
    efforts = {effort for contact in system.all_contacts for effort in contact.efforts}
    wanted = sorted(efforts.intersection(variable for _, variable, _ in ranges).difference(extremes))
    found = array_evaluator(plant.structure.equations, wanted)({**plant.values, **sampled}) if wanted else {}
    reached = {**{name: (float(np.nanmin(one)), float(np.nanmax(one))) for name, one in found.items()}, **extremes}
    for effect, variable, (low, high) in ranges:
        margin = BEYOND * (high - low)
        lowest, highest = reached.get(variable, (low, high))
        if lowest < low - margin or highest > high + margin:
            yield Extrapolation(effect, variable, units[variable], (low, high), (lowest, highest))


def _ranges(plant: Plant) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Effect, variable and range of each law that acts, by the plant's names."""
    for name in plant.structure.effects:
        effect = EFFECTS[name]
        if effect.law is None or all(p.shape or plant[p.name] == p.neutral for p in effect.parameters):
            continue
        law = effect.law.definition
        own = ADDENDS[law.adds_to].own
        for variable, known in law.range.items():
            for one in map(plant.structure.system.own, own.get(variable, (variable,))):
                yield name, one, known
