"""What to do after a diagnosis: the experiment that would decide, or words where there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..plant.system import System
from .diagnosis import Cause
from .judge import Key
from .next_experiment import Experiment, next_experiment
from .search import Search
from .weigh import Weighed

#: Candidates among which an experiment has to decide.
RIVALS = 4


def advice(verdict: str, causes: Sequence[Cause], system: System) -> str | None:
    """What to do where no experiment is proposed."""
    if verdict == "outside_catalogue":
        return (
            "look at the balance that the gap lies in and at the curve that was found there; a log with another load "
            "and another temperature shows whether the curve stays"
        )
    if verdict == "ambiguous" and all(set(c.ambiguous_with) <= set(c.why_same) for c in causes):
        return "no experiment with these sensors can tell them apart; measure the quantity itself"
    if verdict in ("ambiguous", "underdetermined") and system.prescribed:
        return (
            "move the rod otherwise than in this log, with another current beside it: at one speed under several "
            "currents, and at one current with several speeds; the library of inputs is for rods that the pump moves"
        )
    if verdict in ("ambiguous", "underdetermined"):
        return "no input of the library tells the candidates apart within the plant's limits; measure another quantity"
    return None


def deciding_experiment(weighed: Weighed, search: Search, noise: Mapping[str, float]) -> Experiment | None:
    """What would tell the chosen hypothesis from its rivals."""
    structure = search.bench.twin.plant.structure
    driven = structure.chambers is None or bool(structure.system.prescribed)
    if weighed.verdict not in ("ambiguous", "underdetermined") or driven:
        return None
    here = set(weighed.chosen.causes)
    others = {key for keys in weighed.rivals.values() for key in keys}
    rivals = [
        j
        for j in weighed.labels
        if len(here - set(j.causes)) == 1 and len(set(j.causes) - here) == 1 and set(j.causes) - here <= others
    ]
    known = [weighed.chosen, *rivals][:RIVALS]
    if len(known) < 2:
        known = list(weighed.labels[:RIVALS])
    named = {" + ".join(name_of(key) for key in j.label) or "none": j.fit.values for j in known}
    if len(named) < 2:
        return None
    twin = search.bench.twin
    return next_experiment(twin.plant, named, noise=noise, nominal=search.bench.nominal, present=twin)


def name_of(key: Key) -> str:
    """A cause in words: a sensor's with its channel."""
    return key[0] if key[1] is None else f"{key[0]} ({key[1]})"
