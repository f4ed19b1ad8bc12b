"""Leave each effect out of the catalogue and see whether its law is found on a log that contains it.

python benchmarks/withheld/leave_one_out.py --set tuning --out results/withheld/leave_one_out
python benchmarks/withheld/leave_one_out.py --set reported --out results/withheld/leave_one_out_reported --jobs 2
python benchmarks/withheld/leave_one_out.py --set tuning --out results/withheld/leave_one_out --only relief_valve

For each effect that the grammar of laws can write, the first case of the family `single` is taken in which the effect
alone makes a gap of LARGE or more. The diagnosis runs without that effect and without those whose law contains it.
Where the rest of the catalogue leaves less than the threshold and less than a tenth of the deviance, no law is looked
for: what is named is shown, and the shares of right laws count the others. Seeds of `tuning` and `reported` are
separate. After an interruption the same command continues.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cases import make
from draw import SETS
from effect_gap import THRESHOLD
from effects import DRAWN
from joblib import Parallel, delayed
from law_score import CLOSED, closable_of
from law_truth import REMOVED, SET
from score import diagnose

#: Smallest gap that the effect makes alone in one signal, and most cases that are drawn for it.
LARGE, MOST = 5.0 * THRESHOLD, 16


@dataclass(frozen=True)
class LeftOut:
    """An answer without one effect.

    named: ids that it names, if it proposes no law. closed: by the law, else by what is named. left: largest gap after
    that. closable: by the true structure.
    """

    id: str
    law: str
    named: tuple[str, ...]
    proposed: str
    right_variable: bool
    right_form: bool
    closed: float
    left: float
    closable: float
    seconds: float

    @property
    def enough(self) -> bool:
        """Whether the answer closes most of what the true structure closes."""
        return self.closed >= CLOSED * self.closable

    @property
    def needs_none(self) -> bool:
        """Whether no law is looked for, because the rest of the catalogue leaves less than the threshold."""
        return not self.proposed and self.left < THRESHOLD


def case_of(set_name: str, id: str, folder: Path) -> str:
    """Name of the first case in which the effect alone makes a large gap; empty if there is none."""
    for turn in range(MOST):
        index = DRAWN.index(id) + turn * len(DRAWN)
        name = f"{set_name}_single_{index:04d}"
        if make(set_name, "single", index, name, folder):
            continue
        effects = json.loads((folder / "keys" / f"{name}.json").read_text())["effects"]
        large = [one["id"] for one in effects] == [id] and max(effects[0]["alone"].values()) >= LARGE
        if large and (not REMOVED[id].laws or effects[0]["law"] in REMOVED[id].laws):
            return name
    return ""


def options_of(id: str) -> list[str]:
    """The command-line options that leave an effect out."""
    return [word for one in (id, *REMOVED[id].also) for word in ("--without", one)]


def score_answer(id: str, key: Mapping[str, Any], answer: Mapping[str, Any]) -> LeftOut:
    """The score of a diagnosis.json beside the key of its case."""
    found, truth, gap = answer.get("law"), REMOVED[id].truth, answer["gap"]
    model = "with_law" if found else "with_effects"
    return LeftOut(
        id,
        key["effects"][0]["law"],
        () if found else tuple(one["id"] for one in answer["effects"]),
        found["forms"][0]["expression"] if found else "",
        truth.variable_in(found),
        truth.form_in(found),
        1.0 - gap[model]["total"] / gap["nominal"]["total"],
        max(gap[model].values()),
        closable_of(key),
        answer["seconds"],
    )


def table(rows: Sequence[LeftOut]) -> str:
    """One line per effect, and the shares."""
    lines = [
        "| left out | form on the bench | law found, or effects named | variable | form | closes | closable | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        answer = f"`{row.proposed}`" if row.proposed else ", ".join(row.named) or "none"
        right = [("yes" if one else "no") if row.proposed else "" for one in (row.right_variable, row.right_form)]
        lines.append(
            f"| {row.id} | {row.law} | {answer} | {' | '.join(right)} | {row.closed:.2f} | {row.closable:.2f} | "
            f"{row.seconds:.0f} |"
        )
    wanted = [row for row in rows if not row.needs_none]
    for words, values in {
        f"the rest of the catalogue leaves less than {100 * THRESHOLD:.0f} %": [row.needs_none for row in rows],
        "of the others, law proposed": [bool(row.proposed) for row in wanted],
        "variable right": [row.right_variable for row in wanted],
        f"form right or in a set of {SET}": [row.right_form for row in wanted],
        f"closes {100 * CLOSED:.0f} % of what the truth closes": [row.enough for row in wanted],
    }.items():
        lines.append(f"\n{words}: {sum(values)} of {len(values)}")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Leave each effect out of the catalogue and look for its law.")
    parser.add_argument("--set", choices=sorted(SETS), required=True, help="seeds for tuning, or for reported figures")
    parser.add_argument("--only", nargs="+", choices=sorted(REMOVED), metavar="ID", help="only these effects")
    parser.add_argument("--out", type=Path, required=True, help="folder of cases and answers")
    parser.add_argument("--tool", default="", help="command to run instead of ehsa-ctrl")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=900.0, help="limit for one diagnosis [s]")
    options = parser.parse_args(arguments)
    beside = shutil.which("ehsa-ctrl", path=str(Path(sys.executable).parent)) or "ehsa-ctrl"
    tool = shlex.split(options.tool) or [beside]
    options.out.mkdir(parents=True, exist_ok=True)
    answers = options.out / "answers"

    def one(id: str) -> str:
        name = case_of(options.set, id, options.out)
        done = [(answers / id / file).exists() for file in ("diagnosis.json", "failed.txt")]
        if name and not any(done):
            shutil.copyfile(options.out / f"{name}.json", options.out / f"{id}.json")
            diagnose(tool, options.out, id, answers, options.timeout, options_of(id))
        return name

    wanted = options.only or list(REMOVED)
    names = Parallel(options.jobs, prefer="threads", verbose=1)(delayed(one)(id) for id in wanted)
    rows = []
    for id, name in zip(wanted, names, strict=True):
        file = answers / id / "diagnosis.json"
        if file.exists():
            key = json.loads((options.out / "keys" / f"{name}.json").read_text())
            rows.append(score_answer(id, key, json.loads(file.read_text())))
        else:
            print(f"{id}: {f'failed, see {file.parent}' if name else 'no case with a large gap was drawn'}")
    print(table(rows))


if __name__ == "__main__":
    main()
