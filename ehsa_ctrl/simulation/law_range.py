"""Where a run leaves the range of the logs from which a law of one of the plant's effects was found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ..physics.effects import ADDENDS, EFFECTS
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
        return (
            f"the law {self.effect} is known for {self.variable} from {low:.4g} to {high:.4g} {self.unit}, but this "
            f"run goes from {lowest:.4g} to {highest:.4g} {self.unit}; its values beyond the range are extrapolated"
        )


def extrapolations(plant: Plant, reached: Mapping[str, tuple[float, float]]) -> Iterator[Extrapolation]:
    """Variables that left the `[range]` of a law that acts in the plant.

    reached: state or input -> lowest and highest value in a run, SI units. Other variables of a law, such as an effort
    on a contact, are not looked at.
    """
    units = plant.structure.units
    for name in plant.structure.effects:
        effect = EFFECTS[name]
        if effect.law is None or all(p.shape or plant[p.name] == p.neutral for p in effect.parameters):
            continue
        law = effect.law.definition
        own = ADDENDS[law.adds_to].own
        for variable, (low, high) in law.range.items():
            margin = BEYOND * (high - low)
            for one in map(plant.structure.system.own, own.get(variable, (variable,))):
                lowest, highest = reached.get(one, (low, high))
                if lowest < low - margin or highest > high + margin:
                    yield Extrapolation(name, one, units[one], (low, high), (lowest, highest))
