"""Time series of each result as tables: the CSV files beside its JSON, from which its page draws live charts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.text import stems
from ..diagnosis.diagnosis import Diagnosis
from ..identification.comparison import Comparison
from ..identification.identification import Identification
from ..scenario.result import ScenarioResult
from ..simulation.trajectory import Trajectory
from .figures.free_runs import diagnosis_traces, identification_traces, traces_table
from .figures.loop_replays import loop_replay_table
from .kinds._charts import LOOP_REPLAY, REGIMES
from .kinds.identification import DRAWN, fit_stem
from .kinds.run import run_stems

if TYPE_CHECKING:
    import pandas

#: Name of a CSV file and its table.
Tables = Iterator[tuple[str, "pandas.DataFrame"]]


def save_tables(tables: Tables, folder: Path) -> None:
    """Write each table as CSV, SI units."""
    for name, table in tables:
        table.to_csv(folder / name, index=False, float_format="%.9g")


def run_tables(results: Sequence[ScenarioResult], stated: Sequence[Mapping[str, Any]]) -> Tables:
    """Each run over time. stated: dictionaries of the results."""
    for stem, result in zip(run_stems(stated), results, strict=True):
        yield f"{stem}.csv", result.time_series()


def simulation_tables(run: Trajectory) -> Tables:
    """The true signals of a simulated run, without sensor noise, with the direction of motion of each contact."""
    yield "simulation.csv", run.to_pandas().rename(columns={"time": "t"})


def comparison_tables(replays: Sequence[Comparison]) -> Tables:
    """Measured channels, and one column per simulated channel and model, e.g. position_linear."""
    first = replays[0].plant.model
    table = replays[0].to_pandas().rename(columns=lambda name: name.replace("_simulated", f"_{first}"))
    for run in replays[1:]:
        for channel, values in run.simulated.items():
            table[f"{channel}_{run.plant.model}"] = values
    yield "compare.csv", table


def identification_tables(identifications: Mapping[str, Identification]) -> Tables:
    """Free runs of each model before and after, on the held-out logs if there are any."""
    for name, found in identifications.items():
        end = f"-{name}" if len(identifications) > 1 else ""
        runs = found.validation.after or found.train.after
        for index in range(min(len(runs), DRAWN)):
            log, traces = identification_traces(found, index)
            yield f"{fit_stem(end, index)}.csv", traces_table(log.time, traces)


def diagnosis_tables(diagnosis: Diagnosis) -> Tables:
    """Signals of each log before and after, and the bin of each sample along each regime's curve."""
    by_log = diagnosis.by_log()
    for stem, one in zip(stems("signals", len(by_log)), by_log, strict=True):
        yield f"{stem}.csv", traces_table(one.log.time, diagnosis_traces(one))
    if diagnosis.closed_loop is not None:
        yield LOOP_REPLAY, loop_replay_table(diagnosis, diagnosis.closed_loop)
    table = regimes_table(diagnosis)
    if table is not None:
        yield REGIMES, table


def regimes_table(diagnosis: Diagnosis) -> pandas.DataFrame | None:
    """t [s] and a column per regime, regime_1 the first: number of the sample's bin, 0 where the input is unknown.

    None without a regime.
    """
    import pandas

    location = diagnosis.location
    known = [] if location is None else [(n, r) for n, r in enumerate(location.regimes, 1) if r.which.size]
    if location is None or not known:
        return None
    rows = known[0][1].which.size
    return pandas.DataFrame({"t": location.time[:rows]} | {f"regime_{n}": regime.which for n, regime in known})
