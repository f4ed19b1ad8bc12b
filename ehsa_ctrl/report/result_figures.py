"""Figures of each result's page, as pairs of file stem and figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ..core.text import stems
from ..diagnosis.diagnosis import Diagnosis
from ..identification.comparison import Comparison
from ..identification.identification import Identification
from ..scenario.result import ScenarioResult
from .figures import (
    candidates_figure,
    correlation_figure,
    diagnosis_figure,
    identification_figure,
    law_figure,
    loop_figure,
    loop_replay_figure,
    parameters_figure,
    replay_figure,
    residuals_figure,
    save,
    shrinkage_figure,
    unknown_inputs_figure,
    where_figure,
)
from .figures.diagnosis import regimes_by_balance
from .kinds.identification import DRAWN, fit_stem
from .kinds.run import loops_of, run_stems

Figures = Iterator[tuple[str, Figure]]


def save_all(figures: Figures, folder: Path) -> None:
    """Write each figure as PNG and SVG."""
    for stem, figure in figures:
        save(figure, folder / stem)


def run_figures(results: Sequence[ScenarioResult], stated: Sequence[Mapping[str, Any]] | None = None) -> Figures:
    """Each run, its baseline figure if it deviates from the baseline, and each distinct linear loop.

    stated: dictionaries of the results, if already made.
    """
    runs = list(stated) if stated is not None else [result.to_dict() for result in results]
    for stem, result in zip(run_stems(runs), results, strict=True):
        yield stem, result.plot()
        if result.baseline is not None and result.baseline.differences(result):
            yield f"{stem}-baseline", result.plot_baseline()
    places = {id(run): result for run, result in zip(runs, results, strict=True)}
    for stem, run in loops_of(runs).items():
        loop = places[id(run)].loop
        assert loop is not None
        yield stem, loop_figure(loop)


def identification_figures(identifications: Mapping[str, Identification]) -> Figures:
    """Fits, parameters, correlation and residuals of each model. identifications: name of the model -> result."""
    for name, found in identifications.items():
        end = f"-{name}" if len(identifications) > 1 else ""
        runs = found.validation.after or found.train.after
        for index in range(min(len(runs), DRAWN)):
            yield fit_stem(end, index), identification_figure(found, index)
        yield f"parameters{end}", parameters_figure(found)
        if found.method == "simulation":
            yield f"correlation{end}", correlation_figure(found)
        if found.residual_tests:
            yield f"residuals{end}", residuals_figure(found)


def comparison_figures(replays: Sequence[Comparison]) -> Figures:
    """The whole log, and the second in which the input varies most."""
    yield "compare", replay_figure(replays)
    yield "compare-detail", replay_figure(replays, detail=True)


def diagnosis_figures(diagnosis: Diagnosis) -> Figures:
    """All figures for which the diagnosis has data."""
    by_log = diagnosis.by_log()
    for stem, one in zip(stems("signals", len(by_log)), by_log, strict=True):
        yield stem, diagnosis_figure(one)
    if diagnosis.closed_loop is not None:
        yield "closed_loop_replay", loop_replay_figure(diagnosis)
    if diagnosis.verdict == "no_gap":
        return
    if diagnosis.law is not None:
        yield "law", law_figure(diagnosis)
    if diagnosis.where:
        yield "where", where_figure(diagnosis)
    if regimes_by_balance(diagnosis.location):
        yield "unknown_inputs", unknown_inputs_figure(diagnosis)
    if diagnosis.candidates:
        yield "candidates", candidates_figure(diagnosis)
    yield "shrinkage", shrinkage_figure(diagnosis)
