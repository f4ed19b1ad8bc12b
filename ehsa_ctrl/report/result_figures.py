"""The figures that belong to each result's page: the file of each without its ending, and the figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from ..diagnosis.diagnosis import Diagnosis
from ..identification.comparison import Comparison
from ..identification.identification import Identification
from ..scenario.result import ScenarioResult
from .figures import (
    candidates_figure,
    correlation_figure,
    diagnosis_figure,
    identification_figure,
    loop_figure,
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
    """Each run, its baseline where it left that, and each linear loop once.

    stated: the results' dictionaries, where they are at hand.
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
    """Fits, parameters, correlation and residuals of each model; identifications: by the name of the model."""
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
    """The whole log, and the second in which the drive varies most."""
    yield "compare", replay_figure(replays)
    yield "compare-detail", replay_figure(replays, detail=True)


def diagnosis_figures(diagnosis: Diagnosis) -> Figures:
    """Those for which the diagnosis has something to show."""
    yield "signals", diagnosis_figure(diagnosis)
    if diagnosis.verdict == "no_gap":
        return
    if diagnosis.where:
        yield "where", where_figure(diagnosis)
    if regimes_by_balance(diagnosis.location):
        yield "unknown_inputs", unknown_inputs_figure(diagnosis)
    if diagnosis.candidates:
        yield "candidates", candidates_figure(diagnosis)
    yield "shrinkage", shrinkage_figure(diagnosis)
