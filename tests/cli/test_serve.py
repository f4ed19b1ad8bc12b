"""`ehsa-ctrl serve` as a user meets it: two processes on the loopback, and what goes wrong."""

import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pandas
import pytest

import ehsa_ctrl

CALL = [sys.executable, "-c", "from ehsa_ctrl.cli.main import main; main()", "serve"]
#: A busy machine needs long until a process has loaded what it runs.
PATIENCE = ("--patience", "300")


@pytest.fixture
def start(tmp_path):
    """Starts a side as a process that heeds Ctrl-C; none outlives the test."""
    sides = []

    def begin(*arguments):
        side = subprocess.Popen(
            [*CALL, *arguments, *PATIENCE], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )  # fmt: skip
        sides.append(side)
        return side

    yield begin
    for side in sides:
        side.kill()
        side.communicate()


def waits_at(side):
    """Port at which the controller's side listens, once it waits."""
    heard = side.stderr.readline()
    while "waits for readings" not in heard:  # a line before it says what is compiled
        assert heard, side.communicate()
        heard = side.stderr.readline()
    return re.search(r"port (\d+)", heard)[1]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as Ctrl-C sends them")
def test_two_processes_are_the_direct_run_to_the_bit(start, tmp_path):
    """Lock-step: every signal of the loop; both sides exit with 0 and write what they saw."""
    scenario = ("--scenario", "hold_under_load")
    side = start("--controller", "lqi_position", "--port", "0", "--out", "there", *scenario)
    plant = start("--plant", "ehsa", "--port", waits_at(side), "--out", "here", "--json", *scenario)
    out, err = plant.communicate(timeout=300)
    _, theirs = side.communicate(timeout=60)
    direct = ehsa_ctrl.run("hold_under_load", controller="lqi_position").nonlinear.to_pandas()
    assert (plant.returncode, side.returncode) == (0, 0), err + theirs
    table = pandas.read_csv(tmp_path / "here" / "loop.csv")
    rows = pandas.read_csv(tmp_path / "there" / "samples.csv")

    for name in table.columns:
        np.testing.assert_array_equal(table[name], direct[name])
    np.testing.assert_array_equal(rows["current"], direct["asked"])
    result = json.loads(out)
    assert result["samples"] == len(direct) and result["packets"]["lost"] == 0 and result["tripped"] == ""
    assert sum(result["latencies"][0]["counts"]) == len(direct)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as Ctrl-C sends them")
def test_ctrl_c_ends_both_sides_with_a_summary(start, tmp_path):
    """The plant's side writes the samples so far; the controller's side hears that it left."""
    side = start("--controller", "pid_position", "--period", "0.02", "--port", "0")
    plant = start("--plant", "ehsa", "--port", waits_at(side), "--period", "0.02", "--out", "here")
    assert "answers 127.0.0.1 port" in side.stderr.readline()
    time.sleep(1.0)
    plant.send_signal(signal.SIGINT)
    out, err = plant.communicate(timeout=60)
    theirs, _ = side.communicate(timeout=60)
    table = pandas.read_csv(tmp_path / "here" / "loop.csv")

    assert plant.returncode == 130 and "Traceback" not in err
    samples = int(re.search(r"plant: (\d+) samples in real time, 20 ms a sample; interrupted", out)[1])
    assert len(table) == samples > 5 and f"interrupted; after {samples} samples" in err
    # 1: on a busy machine a sample came late and the safe current acted.
    assert side.returncode in (0, 1) and "the plant's side ended the run" in theirs


WRONG = {
    (): "give either --plant P, to simulate the plant here, or --controller C",
    ("--plant", "ehsa", "--controller", "pid_position"): "give either --plant P",
    ("--plant", "ehsa", "--port", "0"): "port 0; expected the port at which the controller listens, 1 to 65535",
    ("--plant", "ehsa", "--period", "0"): "--period 0: expected more than 0 s and at most an hour",
    ("--plant", "ehsa", "--design", "ehsa"): "--design is for --controller",
    ("--plant", "nix"): "nix",
    ("--controller", "pid_position", "--set", "K_T=1"): "give them on the plant's side",
    ("--controller", "pid_position", "--address", "203.0.113.1"): "203.0.113.1:47400: can't listen there",
    ("--controller", "pid_position", "--port", "0", "--patience", "0.1"): "no readings within 0.1 s; start the plant's",
}


@pytest.mark.parametrize("arguments", WRONG)
def test_wrong_input_is_a_sentence(run, arguments):
    status, out, err = run("serve", *arguments)

    assert (status, out) == (2, "")
    assert WRONG[arguments] in err and "Traceback" not in err


def test_the_safe_current_is_part_of_a_definition(run, tmp_path):
    """Of a plant with unit and source, of a controller with its limit."""
    assert ehsa_ctrl.load_plant("ehsa").watchdog.timeout == 0.04
    pid = {"kind": "pid", "current_limit": "2 A", "gains": {"k_p": "600 A/m"}}
    system = ehsa_ctrl.three_state("ehsa")
    own = ehsa_ctrl.load_controller({**pid, "watchdog": {"timeout": "8 ms", "safe_current": "-1 A"}}, system)

    assert (own.watchdog.timeout, own.watchdog.safe_current) == (0.008, -1.0)
    with pytest.raises(ehsa_ctrl.InputError, match=r"safe_current = 3 exceeds current_limit = 2 of the drive"):
        ehsa_ctrl.load_controller({**pid, "watchdog": {"safe_current": "3 A"}}, system)
