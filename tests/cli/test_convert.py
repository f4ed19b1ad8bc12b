"""`ehsa-ctrl convert` as a user meets it."""

import json

import numpy as np
import pandas
import pytest

from ehsa_ctrl.core.log_reader import read_log

TIME = 0.004 * np.arange(200)
MAPPED = '\n[log]\nt = { column = "ms", scale = 1e-3 }\ncurrent = { column = "i" }\nspeed = { column = "n_rpm" }\n'


@pytest.fixture
def rig(run, tmp_path):
    """A plant with a [log], and a CSV as its rig writes it: ms, rpm in a row of units."""
    assert run("new", "plant", "rig")[0] == 0
    file = tmp_path / "plants" / "rig.toml"
    file.write_text(file.read_text() + MAPPED)
    table = pandas.DataFrame({"ms": 1e3 * TIME, "i": np.sin(TIME), "n_rpm": 60 * TIME, "oil": 40.0})
    text = table.to_csv(index=False).replace("oil\n", "oil\nms,A,rpm,-\n", 1)
    (tmp_path / "rig.csv").write_text(text)
    return tmp_path


@pytest.mark.parametrize("ending", ["parquet", "csv", "mat"])
def test_a_rigs_log_becomes_one_in_si_units(run, rig, ending):
    """Names and units of the channels; it is read back without a mapping."""
    status, out, err = run("convert", "rig.csv", f"log.{ending}", "--plant", "rig")

    assert status == 0 and "200 samples from 0 to 0.796 s, 250 Hz: current, speed" in out
    assert "note: rig.csv: converted by its row of units" in err
    log = read_log(rig / f"log.{ending}", ["current", "speed"])
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)
    np.testing.assert_allclose(log["speed"], 2 * np.pi * TIME, atol=1e-4)
    assert set(log.channels) == {"current", "speed"}


def test_nothing_is_replaced_unasked(run, rig):
    """An existing file stays without --force, the log itself stays with it."""
    (rig / "log.csv").write_text("mine")

    status, _, err = run("convert", "rig.csv", "log.csv", "--plant", "rig")
    assert status == 2 and "log.csv: already exists; choose another name or use --force" in err
    assert (rig / "log.csv").read_text() == "mine"
    assert run("convert", "rig.csv", "log.csv", "--plant", "rig", "--force")[0] == 0
    before = (rig / "rig.csv").read_bytes()
    status, _, err = run("convert", "rig.csv", "./rig.csv", "--plant", "rig", "--force")
    assert status == 2 and "is the log itself" in err and (rig / "rig.csv").read_bytes() == before


def test_the_contents_of_a_file_are_listed(run, rig):
    """Columns with units, and the rate by the plant's time; as JSON, too."""
    status, out, _ = run("convert", "rig.csv", "--plant", "rig")

    assert status == 0 and out.startswith(
        "rig.csv: CSV, 1 group\n  columns: 200 samples, 250 Hz, 0.796 s by column 'ms'"
    )
    assert "    n_rpm [rpm]\n    oil\n" in out
    (group,) = json.loads(run("convert", "rig.csv", "--json")[1])["groups"]
    assert group["columns"] == {"ms": "ms", "i": "A", "n_rpm": "rpm", "oil": ""} and group["step"] is None


def test_the_log_is_resampled_and_cut_on_request(run, rig):
    """Without a plant, from a log with the channels' own names."""
    assert run("convert", "rig.csv", "log.parquet", "--plant", "rig")[0] == 0
    call = ("convert", "log.parquet", "half.csv", "--resample", "125", "--from", "0.2", "--json")
    result = json.loads(run(*call)[1])

    assert result["sample_time"] == pytest.approx(0.008) and result["channels"] == ["current", "speed"]
    assert [step["kind"] for step in result["preparation"]] == ["resample", "segment"]
    assert read_log(rig / "half.csv", ["current"]).time[0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (("rig.csv", "log.xlsx"), "log.xlsx: is not a kind of file that is written; expected one of .parquet"),
        (("none.csv", "log.csv"), "none.csv: no such file"),
        (("rig.csv", "log.csv"), "rig.csv: has no column 't'; known: i, ms, n_rpm, oil"),
        (("rig.csv", "log.csv", "--sample-time", "0.004"), "write current = { column = \"i\" }, speed = { column"),
        (("rig.csv", "log.csv", "--plant", "rig", "--resample", "-5"), "the rate must be a number greater than 0"),
        (("rig.csv", "log.csv", "--plant", "rig", "--resample", "1e12"), "expected 25 to 10000000"),
        (("rig.csv", "log.csv", "--plant", "rig", "--sample-time", "0"), "sample time of 0 s: must be a number"),
        (("rig.csv", "log.csv", "--plant", "rig", "--from", "9"), "there are 0 samples; expected at least 25"),
    ],
)  # fmt: skip
def test_wrong_input_is_a_sentence_and_writes_nothing(run, rig, call, said):
    """Exit status 2, and no file."""
    status, _, err = run("convert", *call)

    assert status == 2 and said in " ".join(err.split())
    assert not (rig / "log.csv").exists()
