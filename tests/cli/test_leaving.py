"""How the command line ends where nobody reads on, and where it is interrupted."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import ehsa_ctrl

CALL = [sys.executable, "-c", "from ehsa_ctrl.cli.main import main; main()"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="pipes as a Unix shell has them")
@pytest.mark.parametrize(
    "arguments", [("list", "plants"), ("list", "effects", "--json"), ("--help",), ("new", "plant")]
)
def test_a_reader_that_leaves_is_no_failure(tmp_path, arguments):
    """As `| head -1` does: status 0, not the 1 of a limit that failed, and nothing on standard error."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([*CALL, *arguments], cwd=tmp_path, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)

    assert done.returncode == 0
    assert done.stderr == b""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("arguments", [("list", "plants"), ("list", "effects", "--json"), ("--help",), ("list", "nix")])
def test_an_output_that_cannot_be_written_is_one_sentence(tmp_path, arguments):
    """A full disk behind standard output: status 2; behind standard error: the status alone says it."""
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*CALL, *arguments], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
        silent = subprocess.run([*CALL, "list", "nix"], cwd=tmp_path, stdout=full, stderr=full, check=False)

    assert done.returncode == silent.returncode == 2
    if "nix" not in arguments:
        assert done.stderr == "ehsa-ctrl: the output can't be written (No space left on device)\n"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="a Unix shell closes them")
@pytest.mark.parametrize(("closed", "status"), [(">&-", 0), (">&- 2>&-", 0), ("<&- >&-", 0), ("nix 2>&-", 2)])
def test_a_closed_output_is_no_failure(tmp_path, closed, status):
    """Nothing is said where nobody listens, and no file that is written gets the output's number."""
    shell = f"{shlex.join(CALL)} list plants" if status == 0 else f"{shlex.join(CALL)} list"
    done = subprocess.run(f"{shell} {closed}", shell=True, cwd=tmp_path, capture_output=True, check=False)

    assert (done.returncode, done.stderr) == (status, b"")


@pytest.mark.slow
def test_colour_is_for_terminals_alone(tmp_path):
    """No escape sequence in a file or a pipe."""
    for arguments in (["list", "plants"], ["--help"], ["new", "plant"], ["run", "no_such"]):
        done = subprocess.run([*CALL, *arguments], cwd=tmp_path, capture_output=True, check=False)
        assert b"\x1b" not in done.stdout + done.stderr


def _heed_interrupts():
    """Tests that a shell runs in the background ignore SIGINT, and hand that on to what they start."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="SIGINT as Ctrl-C sends it")
def test_an_interrupted_campaign_says_what_is_kept_and_goes_on(tmp_path):
    """Ctrl-C after some runs: status 130, one sentence; the same call does the rest and ends as if nothing had been."""
    call = [*CALL, "montecarlo", "spread_steps", "--runs", "200", "--out", "mc"]
    file = tmp_path / "mc" / "spread_steps.jsonl"
    with subprocess.Popen(
        call, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_interrupts
    ) as running:
        while not (file.is_file() and len(file.read_text().splitlines()) > 5):
            assert running.poll() is None
            time.sleep(0.02)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=120)
        first = len(file.read_text().splitlines()) - 1

    assert running.returncode == 130, err
    assert err.strip().splitlines()[-1].startswith("ehsa-ctrl: interrupted; finished runs are kept in mc")
    assert "Traceback" not in err
    assert first < 200
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert len(file.read_text().splitlines()) == 201


@pytest.mark.parametrize(
    ("work", "call"),
    [
        ("ehsa_ctrl.scenario.run.run_one", ("run", "force_step", "--out", "there")),
        ("ehsa_ctrl.identification.identify.identify", ("identify", "log.csv", "--plant", "ehsa", "--out", "there")),
        ("ehsa_ctrl.diagnosis.diagnose.diagnose", ("diagnose", "log.csv", "--plant", "ehsa", "--out", "there")),
        ("ehsa_ctrl.identification.comparison.replay", ("compare", "log.csv", "--plant", "ehsa", "--json")),
    ],
)
def test_an_interrupt_says_what_is_kept(run, monkeypatch, tmp_path, work, call):
    """Ctrl-C in the long work: status 130, one sentence, nothing for a program to read and no empty folder."""
    plant = ehsa_ctrl.load_plant("ehsa")
    log, _ = ehsa_ctrl.record(plant, *ehsa_ctrl.excitation("noise", amplitude=3, duration=4), centre=True)
    log.write(tmp_path / "log.csv")

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(work, interrupted)
    status, out, err = run(*call)

    assert status == 130 and out == ""
    assert err.splitlines()[-1].startswith("ehsa-ctrl: interrupted; ") and "kept" in err
    assert not (tmp_path / "there").exists()


@pytest.mark.parametrize(
    ("work", "call", "kept"),
    [
        (
            "ehsa_ctrl.report.figures.save",
            ("montecarlo", "spread_steps", "--runs", "4", "--out", "there"),
            "finished runs are kept in there; the same command continues with the others",
        ),
        (
            "ehsa_ctrl.diagnosis.batch.LogBatch.to_pandas",
            ("diagnose", "log.csv", "second.csv", "--plant", "ehsa", "--out", "there"),
            "finished logs are kept in there; the same command continues with the others",
        ),
        (
            "ehsa_ctrl.fleet.result.Fleet.to_dict",
            ("fleet", "logs", "--plant", "ehsa", "--out", "there"),
            "finished logs are kept in there; the same command continues with the others",
        ),
    ],
)
def test_an_interrupt_after_the_long_work_says_what_is_kept(run, monkeypatch, tmp_path, work, call, kept):
    """Ctrl-C while the result is written, with all runs finished: the sentence speaks of them."""
    plant = ehsa_ctrl.load_plant("ehsa")
    log, _ = ehsa_ctrl.record(plant, *ehsa_ctrl.excitation("noise", amplitude=3, duration=4), centre=True)
    for name in ("log.csv", "second.csv", "logs/a/2026-01-01.csv", "logs/a/2026-01-02.csv"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        log.write(tmp_path / name)

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(work, interrupted)
        status, _, err = run(*call)

    assert status == 130
    assert err.splitlines()[-1] == f"ehsa-ctrl: interrupted; {kept}"
    status, _, err = run(*call)
    assert status == 0, err


@pytest.mark.slow
def test_no_color_is_kept(tmp_path):
    """NO_COLOR takes colours away even where they are asked for."""
    asked = os.environ | {"FORCE_COLOR": "1"}
    colour = rb"\x1b\[(1;)?[349][0-7]m"
    plain, coloured = (
        subprocess.run([*CALL, "--help"], cwd=tmp_path, capture_output=True, env=asked | more, check=False).stdout
        for more in ({"NO_COLOR": "1"}, {"NO_COLOR": ""})
    )

    assert re.search(colour, coloured) and not re.search(colour, plain)
