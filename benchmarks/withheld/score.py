"""Run the diagnosis on every case through the command line, and score its answers against the key.

python benchmarks/withheld/score.py results/withheld/reported --jobs 2
python benchmarks/withheld/score.py results/withheld/reported --answers some/folder --no-run

Without key.json in the folder the answers are printed and not scored.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from answer_score import score_answer
from failures import failure_table
from joblib import Parallel, delayed
from key_formats import read_key
from score_files import table, write
from score_statistics import sections


def settings_of(model_settings: dict[str, Any]) -> dict[str, float]:
    """What is set in the nominal plant of a case."""
    settings = dict(model_settings.get("set") or {})
    if model_settings.get("spring_stiffness"):
        settings["load.stiffness"] = model_settings["spring_stiffness"]
    return settings


def command(tool: Sequence[str], model_settings: dict[str, Any], out: Path) -> list[str]:
    """The command line for a log and its nominal model."""
    line = [*tool, "diagnose", "log.csv", "--plant", model_settings["plant"], "--model", model_settings["model"]]
    if model_settings.get("validate"):
        line += ["--validate", "validate.csv"]
    for name, value in settings_of(model_settings).items():
        line += ["--set", f"{name}={value!r}"]
    return [*line, "--out", str(out)]


def diagnose(
    tool: Sequence[str], cases: Path, name: str, answers: Path, timeout: float, more: Sequence[str] = ()
) -> None:
    """Write one answer to answers/NAME/, or failed.txt with the reason. The tool sees only copies of the logs.

    more: further options.
    """
    target = answers / name
    model_settings = json.loads((cases / f"{name}.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        shutil.copyfile(cases / model_settings["log"], Path(folder, "log.csv"))
        if model_settings.get("validate"):
            shutil.copyfile(cases / model_settings["validate"], Path(folder, "validate.csv"))
        line = [*command(tool, model_settings, Path(folder, "out")), *more]
        try:
            done = subprocess.run(line, cwd=folder, capture_output=True, text=True, timeout=timeout)
            why = "" if done.returncode == 0 else f"exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
        except subprocess.TimeoutExpired:
            why = f"no answer within {timeout:g} s"
        target.mkdir(parents=True, exist_ok=True)
        answer = Path(folder, "out", "diagnosis.json")
        if not why and not answer.exists():
            why = "no diagnosis.json was written"
        if why:
            (target / "failed.txt").write_text(f"{shlex.join(line)}\n{why}\n")
        else:
            (target / "failed.txt").unlink(missing_ok=True)
            shutil.copyfile(answer, target / "diagnosis.json")


def case_names(cases: Path) -> list[str]:
    """Names of the cases in a folder without a key."""
    return [file.stem for file in cases.glob("*.json") if "log" in json.loads(file.read_text())]


def verdict_lines(answers: Path, names: Sequence[str]) -> list[str]:
    """Verdict and named effects, one line per case."""
    lines = []
    for name in names:
        file = answers / name / "diagnosis.json"
        answer = json.loads(file.read_text()) if file.exists() else {"verdict": "failed", "effects": []}
        causes = [" or ".join([e["id"], *e["ambiguous_with"]]) for e in answer["effects"]]
        lines.append(f"{name} {answer['verdict']:<18} {' + '.join(causes)}")
    return lines


def read_answers(answers: Path, names: Sequence[str]) -> dict[str, dict[str, Any] | None]:
    """The diagnosis.json of each case, None without one."""
    files = {name: answers / name / "diagnosis.json" for name in names}
    return {name: json.loads(file.read_text()) if file.exists() else None for name, file in files.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Score `ehsa-ctrl diagnose` on logs whose effect is withheld.")
    parser.add_argument("cases", type=Path, help="folder of cases.py, or another with NAME.csv, NAME.json and key.json")
    parser.add_argument("--answers", type=Path, help="folder of the answers (default: CASES/answers)")
    parser.add_argument("--no-run", action="store_true", help="score the existing answers without running the tool")
    parser.add_argument("--retry", action="store_true", help="repeat diagnoses that failed before")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="run only these cases")
    parser.add_argument("--tool", default="", help="command to run instead of ehsa-ctrl")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=600.0, help="limit for one diagnosis [s]")
    options = parser.parse_args(arguments)
    answers = options.answers or options.cases / "answers"
    keyed = (options.cases / "key.json").exists()
    known = json.loads((options.cases / "key.json").read_text()) if keyed else case_names(options.cases)
    names = options.only or sorted(known)
    if not options.no_run:
        beside = shutil.which("ehsa-ctrl", path=str(Path(sys.executable).parent)) or "ehsa-ctrl"
        tool = shlex.split(options.tool) or [beside]
        due = [
            name
            for name in names
            if not (answers / name / "diagnosis.json").exists()
            and (options.retry or not (answers / name / "failed.txt").exists())
        ]
        print(f"{len(due)} of {len(names)} cases to run")
        Parallel(options.jobs, prefer="threads", verbose=1)(
            delayed(diagnose)(tool, options.cases, name, answers, options.timeout) for name in due
        )
    if not keyed:
        print("\n".join(verdict_lines(answers, names)))
        return
    keys, given = read_key(options.cases / "key.json"), read_answers(answers, names)
    rows = [score_answer(name, keys[name], given[name]) for name in names]
    figures, failures = sections(rows), failure_table(rows, keys, given)
    write(rows, figures, failures, answers)
    print(f"{table(figures)}\n\n{failures}")


if __name__ == "__main__":
    main()
