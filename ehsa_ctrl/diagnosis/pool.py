"""The threads of a diagnosis, how far it is, and its end at an interrupt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from ..simulation.threads import in_threads

Watch = Callable[[str, int, int], None]
Item = TypeVar("Item")
Result = TypeVar("Result")

#: Number of steps of a whole diagnosis for its `watch` callback.
STEPS = 1000
#: Share of a phase that each stage takes of what the stages before it have left. How many stages there are depends on
#: the log.
STAGE_SHARE = 0.25


class DiagnosisProgress:
    """How far a diagnosis is: phases whose shares of the time are known, with any number of stages in each."""

    def __init__(self, watch: Watch | None = None) -> None:
        self.watch = watch
        self.done = self.end = 0.0

    def begin(self, share: float) -> None:
        """Begin a phase that takes this share of the whole time."""
        self.done = self.end
        self.end += share

    def report(self, stage: str, part: float) -> None:
        """Report a part of a stage; a whole one ends it."""
        here = self.done + STAGE_SHARE * part * (self.end - self.done)
        if part >= 1.0:
            self.done = here
        if self.watch is not None:
            self.watch(stage, round(STEPS * here), STEPS)


class Pool:
    """Work of a stage on all threads of the diagnosis (`sharing_threads`). watch: see `diagnose`."""

    def __init__(self, watch: Watch | None = None) -> None:
        self.progress = DiagnosisProgress(watch)

    def map(
        self,
        stage: str,
        work: Callable[[Item], Result],
        items: Sequence[Item],
        size: Callable[[Item], float] = lambda _: 0.0,
    ) -> list[Result]:
        """Results in the order of the items.

        An interrupt or an error ends the simulations of all threads at once. size: what the time of an item grows with;
        the largest begin first, so that no large one is left to run alone at the end.
        """
        order = sorted(range(len(items)), key=lambda i: -size(items[i]))
        out: dict[int, Result] = {}
        for i, result in zip(order, in_threads(work, [items[i] for i in order]), strict=True):
            out[i] = result
            self.progress.report(stage, len(out) / len(items))
        return [out[i] for i in range(len(items))]
