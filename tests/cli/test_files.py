"""Every command that writes: a user's files survive, and an old result is there until the new one is."""

import errno
import json
import shutil
import sys
from pathlib import Path

import pytest

import ehsa_ctrl
from ehsa_ctrl.cli import main as entry

#: Call without --out of each command that writes a folder; those that are quick first.
CALLS = {
    "simulate": ("simulate", "ehsa", "--excitation", "sine", "--duration", "0.2"),
    "export": ("export", "pid_position"),
    "fmu": ("fmu", "ehsa"),
    "report": ("report", "../bench"),
    "analyse": ("analyse", "ehsa", "--controller", "pid_position"),
    "design": ("design", "ehsa", "--kind", "pid"),
    "compare": ("compare", "../bench/log.csv", "--plant", "ehsa", "--model", "nonlinear"),
    "montecarlo": ("montecarlo", "spread_steps", "--runs", "2"),
    "run": ("run", "force_step", "--no-assumed"),
    "excite": ("excite", "ehsa", "--duration", "4", "--kind", "steps", "--rehearsals", "0"),
    "identify": ("identify", "../bench/log.csv", "--plant", "ehsa", "--model", "linear", "--method", "balances"),
    "diagnose": ("diagnose", "../bench/log.csv", "--plant", "ehsa", "--set", "K_T=1.3"),
    "diagnose_batch": ("diagnose", "../bench/log.csv", "../bench/other.csv", "--plant", "ehsa", "--jobs", "1"),
}
QUICK = ("export", "fmu", "report")
COMMANDS = [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CALLS]
#: These go on with what is there, so that a second call is none that is refused.
CONTINUED = ("montecarlo", "diagnose_batch")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The result of a command, made once."""
    base, done = tmp_path_factory.mktemp("made"), {}
    (base / "bench").mkdir()
    rig = ehsa_ctrl.load_plant("ehsa")
    time, current = ehsa_ctrl.excitation("noise", amplitude=3, duration=4)
    log, _ = ehsa_ctrl.record(rig, time, current, centre=True)
    for name in ("log.csv", "other.csv"):
        log.write(base / "bench" / name)
    (base / "bench" / "simulation.json").write_text(json.dumps(SIMULATION))

    def make(command):
        if command not in done:
            with pytest.MonkeyPatch.context() as patched:
                (base / "work").mkdir(exist_ok=True)
                patched.chdir(base / "work")
                patched.setattr(sys, "argv", ["ehsa-ctrl", *CALLS[command], "--out", command])
                with pytest.raises(SystemExit) as stopped:
                    entry.main()
                assert stopped.value.code in (0, None)
            done[command] = base / "work" / command
        return base, done[command]

    return make


#: What `report` needs to find a result.
SIMULATION = {
    "plant": "ehsa", "model": "nonlinear", "settings": {}, "input": "sine", "seed": 0, "samples": 51,
    "sample_time": 0.004, "stopped": "", "limits_passed": [], "pressure_level_drift": 0.0, "provenance": {},
    "log": "log.csv", "rests_on": {},
}  # fmt: skip


@pytest.fixture
def place(made, tmp_path, monkeypatch, run, capsys):
    """A folder to call a command in, beside the logs that it reads; its earlier result is in `out` if wanted."""

    def prepare(command, *, earlier):
        base, result = made(command)
        capsys.readouterr()
        shutil.copytree(base / "bench", tmp_path / "bench")
        (tmp_path / "work").mkdir()
        monkeypatch.chdir(tmp_path / "work")
        if earlier:
            shutil.copytree(result, "out")
        return sorted(path.relative_to(result).as_posix() for path in result.rglob("*") if path.is_file())

    return prepare


def content(folder):
    """Every file in a folder, hidden ones too, by its path."""
    return {path.relative_to(folder): path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_users_file_survives_under_every_name(run, place, command):
    """--force or not: refused in a sentence that names it, status 2, nothing else written but what was kept apart."""
    for name in place(command, earlier=False):
        if name.endswith(".jsonl") or ".ehsa_ctrl-" in name:
            continue
        mine = Path("out") / name
        mine.parent.mkdir(parents=True)
        mine.write_text("mine")
        status, out, err = run(*CALLS[command], "--out", "out", "--force")

        assert status == 2 and out == ""
        assert err.splitlines()[-1].startswith(f"ehsa-ctrl: {mine}: is not listed as written by")
        assert mine.read_text() == "mine" and not list(Path("out").glob(".*"))
        shutil.rmtree("out")


@pytest.mark.parametrize("command", COMMANDS)
def test_only_force_replaces_a_result_and_only_its_own_files(run, place, command):
    """Again and again, beside a file of the user's; an edited file is refused and stays."""
    names = place(command, earlier=True)
    (Path("out") / "notes.txt").write_text("mine")
    before = content("out")
    if command not in CONTINUED:
        status, _, err = run(*CALLS[command], "--out", "out")
        assert status == 2 and "is part of an earlier result; choose another folder or use --force" in err
        assert content("out") == before
    assert run(*CALLS[command], "--out", "out", "--force")[0] == 0
    assert content("out").keys() == before.keys()

    edited = next(name for name in names if name in MAIN)
    (Path("out") / edited).write_text("edited")
    status, _, err = run(*CALLS[command], "--out", "out", "--force")
    assert status == 2 and f"out/{edited}: was edited since" in err
    assert (Path("out") / edited).read_text() == "edited"


#: A file of each command that a user may edit.
MAIN = {
    "log.csv", "controller.c", "ehsa.fmu", "overview.html", "analysis.json", "design.json", "comparison.json",
    "montecarlo.json", "results.json", "current.csv", "identification.json", "diagnosis.json", "summary.csv",
}  # fmt: skip


@pytest.mark.parametrize("stop", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()], ids=type)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk_or_an_interrupt_leaves_the_old_result(run, place, monkeypatch, command, stop):
    """Status 2 or 130, one sentence, the same files as before and no draft; where there was no result, no folder."""
    place(command, earlier=True)
    before = content("out")

    def stopped(*_, **__):
        raise stop

    monkeypatch.setattr(Path, "write_text", stopped)
    for out in ("out", "new/folder"):
        status, said, err = run(*CALLS[command], "--out", out, "--force")

        assert status == (130 if isinstance(stop, KeyboardInterrupt) else 2), err
        assert "Traceback" not in err and err.splitlines()[-1].startswith("ehsa-ctrl: ")
        assert isinstance(stop, KeyboardInterrupt) or "can't be written (No space left on device)" in err
        assert "written to" not in said
    assert content("out") == before
    assert not Path("new").exists()


@pytest.mark.parametrize("kind", ["plant", "controller", "scenario"])
def test_a_new_definition_is_whole_or_not_there(run, tmp_path, monkeypatch, kind):
    """A full disk leaves neither a cut file nor a folder, and an old file as it was."""
    (old,) = [tmp_path / f"{kind}s" / "mine.toml"]
    assert run("new", kind, "mine")[0] == 0
    before = old.read_bytes()
    write = Path.write_text

    def cut(self, text, **options):
        write(self, text[: len(text) // 2], **options)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", cut)
    status, _, err = run("new", kind, "mine", "--force")
    assert status == 2 and err == f"ehsa-ctrl: {kind}s/mine.toml: can't be written (No space left on device)\n"
    assert old.read_bytes() == before and list(old.parent.iterdir()) == [old]
    monkeypatch.chdir(tmp_path / f"{kind}s")
    assert run("new", kind, "other")[0] == 2
    assert list(old.parent.iterdir()) == [old]


def test_two_commands_in_one_folder_say_so(run, tmp_path):
    """What the other one has written stays; `report` has a name of its own."""
    assert run(*CALLS["simulate"], "--out", "out")[0] == 0
    before = content("out")
    status, _, err = run(*CALLS["analyse"], "--out", "out", "--force")

    assert status == 2
    assert err.endswith("out/report.html: belongs to the result of simulate in this folder; choose another folder\n")
    assert content("out") == before
    assert run("report", "out")[0] == run("report", "out", "--force")[0] == 0


@pytest.mark.slow
def test_the_time_series_of_a_run_is_a_log(run, tmp_path):
    """Of each run one CSV, named in the answer; it is read as a log is, with the true signals of both models beside."""
    status, out, _ = run("run", "steps_spring", "--no-assumed", "--out", "out")
    file = tmp_path / "out" / "steps_spring-pid_position.csv"
    log = ehsa_ctrl.read_log(file, ["current", "speed", "p1", "p2", "position", "force"])

    assert status == 0 and "time series:" in out and file.name in "".join(out.split())
    assert file.name in json.loads((tmp_path / "out" / "results.json").read_text())["files"]
    header = file.read_text().splitlines()[0].split(",")
    assert {"reference", "x_linear", "x_nonlinear", "P_1_nonlinear"} <= set(header)
    loaded = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    assert ehsa_ctrl.replay(loaded, log).fit_percent["speed"] > 90.0


@pytest.mark.slow
def test_a_campaign_begun_anew_loses_nothing_before_its_first_run(run, tmp_path, monkeypatch):
    """--force, and interrupted at once: runs, figures and page are there as they were; a file of the user's stays."""
    assert run(*CALLS["montecarlo"], "--out", "out")[0] == 0
    before = content("out")

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("ehsa_ctrl.scenario.montecarlo._run_one", interrupted)
        assert run(*CALLS["montecarlo"], "--seed", "1", "--out", "out", "--force")[0] == 130
    assert content("out") == before
    assert run(*CALLS["montecarlo"], "--seed", "1", "--out", "out", "--force")[0] == 0
    assert content("out").keys() == before.keys() and content("out") != before

    file = tmp_path / "out" / "spread_steps.jsonl"
    file.write_text("mine")
    status, _, err = run(*CALLS["montecarlo"], "--out", "out", "--force")
    assert status == 2 and "is not a file of a Monte Carlo campaign" in err and file.read_text() == "mine"


@pytest.mark.slow
def test_diagnoses_go_on_beside_a_result_that_was_killed(run, place, tmp_path):
    """A log whose files are there and whose row is not, as a kill leaves it, is diagnosed again."""
    place("diagnose_batch", earlier=True)
    before = content("out")
    file = Path("out/diagnoses.jsonl")
    file.write_text("".join(line + "\n" for line in file.read_text().splitlines()[:-1]))

    assert run(*CALLS["diagnose_batch"], "--out", "out")[0] == 0
    assert content("out").keys() == before.keys() and len(file.read_text().splitlines()) == 3


def test_an_old_result_without_a_list_of_its_files_is_refused_by_name(run, tmp_path):
    """From before there was one: nothing proves that the files are not the user's."""
    assert run(*CALLS["simulate"], "--out", "out")[0] == 0
    (tmp_path / "out" / ".ehsa_ctrl-simulate.json").unlink()
    before = content("out")
    status, _, err = run(*CALLS["simulate"], "--out", "out", "--force")

    assert status == 2 and "out/log.csv: is not listed as written by simulate" in err
    assert content("out") == before
