"""`ehsa-ctrl diagnose --out` leaves the proposed experiment's current, and says how to apply it."""

import shlex
from pathlib import Path

import numpy as np
import pandas
import pytest

from ehsa_ctrl.cli.diagnose import next_lines
from ehsa_ctrl.diagnosis.next_experiment import FILE, NextExperiment


def experiment(command):
    return NextExperiment(
        words="drive it", command=command, drive="current",
            current=np.sin(np.arange(100) / 10), sample_time=0.004, amplitude=1.0,
        centre=False, load={}, distance={("a", "b"): 6.0}, now={}, alike=(), tried={},
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("options", [f"--input {FILE}", "--excitation noise --amplitude 1"])
def test_the_command_that_is_printed_finds_the_file_that_is_written(run, tmp_path, options):
    """Run as it stands, it makes the log of the proposed current."""
    found = experiment(f"ehsa-ctrl simulate ehsa {options} --out results/next")
    (tmp_path / "d").mkdir()
    found.write(Path("d") / FILE)
    told, command = next_lines(found, Path("d"))

    assert str(Path("d") / FILE) in told
    np.testing.assert_allclose(pandas.read_csv(tmp_path / "d" / FILE)["current"], found.current, atol=1e-6)
    status, _, err = run(*shlex.split(command)[1:])
    assert status == 0, err
    assert (tmp_path / "d" / "next" / "log.csv").is_file()


def test_without_a_folder_the_command_is_only_said_where_it_needs_no_file(tmp_path):
    """An input in a file is had with --out."""
    assert "--out" in next_lines(experiment(f"ehsa-ctrl simulate ehsa --input {FILE} --out x"), None)[0]
    assert "simulate ehsa --excitation" in next_lines(experiment("ehsa-ctrl simulate ehsa --excitation a"), None)[1]
    assert next_lines(None, tmp_path) == []
