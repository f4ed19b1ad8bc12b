"""The page of an identification: verdict first, then figures and tables, at the end what the numbers rest on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from ..core.errors import InputError
from ..core.text import join_words
from ..identification.comparison import GOOD, POOR
from ..identification.identification import Identification
from ..identification.refits import EstimateSensitivity
from ..identification.uncertainty import Estimate
from ..plant.file import both
from .channel import shown
from .document import Picture, anchors, embedded, merged_versions, write_document
from .drift import DriftTable
from .figures import correlation_figure, identification_figure, parameters_figure, residuals_figure
from .grounds import assumed_of, hashes
from .kinds._result import BANNERS, LOOKS
from .number import NOTHING, number, uncertain, unit
from .verdict import Verdict, verdict, weights

#: The mark of each verdict: told apart without colour too.
MARKS = {"well determined": "✓", "poorly determined": "△", "not identifiable from this log": "✗"}
#: More logs than this are in the table of runs only.
DRAWN = 4


@dataclass(frozen=True)
class Section:
    """One identification, as its part of the page shows it."""

    identification: Identification
    anchor: str
    tried: Sequence[EstimateSensitivity] | None = None

    @property
    def drifts(self) -> DriftTable | None:
        """Its values over the ranges of assumed parameters, where these were tried."""
        return None if self.tried is None else DriftTable(self.identification, self.tried)

    @property
    def model(self) -> str:
        return self.identification.plant.model

    @property
    def name(self) -> str:
        return f"{self.model} model"

    @property
    def verdict(self) -> Verdict:
        return verdict(self.identification)

    @property
    def pictures(self) -> list[Picture]:
        found = []
        for heading, figure, caption in self._figures():
            words = f"{heading} of the {self.name}. {' '.join(words for words, _ in self.verdict.sentences)}"
            found.append(Picture(heading, embedded(figure, words), caption))
        return found

    def _figures(self) -> Iterator[tuple[str, Figure, str]]:
        """Heading, figure and caption of all that there is to draw."""
        found = self.identification
        beside = " beside the balances" if found.method == "balances" else ""
        runs = found.validation.after or found.train.after
        for index, run in enumerate(runs[:DRAWN]):
            yield (
                f"Before and after on {run.log.name}",
                identification_figure(found, index),
                "Free runs, driven by the logged drive and nothing else. Right: the second in which the drive varies "
                "most. A run far off the measurement leaves its panel.",
            )
        yield (
            "Parameters",
            parameters_figure(found),
            "Left: how far off the start was, and the interval that the logs leave; linear up to 1 %, logarithmic "
            "beyond. Right: standard deviations on a logarithmic axis.",
        )
        if found.method == "simulation" and len(found.estimates) > 1:
            yield (
                "Correlation",
                correlation_figure(found),
                "Two parameters near ±1 can be traded for each other: a log that moves differently tells them apart.",
            )
        if found.residual_tests:
            yield (
                "Residuals",
                residuals_figure(found),
                f"Of the simulation{beside}. A right model leaves residuals that know neither of each other nor of the "
                "drive, the direction of motion or the position. Above each panel: passed or not, and the largest "
                "correlation.",
            )

    @property
    def parameters(self) -> list[tuple[Estimate, dict[str, str]]]:
        """Each estimate and how it is written."""
        meanings = {kind.name: kind.meaning for kind in self.identification.plant.structure.equations.parameters}
        return [(estimate, _written(estimate, meanings)) for estimate in self.identification.estimates]

    @property
    def other_method(self) -> str:
        return "balances" if self.identification.method == "simulation" else "simulation"

    @property
    def beside(self) -> list[tuple[str, str, str, str, str]]:
        """Name, this estimate, that of the other method, unit, and the difference in standard deviations of both."""
        other = {estimate.name: estimate for estimate in self.identification.other_estimates}
        rows = []
        for estimate in self.identification.estimates:
            if estimate.name in other:
                its = other[estimate.name]
                sd = (estimate.sd**2 + its.sd**2) ** 0.5
                apart = number(round(abs(estimate.value - its.value) / sd, 1)) if 0 < sd < float("inf") else NOTHING
                words = (uncertain(estimate.value, estimate.sd), uncertain(its.value, its.sd))
                rows.append((both(estimate.name), *words, unit(estimate.unit), apart))
        return rows

    @property
    def fits(self) -> list[tuple[str, list[str]]]:
        """Channel, and its fit in %: used before and after, held out before and after."""
        found = self.identification
        columns = [found.train.fit_percent_before, found.train.fit_percent]
        if found.validation.after:
            columns += [found.validation.fit_percent_before, found.validation.fit_percent]
        return [(channel, [number(fits[channel]) for fits in columns]) for channel in found.train.fit_percent]

    @property
    def runs(self) -> list[tuple[str, str, str, str]]:
        """Log, what it was for, the worst fit in it, and how its free run starts and whether it ended early."""
        rows = []
        for purpose, reach in (("used", self.identification.train), ("held out", self.identification.validation)):
            for run in reach.after:
                known = {channel: fit for channel, fit in run.fit_percent.items() if fit == fit}
                worst = min(known, key=lambda channel: known[channel], default="")
                words = f"{number(known[worst])} % ({worst})" if worst else NOTHING
                story = f"starts {run.start}" + (f"; {run.stopped}" if run.stopped else "")
                rows.append((run.log.name, purpose, words, story))
        return rows

    @property
    def weights(self) -> list[tuple[str, str, str, str]]:
        """Channel, its weight and its sensor's noise as standard deviations, and their unit."""
        rows = []
        for channel, sd, noise in weights(self.identification):
            how = shown(channel)
            rows.append((how.words, number(sd / how.scale), number(noise / how.scale), unit(how.unit)))
        return rows

    @property
    def facts(self) -> list[tuple[str, str]]:
        """How the estimate was made."""
        found = self.identification
        by = "simulation error" if found.method == "simulation" else "balances"
        if found.method == "balances" and found.balances is not None:
            by = f"balances, {found.balances.method}"
        beside = " beside" if found.method == "balances" else ""
        facts = [("method", by), ("logs used", join_words([run.log.name for run in found.train.after]))]
        facts.append(("held out", join_words([run.log.name for run in found.validation.after]) or "none"))
        if found.fit is not None:
            length = "whole logs in free run" if found.window is None else f"windows of {number(found.window)} s"
            facts.append((f"simulation{beside}", length))
            tried = ", ".join(f"{start}: {number(cost)}" for start, cost in found.starts)
            facts.append(("starts tried, with their cost", tried))
            facts.append(("residuals", f"{found.fit.residuals}, {number(found.fit.reduced_cost)} times the weights"))
        facts.append(("time", f"{number(found.seconds)} s"))
        return facts


def write_identification_page(
    identifications: Sequence[Identification],
    folder: Path,
    *,
    command: str,
    drifts: Sequence[Sequence[EstimateSensitivity]] = (),
) -> Path:
    """Write `report.html` to the folder and return its path; the same identifications give the same bytes.

    Parameters
    ----------
    identifications: one, or several models of the same logs, the simplest first.
    command: the command line that made them, for the page's end.
    drifts: of each what `identification.refits.assumption_sensitivities` says; left out where that was not asked for.

    Raises InputError if there is none.
    """
    if not identifications:
        raise InputError("there is no identification to report; identify at least one plant")
    names = anchors(f"model-{found.plant.model}" for found in identifications)
    tried: list[Sequence[EstimateSensitivity] | None] = [*drifts] if drifts else [None] * len(identifications)
    sections = [Section(*parts) for parts in zip(identifications, names, tried, strict=True)]
    findings = dict.fromkeys(finding for found in identifications for finding in found.findings)
    return write_document(
        "identification.html.j2",
        folder,
        plant=identifications[0].plant,
        headline=_headline(identifications),
        sections=sections,
        models=_models(identifications),
        findings=list(findings),
        marks=MARKS,
        looks=LOOKS,
        banners=BANNERS,
        named=(GOOD, POOR),
        files=_files(identifications),
        versions=merged_versions(found.provenance for found in identifications),
        assumed=assumed_of(found.plant for found in identifications),
        command=command,
    )


def _files(identifications: Sequence[Identification]) -> list[tuple[str, str]]:
    runs = [run for found in identifications for run in (*found.train.after, *found.validation.after)]
    return hashes([*(run.log.path for run in runs), *(found.nominal.path for found in identifications)])


def _headline(identifications: Sequence[Identification]) -> str:
    counts = [
        f"{sum(e.identifiable for e in found.estimates)} of {len(found.estimates)}"
        + (f" ({found.plant.model})" if len(identifications) > 1 else "")
        for found in identifications
    ]
    return f"{identifications[0].plant.name}: {join_words(counts)} parameters well determined"


def _models(identifications: Sequence[Identification]) -> list[tuple[str, list[str]]]:
    """Channel, and the fit of each model on the logs used and held out; nothing to compare with a single model."""
    if len(identifications) < 2:
        return []
    columns = [found.train.fit_percent for found in identifications]
    if identifications[0].validation.after:
        columns += [found.validation.fit_percent for found in identifications]
    channels = dict.fromkeys(channel for fits in columns for channel in fits)
    return [(channel, [number(fits.get(channel, float("nan"))) for fits in columns]) for channel in channels]


def _written(estimate: Estimate, meanings: dict[str, str]) -> dict[str, str]:
    """Each cell of an estimate's row."""
    low, high = estimate.interval
    notes = [f"at its {estimate.at_bound} bound"] if estimate.at_bound else []
    if estimate.trades:
        notes.append(f"trades with {join_words(map(both, estimate.trades))}")
    if estimate.prior_sd is not None:
        notes.append(f"held at {number(estimate.start)} ± {number(estimate.prior_sd)}")
    word, dot, channel = estimate.name.partition(".")
    return {
        "name": both(estimate.name),
        "value": uncertain(estimate.value, estimate.sd),
        "unit": unit(estimate.unit),
        "relative": f"{100.0 * estimate.relative_sd:.2g} %" if estimate.relative_sd < 10.0 else NOTHING,
        "interval": f"{number(low)} to {number(high)}" if abs(high) != float("inf") else "unbounded",
        "start": number(estimate.start),
        "notes": "; ".join(notes),
        "meaning": f"{word} of the sensor of {channel}" if dot else meanings.get(estimate.name, ""),
    }
