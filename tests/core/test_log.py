"""Reading measured logs; errors name file, column and row."""

import numpy as np
import pandas
import pytest
from scipy.io import savemat

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import CHANNELS, Column, Log
from ehsa_ctrl.core.log_reader import read_log
from ehsa_ctrl.core.unit import factor


def write(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize("channel", CHANNELS)
def test_every_channel_has_an_si_unit(channel):
    """Every channel's unit is an SI unit."""
    assert factor(CHANNELS[channel].unit, CHANNELS[channel].unit) == 1.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,curent\n0,1\n0.1,1\n", r"no column 'current'; did you mean 'curent'"),
        ("t,current\n0,1\n0.1,nan\n0.2,1\n", r"column 'current', row 3: 'nan' is not a finite number"),
        ("t,current\n0,1\n0.1,abc\n0.2,1\n", r"column 'current', row 3: 'abc' is not a finite number"),
        ("t,current\n0,1\n0.1,inf\n0.2,1\n", r"column 'current', row 3: 'inf' is not a finite number"),
        ("t,current\n0,1\n0.1,\n0.2,1\n", r"column 'current', row 3: the cell is empty"),
        (
            't,current\n0,1\n0.1,"1,5"\n0.2,1\n',
            r"row 3: '1,5' is not a finite number; write decimals with a point, 1.5",
        ),
        ("t,current\n0,1\n\n0.2,1\n", r"row 3 is empty; every row needs 2 numbers"),
        ("t,current\n0,1\n0.1\n0.2,1\n", r"row 3 has 1 cells, but the header has 2: a cell is missing"),
        ("t,current\n0,1\n0.1,1,5\n0.2,1\n", r"row 3 has 3 cells, but the header has 2.*comma"),
        ("t,current\n0,0,1,5\n0,1,1,6\n", r"row 2 has 4 cells, but the header has 2.*comma"),
        ("t,current,current\n0,1,1\n0.1,1,1\n", r"row 1 names the column 'current' more than once"),
        ("t,current\n0,1\n0.1,1\n0.2,1\n0.5,1\n0.6,1\n", r"column 't', row 5: a gap of 0.3 s after 0.2 s"),
        ("t,current\n0,1\n0,1\n0,1\n", r"does not advance"),
        ("t,current\n0,1\n0.1,1\n0.2,1\n0.2,1\n0.3,1\n", r"row 5: 0.2 s comes after 0.2 s"),
        ("t,current\n0,1\n0.1,1\n0.25,1\n0.3,1\n0.45,1\n0.5,1\n", r"'t' jitters: 4 of 5 steps .* resample"),
        ("t,current\n0,1\n", r"has 1 rows of data; expected at least 2"),
        ("t,current\n", r"has 0 rows of data"),
        ("", r"is not a CSV table"),
    ],
)
def test_a_wrong_log_is_one_sentence(tmp_path, text, says):
    """Each message names the file and the place in it."""
    path = write(tmp_path / "u.csv", text)

    with pytest.raises(InputError, match=says) as caught:
        read_log(path, ["current"])

    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [bytes(range(256)) * 20, b"\x89PNG\r\n\x1a\n\x00\x00", b"t\0,current\n1,2\n3,4\n"])
@pytest.mark.parametrize("ending", ["csv", "mat", "parquet"])
def test_binary_rubbish_is_one_sentence(tmp_path, content, ending):
    """Any bytes with any ending."""
    path = tmp_path / f"u.{ending}"
    path.write_bytes(content)

    with pytest.raises(InputError, match=r"is not a (CSV|valid MAT|valid Parquet)") as caught:
        read_log(path, ["current"])

    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    """No pandas traceback for a missing file or a folder."""
    with pytest.raises(InputError, match="no such file"):
        read_log(tmp_path / "nothing.csv", ["current"])
    with pytest.raises(InputError, match="is a folder"):
        read_log(tmp_path, ["current"])


def test_a_byte_order_mark_and_blank_lines_at_the_end_are_no_mistake(tmp_path):
    """As spreadsheets write them."""
    path = write(tmp_path / "u.csv", "\ufefft,current\n0,1\n0.1,2\n\n\n")

    np.testing.assert_array_equal(read_log(path, ["current"])["current"], [1.0, 2.0])


CHANNEL_VALUES = {"t": 0.004 * np.arange(6), "current": np.linspace(-1, 1, 6), "p1": 2e6 + np.arange(6.0)}


@pytest.mark.parametrize("how", ["vectors", "structure", "columns"])
def test_a_mat_file_gives_the_same_log(tmp_path, how):
    """One vector a channel (row or column), or one structure of them."""
    values = {name: v[:, None] for name, v in CHANNEL_VALUES.items()} if how == "columns" else CHANNEL_VALUES
    savemat(tmp_path / "u.mat", {"log": values} if how == "structure" else {**values, "note": "first run"})

    log = read_log(tmp_path / "u.mat", ["current", "p1"])

    for name, expected in CHANNEL_VALUES.items():
        np.testing.assert_array_equal(log.time if name == "t" else log[name], expected)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"t": np.arange(5.0), "current": np.arange(4.0)}, "'current' has 4 values, but others have 5"),
        ({"a": {"t": np.arange(5.0)}, "b": {"t": np.arange(5.0)}}, "no column 'current'; known: a/t, b/t"),
        ({"note": "nothing"}, "it contains neither"),
        ({"t": np.arange(5.0), "current": np.array([0, 1, np.nan, 0, 0])}, "column 'current', row 3: 'nan'"),
    ],
)
def test_a_wrong_mat_file_is_one_sentence(tmp_path, content, says):
    """Lengths, structures, text."""
    savemat(tmp_path / "u.mat", content)

    with pytest.raises(InputError, match=says):
        read_log(tmp_path / "u.mat", ["current"])


def test_a_parquet_file_gives_the_same_log(tmp_path):
    """With time as a column, or as the index."""
    pytest.importorskip("pyarrow")
    frame = pandas.DataFrame(CHANNEL_VALUES)
    frame.to_parquet(tmp_path / "u.parquet")
    frame.set_index("t").to_parquet(tmp_path / "i.pq")

    for name in ("u.parquet", "i.pq"):
        log = read_log(tmp_path / name, ["current"])
        np.testing.assert_array_equal(log.time, CHANNEL_VALUES["t"])
        np.testing.assert_array_equal(log["current"], CHANNEL_VALUES["current"])


def test_dates_are_no_values(tmp_path):
    """A date is a time, but no current."""
    pytest.importorskip("pyarrow")
    dates = pandas.date_range("2024-01-01", periods=5, freq="4ms")
    pandas.DataFrame({"t": dates, "current": dates}).to_parquet(tmp_path / "u.parquet")

    with pytest.raises(InputError, match="column 'current' contains dates"):
        read_log(tmp_path / "u.parquet", ["current"])


def test_mapped_columns_are_scaled_shifted_and_turned(tmp_path):
    """SI value = scale * column + offset, for time too; what is not mapped keeps its own name."""
    path = write(tmp_path / "u.csv", "ms,rpm,p_bar_abs,current\n0,60,21,1\n4,-120,31,2\n8,0,1,3\n")
    columns = {"t": Column("ms", 1e-3), "speed": Column("rpm", -2 * np.pi / 60), "p1": Column("p_bar_abs", 1e5, -1e5)}

    log = read_log(path, ["current", "speed", "p1"], columns=columns)

    np.testing.assert_allclose(log.time, [0, 0.004, 0.008])
    np.testing.assert_allclose(log["speed"], [-2 * np.pi, 4 * np.pi, 0])
    np.testing.assert_allclose(log["p1"], [2e6, 3e6, 0])
    np.testing.assert_allclose(log["current"], [1, 2, 3])


def test_a_mapped_column_that_is_missing_is_named_with_its_channel(tmp_path):
    """The message names the column in the file and the channel."""
    path = write(tmp_path / "u.csv", "t,rpm,current\n0,60,1\n4,-120,2\n")

    with pytest.raises(InputError, match=r"no column 'p_up', where the plant's \[log\] looks for p1"):
        read_log(path, ["p1"], columns={"p1": Column("p_up"), "speed": Column("rpm")})


def test_a_log_of_our_own_is_read_whatever_is_mapped(tmp_path):
    """Without any mapped column the file is read in SI units and by channel names."""
    path = write(tmp_path / "u.csv", "t,speed\n0,60\n0.1,70\n")

    np.testing.assert_array_equal(read_log(path, ["speed"], columns={"speed": Column("rpm", 0.1)})["speed"], [60, 70])


@pytest.mark.parametrize("number", [0.0, np.nan, np.inf])
def test_a_scale_must_be_of_use(number):
    """A scale of zero would erase the column."""
    with pytest.raises(InputError, match=r"scale = .*: must be a finite number other than 0"):
        Column("x", scale=number)


def test_jittered_time_is_read_only_when_asked_for(tmp_path):
    """Jitter may be accepted, a gap never."""
    jitter = write(tmp_path / "j.csv", "t,current\n0,1\n0.1,1\n0.25,1\n0.3,1\n0.45,1\n0.5,1\n")
    gap = write(tmp_path / "g.csv", "t,current\n0,1\n0.1,1\n0.2,1\n0.9,1\n1.0,1\n")

    assert len(read_log(jitter, ["current"], uniform=False)) == 6
    with pytest.raises(InputError, match=r"row 5: a gap of 0.7 s"):
        read_log(gap, ["current"], uniform=False)


def test_a_segment_holds_both_ends_and_remembers_what_was_before():
    """Start and stop are times of the log."""
    log = Log(np.arange(10) * 0.1 + 5.0, {"current": np.arange(10.0)})

    part = log.segment(5.3, 5.6)

    np.testing.assert_array_equal(part["current"], [3, 4, 5, 6])
    np.testing.assert_array_equal(part.before["current"], [0, 1, 2])
    np.testing.assert_array_equal(part.segment(5.5).before["current"], [3, 4])
    assert len(log.segment()) == 10
    assert log.segment().before is None


@pytest.mark.parametrize(("start", "stop"), [(7.0, None), (None, 4.0), (5.4, 5.2), (5.41, 5.49)])
def test_an_empty_segment_says_where_the_log_is(start, stop):
    """A segment beyond the ends, reversed, or between two samples."""
    log = Log(np.arange(10) * 0.1 + 5.0, {"current": np.arange(10.0)})

    with pytest.raises(InputError, match=r"the log runs from 5 to 5.9 s"):
        log.segment(start, stop)


@pytest.mark.parametrize("ending", ["csv", "parquet", "pq", "mat"])
def test_a_log_is_written_as_its_ending_says(tmp_path, ending):
    """Every format is read back; all but CSV keep every digit."""
    time = 0.004 * np.arange(5)
    log = Log(time, {"current": np.array([0, 1, -1, 1 / 3, 2]), "p1": np.linspace(2e6, 2.1e6, 5) / 3})
    log.write(tmp_path / f"log.{ending}")

    again = read_log(tmp_path / f"log.{ending}", ["current", "p1"])

    assert again.path == tmp_path / f"log.{ending}"
    for name in log.channels:
        if ending == "csv":
            np.testing.assert_allclose(again[name], log[name], atol=0.05 if name == "p1" else 1e-5)
        else:
            assert np.array_equal(again[name], log[name])


def test_a_table_in_memory_becomes_a_log():
    """With time as a column or as the index, other names through columns; back it is the same table."""
    frame = pandas.DataFrame({"t": [0.0, 0.1, 0.2], "current": [0.0, 1.0, 2.0], "n": [0.0, 60.0, 120.0]})
    log = Log.from_pandas(frame, ["current"], columns={"speed": Column("n", scale=2 * np.pi / 60)})

    np.testing.assert_allclose(log["speed"], [0.0, 2 * np.pi, 4 * np.pi])
    assert log.path is None and log.sample_time == pytest.approx(0.1)
    assert Log.from_pandas(frame.drop(columns="n")).to_pandas().equals(frame.drop(columns="n"))
    named = frame.set_index("t")
    assert np.array_equal(Log.from_pandas(named).time, [0.0, 0.1, 0.2])
    assert np.array_equal(Log.from_pandas(named.rename_axis(None)).time, [0.0, 0.1, 0.2])


def test_a_wrong_table_is_a_sentence():
    """As for a file, with rows counted from 1."""
    with pytest.raises(InputError, match="the table: has no column 't'"):
        Log.from_pandas(pandas.DataFrame({"current": [0.0, 1.0]}))
    with pytest.raises(InputError, match="the table: column 'current', row 2: 'nan' is not a finite number"):
        Log.from_pandas(pandas.DataFrame({"t": [0.0, 0.1], "current": [0.0, np.nan]}), ["current"])
