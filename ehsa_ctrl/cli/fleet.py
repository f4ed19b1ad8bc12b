"""`ehsa-ctrl fleet`: which rigs of a fleet changed, in what and since when; queries of its store."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError
from .complete import plants
from .options import Json, Settings, read_pairs
from .output import OutputOptions, provenance

if TYPE_CHECKING:
    from ..diagnosis.diagnosis import Diagnosis
    from ..fleet.result import Fleet
    from ..plant.plant import Plant


#: Files of the result, the main one first.
FILES = ("fleet.json", "rigs.csv", "parameters.csv", "drifts.csv", "fleet_plant.toml", "report.html")
#: Share of virtual rigs that change, unless their number is given.
CHANGED = 0.06
#: Largest number of logs whose hashes the result lists.
MOST_HASHES = 100


def command(
    logs: Annotated[
        list[Path],
        typer.Argument(help="Logs, folders with a folder of logs for each rig, a fleet.csv, or the store to query."),
    ] = [],
    plant: Annotated[
        str, typer.Option("--plant", help="Nominal plant: its name, or the path of its TOML.", autocompletion=plants)
    ] = "ehsa",
    by: Annotated[
        str, typer.Option(metavar="COLUMN", help="Column of fleet.csv with the rig (rig), or folder for its name.")
    ] = "",
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of the store and the result; it is continued.")
    ] = Path("results/fleet"),
    query: Annotated[str, typer.Option(metavar="SQL", help="Ask the store, and print the answer.")] = "",
    diagnose: Annotated[bool, typer.Option(help="Diagnose the first log after each change in full.")] = True,
    rate: Annotated[float, typer.Option(metavar="SHARE", help="False-discovery rate of the changed rigs.")] = 0.05,
    virtual: Annotated[
        int | None,
        typer.Option(metavar="RIGS", help="Simulate a fleet of this many rigs in DIR, and analyse it.", min=2),
    ] = None,
    logs_per_rig: Annotated[int, typer.Option(help="Logs of each virtual rig.", min=2)] = 5,
    changed: Annotated[int | None, typer.Option(help="Virtual rigs that change; by default 6 %.", min=0)] = None,
    seed: Annotated[int, typer.Option(help="Seed of the virtual fleet.", min=0)] = 0,
    settings: Settings = [],
    check: Annotated[bool, typer.Option(help="Reject logs with a wrong sign, unit or stuck channel.")] = True,
    jobs: Annotated[int, typer.Option(help="Number of cores to use; -1 for all.")] = 1,
    as_json: Json = False,
) -> None:
    """Find which rigs of a fleet changed, in what and since when, and how much the fleet's units differ.

    Each log is simulated once and kept in the store; the same command continues, and only new or changed logs are
    computed.

    Examples: ehsa-ctrl fleet logs/ --plant ehsa --out results/fleet --jobs -1 · ehsa-ctrl fleet my/fleet.csv
    --plant my/rig.toml --by serial --out results/fleet · ehsa-ctrl fleet results/fleet --query
    "select rig, cause, since from rigs where changed" · ehsa-ctrl fleet --virtual 200 --out results/virtual --jobs -1
    """
    if query:
        _query(logs[0] if logs else out, logs, query, as_json)
        return
    if not logs and virtual is None:
        raise InputError("give logs, a folder of logs or a fleet.csv, or --virtual RIGS for a simulated fleet")
    if logs and virtual is not None:
        raise InputError("--virtual simulates its own logs; leave out either --virtual or the logs")
    from ..fleet.analyse import analyse_fleet
    from ..fleet.store import HEAD
    from ..fleet.virtual import LOGS, write_virtual_fleet
    from ..plant.load import load_plant
    from .output import warn_implausible
    from .progress import compiling, continuing, counting

    nominal = load_plant(plant, settings=read_pairs(settings))
    warn_implausible([nominal])
    # A store is continued, which replaces the result but never a file of the user.
    output = OutputOptions(as_json, out, force=True)
    output.check("fleet", *FILES)
    with continuing("logs", out, out / HEAD, out / LOGS):
        with compiling(), counting() as watch:
            truth: Mapping[str, Mapping[str, str]] = {}
            if virtual is not None:
                count = max(round(CHANGED * virtual), 1) if changed is None else changed
                truth = write_virtual_fleet(
                    nominal, out, rigs=virtual, logs=logs_per_rig, changed=count, seed=seed, jobs=jobs, watch=watch
                )
            found = analyse_fleet(
                nominal, [out / LOGS] if virtual is not None else logs, store=out, by=by, rate=rate, diagnose=diagnose,
                check=check, jobs=jobs, watch=watch, truth=truth,
                keep=lambda folder, one: _keep(out / folder, one),
            )  # fmt: skip
        files = [log.file for rig in found.rigs for log in rig.logs] if found.log_count <= MOST_HASHES else []
        stored = {**found.to_dict(), "rests_on": provenance([nominal], files)}
        output.deliver(
            "fleet", "fleet.json", stored, lambda: print(found), files=lambda draft: _files(draft, found, nominal)
        )  # fmt: skip


def _query(store: Path, logs: list[Path], text: str, as_json: bool) -> None:
    from ..core.result import to_json
    from ..fleet.query import query_store

    if len(logs) > 1:
        raise InputError(f"--query asks one store; got {len(logs)} paths")
    answer = query_store(store, text)
    if as_json:
        print(to_json(answer.to_dict("records")))
    else:
        print(answer.to_string(index=False) if len(answer) else "no rows")


def _keep(folder: Path, found: Diagnosis) -> None:
    """Write the files and the page of a diagnosis."""
    from ..core.result_folder import ResultFolder
    from ..report.results import write_result_page
    from .diagnose import DiagnosisOutcome, write_files
    from .output import to_json

    outcome = DiagnosisOutcome(found, [], [found.log.path])
    with ResultFolder(folder, "diagnose", force=True).draft() as draft:
        (draft / "diagnosis.json").write_text(to_json(outcome.stored()) + "\n")
        write_files(draft, outcome)
        write_result_page(draft, "diagnosis.json")


def _files(draft: Path, fleet: Fleet, plant: Plant) -> None:
    from ..fleet.fleet_plant import write_fleet_plant

    tables = {"rigs": fleet.to_pandas(), "parameters": fleet.parameter_table(), "drifts": fleet.drift_table()}
    for name, table in tables.items():
        table.to_csv(draft / f"{name}.csv", float_format="%.7g")
    write_fleet_plant(draft / "fleet_plant.toml", plant, fleet)
