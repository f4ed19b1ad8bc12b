"""Draw the benchmark's cases by seed: logs, the nominal model given to the tool, and the key.

python benchmarks/withheld/cases.py --set tuning --count 120 --out results/withheld/tuning
python benchmarks/withheld/cases.py --set reported --out results/withheld/reported
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from draw import SETS, Case, NoDrawError, draw
from family import FAMILIES
from joblib import Parallel, delayed
from sensors import DECIMALS

#: Cases of each family in a full set.
SHARES = {
    "single": 304, "pair": 80, "none": 300, "outside": 130, "weak": 60, "closed_loop": 76, "parameters": 40,
    "linear": 10, "nominals_off": 70, "rig_loop": 60, "other_form": 60, "several": 50, "production": 30,
    "outside_rig": 30,
}  # fmt: skip


def plan(count: int, families: Sequence[str] = FAMILIES) -> list[tuple[str, int]]:
    """(family, index) of the first `count` cases, all families in their shares; a longer plan begins with a shorter."""
    total = sum(SHARES[f] for f in families)
    due = [((i + 0.5) / SHARES[f], f, i) for f in families for i in range(-(-count * SHARES[f] // total) + 1)]
    return [(family, index) for _, family, index in sorted(due)[:count]]


def write_csv(columns: dict[str, np.ndarray], file: Path) -> None:
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(
            [f"{value:.{DECIMALS[name]}f}" for name, value in zip(columns, row, strict=True)]
            for row in zip(*columns.values(), strict=True)
        )


def write(case: Case, name: str, folder: Path) -> None:
    """CSV and model settings for the tool, the key in a separate folder."""
    model_settings: dict[str, Any] = {"log": f"{name}.csv", **case.model_settings}
    write_csv(case.log, folder / f"{name}.csv")
    if case.validate:
        model_settings["validate"] = f"{name}v.csv"
        write_csv(case.validate, folder / f"{name}v.csv")
    (folder / f"{name}.json").write_text(json.dumps(model_settings, indent=1) + "\n")
    (folder / "keys").mkdir(exist_ok=True)
    (folder / "keys" / f"{name}.json").write_text(json.dumps(case.key, indent=1) + "\n")


def make(set_name: str, family: str, index: int, name: str, folder: Path) -> str:
    """Draw and write one case unless it exists; return the error, if any."""
    if (folder / "keys" / f"{name}.json").exists():
        return ""
    try:
        write(draw(set_name, family, index), name, folder)
    except NoDrawError as error:
        return str(error)
    return ""


def collect_keys(folder: Path) -> dict[str, Any]:
    key = {file.stem: json.loads(file.read_text()) for file in sorted((folder / "keys").glob("*.json"))}
    (folder / "key.json").write_text(json.dumps(key, indent=1) + "\n")
    return key


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Draw cases by seed; existing ones are kept.")
    parser.add_argument("--set", choices=sorted(SETS), required=True, help="seeds for tuning, or for reported figures")
    parser.add_argument("--count", type=int, default=sum(SHARES.values()))
    parser.add_argument("--family", nargs="+", choices=FAMILIES, default=list(FAMILIES))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    rows = plan(options.count, options.family)
    counted = dict.fromkeys(FAMILIES, 0)
    jobs = []
    for family, index in rows:
        counted[family] += 1
        jobs.append(delayed(make)(options.set, family, index, f"{options.set}_{family}_{index:04d}", options.out))
    missing = [why for why in Parallel(options.jobs, verbose=1)(jobs) if why]
    key = collect_keys(options.out)
    print(f"{len(key)} cases in {options.out}: " + ", ".join(f"{n} {family}" for family, n in counted.items() if n))
    for why in missing:
        print(f"not drawn: {why}")


if __name__ == "__main__":
    main()
