"""Full diagnoses of the rigs that changed: the first log after the change, with the rig as it was before."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

from ..core.checkpoint import open_checkpoint
from ..core.errors import EhsaError
from ..core.files import parse_json
from ..core.parallel import as_completed, worker_count
from ..core.result import as_dict
from ..core.text import join_words
from ..diagnosis.diagnose import diagnose
from ..diagnosis.diagnosis import NAMING, Diagnosis
from ..identification.plant_log import read_plant_log
from ..plant.plant import Plant
from .result import Fleet, RigDiagnosis
from .store import DIAGNOSES, Store, code_digest, plant_digest

#: Record of finished diagnoses, and the folder of their results, in a store.
RECORD, FOLDER = "diagnoses.jsonl", DIAGNOSES


def diagnose_changed(
    fleet: Fleet,
    plants: Mapping[str, Plant],
    store: Store,
    *,
    jobs: int | None = None,
    check: bool = True,
    watch: Callable[[str, int, int], None] | None = None,
    keep: Callable[[str, Diagnosis], None] | None = None,
) -> Fleet:
    """The fleet with a diagnosis of each changed rig; those in the store's record are not computed again.

    A diagnosis that names a cause replaces that of the score test, which assumes that effects are linear in their size.
    A rig without a relevant gap after the change has not changed, however significant the change is.

    plants: rig -> the plant before the change. keep: called with the folder in the store and each new diagnosis.

    Raises InputError for a record that can't be read or written.
    """
    changed = {rig.name: rig for rig in fleet.changed}
    checkpoint = open_checkpoint(
        store.folder / RECORD, "diagnoses", "fleet", _from_line, anew=False,
        none="is not the record of a fleet's diagnoses; move it away", other="is another record; move it away",
        wrong="is not a diagnosis",
    )  # fmt: skip
    folders = _folders(changed)
    known = dict(checkpoint.results)
    keys = {name: _key(store, plants[name], Path(rig.file)) for name, rig in changed.items()}
    found = {name: known[key] for name, key in keys.items() if key in known}
    todo = [(name, plants[name], Path(rig.file)) for name, rig in changed.items() if name not in found]
    if watch is not None:
        watch("diagnoses", len(found), len(changed))
    work = partial(_diagnose, check)
    with closing(as_completed(work, todo, count=min(worker_count(jobs), max(len(todo), 1)))) as results:
        for name, one in results:
            file = changed[name].file
            if isinstance(one, str):
                found[name] = RigDiagnosis(file, error=one)
            else:
                found[name] = RigDiagnosis(
                    file, one.verdict,
                    tuple((cause.name, *cause.ambiguous_with) for cause in one.effects),
                    one.effects[0].probability if one.effects else float("nan"), one.gap["nominal"]["total"],
                    one.improved_gap["total"],
                )  # fmt: skip
                if keep is not None:
                    keep(f"{FOLDER}/{folders[name]}", one)
            checkpoint.append([json.dumps({"key": keys[name], "diagnosis": as_dict(found[name])})])
            if watch is not None:
                watch("diagnoses", len(found), len(changed))
    rigs, small = [], []
    for rig in fleet.rigs:
        if rig.name in found:
            own = found[rig.name]
            place = f"{FOLDER}/{folders[rig.name]}"
            own = replace(own, folder=place if (store.folder / place / "diagnosis.json").exists() else "")
            rig = replace(rig, diagnosis=own)
            if own.verdict in NAMING and own.causes:
                first, *others = own.causes[0]
                rig = replace(rig, cause=first, same=tuple(others), by="diagnosis")
            elif own.verdict == "no_gap":
                rig = replace(rig, changed=False)
                small.append(rig.name)
        rigs.append(rig)
    if small:
        words = f"{join_words(small)}: significant, but the full diagnosis finds no gap that matters; not counted"
        fleet = replace(fleet, notes=(*fleet.notes, words))
    return replace(fleet, rigs=tuple(rigs))


def _diagnose(check: bool, job: tuple[str, Plant, Path]) -> tuple[str, Diagnosis | str]:
    name, plant, path = job
    try:
        return name, diagnose(plant, read_plant_log(path, plant), jobs=1, check=check)
    except EhsaError as error:
        return name, str(error)
    except (ArithmeticError, ValueError, LookupError) as error:
        return name, f"{path}: the diagnosis failed ({type(error).__name__}: {error})"


def _key(store: Store, plant: Plant, path: Path) -> str:
    """Hash of log, plant and code; the values of the plant are rounded, because they come from sums over logs."""
    rounded = plant.set(**{n: float(f"{p.value:.5g}") for n, p in plant.parameters.items() if p.source == "given"})
    text = f"{store.key(path)} {plant_digest(rounded)} {code_digest()}"
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _folders(rigs: Iterable[str]) -> dict[str, str]:
    """A folder's name for each rig; names of rigs may have any character."""
    found: dict[str, str] = {}
    for rig in sorted(rigs):
        name = re.sub(r"[^\w.-]+", "_", rig).strip(".") or "rig"
        if name in found.values():
            name += f"-{len(found) + 1}"
        found[rig] = name
    return found


def _from_line(line: str) -> tuple[str, RigDiagnosis]:
    """Key and diagnosis from a line of the record. Raises LookupError, TypeError or ValueError for another line."""
    read = parse_json(line)
    content = read["diagnosis"]
    values = {f.name: content[f.name] for f in fields(RigDiagnosis) if content.get(f.name) is not None}
    return str(read["key"]), RigDiagnosis(**(values | {"causes": tuple(map(tuple, content["causes"]))}))
