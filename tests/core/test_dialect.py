"""Logs from other programs: other formats hold the same numbers; a format with two meanings is refused."""

import csv
import io

import numpy as np
import pandas
import pytest

from ehsa_ctrl.core.column_matching import match_columns
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import CHANNELS, Column, Log
from ehsa_ctrl.core.log_reader import read_log
from ehsa_ctrl.core.unit import factor

#: A unit that rigs log a channel in.
LOGGED = {"t": "ms", "current": "mA", "speed": "rpm", "p1": "bar", "position": "mm"}


@pytest.fixture
def values():
    """Channels in SI units with few digits, negative ones, a zero and numbers of a thousand and more among them."""
    n = 40
    rng = np.random.default_rng(5)
    return {
        "t": np.arange(n) / 250.0,
        "current": np.round(rng.normal(size=n), 4),
        "speed": np.round(200.0 * rng.normal(size=n), 3),
        "p1": np.round(2e6 + 1e4 * rng.normal(size=n), 1),
        "position": np.round(1e-3 * rng.normal(size=n), 7),
    }


def text_of(values, separator, decimal, units, *, trailing=False, comments=False, quoted=False):
    """The same numbers as another program would write them."""
    scale = {name: 1.0 / factor(units[name], CHANNELS[name].unit) if units else 1.0 for name in values}
    rows = np.column_stack([values[name] * scale[name] for name in values])
    out = io.StringIO()
    writer = csv.writer(out, delimiter=separator, quoting=csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL)
    end = [""] if trailing else []
    writer.writerow([*values, *end])
    if units:
        writer.writerow([*(f"[{units[name]}]" for name in values), *end])
    for number, row in enumerate(rows):
        if comments and number == 7:
            out.write("# the pump was touched\n")
        writer.writerow([*(f"{value:.12g}".replace(".", decimal) for value in row), *end])
    return ("% Prüfstand 3, Öl 40 °C\n# second run\n" if comments else "") + out.getvalue()


@pytest.mark.parametrize("units", [None, LOGGED], ids=["SI", "units"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
@pytest.mark.parametrize("more", [{}, {"trailing": True}, {"comments": True}, {"quoted": True}], ids=str)
def test_every_way_of_writing_holds_the_same_numbers(tmp_path, values, separator, decimal, encoding, units, more):
    """Separator, decimals, encoding, a row of units, an empty last column, comments, quotes: in all combinations."""
    path = tmp_path / "log.csv"
    path.write_text(text_of(values, separator, decimal, units, **more), encoding=encoding, newline="")

    log = read_log(path, ["current", "p1"])

    for name, expected in values.items():
        got = log.time if name == "t" else log[name]
        np.testing.assert_allclose(got, expected, rtol=1e-10, atol=1e-10 * np.ptp(expected))
    said = " ".join(log.notes)
    assert ("between columns" in said) == (separator != "," or decimal == ",")
    assert ("decimal commas" in said) == (decimal == ",")
    assert ("UTF-16" in said) == (encoding == "utf-16")
    assert ("p1 from bar" in said) == (units is not None)


def test_a_log_of_our_own_is_not_talked_about(tmp_path, values):
    """No assumption, no note."""
    Log(values.pop("t"), values).write(tmp_path / "log.csv")

    assert read_log(tmp_path / "log.csv", ["current"]).notes == ()


def test_what_was_assumed_is_said_of_pieces_too(tmp_path):
    """Notes survive segments and appear in the text of the log."""
    path = tmp_path / "rig.csv"
    path.write_text("t;current\n0,0;1,25\n0,1;1,5\n0,2;1,5\n")
    log = read_log(path, ["current"])

    assert log.notes == (f"{path}: read with ';' between columns and decimal commas",)
    assert log.segment(0.1).notes == log.notes
    assert log.notes[0] in str(log)


@pytest.mark.parametrize("sign", [";", "\t"])
def test_thousands_are_not_taken_for_decimals(tmp_path, sign):
    """1,500 alone may be both; one number of another form decides, and two marks in a number never do."""
    path = tmp_path / "u.csv"
    rows = "\n".join(f"{t}{sign}1,500" for t in range(1, 5))
    path.write_text(f"t{sign}current\n{rows}\n")
    with pytest.raises(InputError, match=r"row 2: '1,500' may mean 1\.500 or 1500, and no number in the file decides"):
        read_log(path, ["current"])

    path.write_text(f"t{sign}current\n{rows}\n5{sign}1,25\n")
    assert read_log(path, ["current"])["current"] == pytest.approx([1.5, 1.5, 1.5, 1.5, 1.25])
    for wrong in ("1.234.567", "1,234,567", "1.234,5"):
        path.write_text(f"t{sign}current\n{rows}\n5{sign}{wrong}\n")
        with pytest.raises(InputError, match=f"row 6: '{wrong}' has thousands separators"):
            read_log(path, ["current"])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "t;current\n0.1;1,51\n0.2;1,60\n",
            r"has '1,51' with a decimal comma \(row 2\) and '0.1' with a decimal point \(row 2\)",
        ),
        ("t;current\n0,0;1,5\n0,1;abc\n0,2;1\n", r"column 'current', row 3: 'abc' is not a finite number; correct it"),
        ("t;current\n0,0;1\n0,1;\n0,2;1\n", r"column 'current', row 3: the cell is empty"),
        ("t;current\n0,0;1\n0,1;1;2\n", r"row 3 has 3 cells, but the header has 2: there is a cell too many$"),
        ("# a\nt,current\n0,1\n# b\n0.1,x\n", r"column 'current', row 5: 'x'"),
        ("# a\nt,current\n0,1\n0.1,1\n# b\n0.2,1\n0.5,1\n0.6,1\n", r"'t', row 7: a gap of 0.3 s after 0.2 s"),
        (
            "Rig 3\n\nt;current\n0,0;1,5\n0,1;1\n",
            r"row 3 looks like the header, but other text is above it; begin the rows",
        ),
        ("Rig 3;;\nt;current;p\n0,0;1,5;1\n0,1;1;2\n", r"row 2 looks like the header"),
        ("0,1\n1,2\n2,3\n", r"row 1 contains numbers instead of column names"),
        ("t;a,b\n0;1,5\n1,5;2\n", r"has no column 'current'"),
        ("t,x;current,y\n0\n1\n", r"row 1 can be split at ',' or ';', and the rows below don't decide"),
        ("t,current\ns,bar\n0,1\n1,2\n", r"row 2 gives column 'current' the unit 'bar', which is not a known unit"),
        ("t,current\ns,amps\n0,1\n1,2\n", r"the unit 'amps'.*write current = \{ column = \"current\", scale"),
        ("# made by hand\n", r"is not a CSV table with a header row"),
    ],
)
def test_what_is_in_doubt_is_one_sentence(tmp_path, text, says):
    """The message names the file and the remedy."""
    path = tmp_path / "u.csv"
    path.write_text(text)

    with pytest.raises(InputError, match=says) as caught:
        read_log(path, ["current"])

    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("unit", ["1/min", "1/s", "Hz", "U/min"])
def test_a_unit_of_turns_or_radians_is_refused(tmp_path, unit):
    """1/min of a shaft means revolutions, but radians to a library of units."""
    path = tmp_path / "u.csv"
    path.write_text(f"t,speed\ns,{unit}\n0,1\n1,2\n")

    with pytest.raises(InputError, match=f"the unit '{unit}', which is not a known unit of speed"):
        read_log(path, ["speed"])


def test_a_mapping_and_a_row_of_units_must_agree(tmp_path):
    """A scale near the unit's is a calibration; one that only reverses the sign contradicts the unit."""
    path = tmp_path / "u.csv"
    path.write_text("t,n,p\ns,rpm,bar\n0,60,1\n1,120,2\n")

    good = read_log(path, ["speed", "p1"], columns={"speed": Column("n"), "p1": Column("p", 1.02e5)})
    assert good["speed"] == pytest.approx([2 * np.pi, 4 * np.pi])
    assert good["p1"] == pytest.approx([1.02e5, 2.04e5])
    assert good.notes[-1].endswith("u.csv: converted by its row of units: speed from rpm")
    with pytest.raises(InputError, match=r"scales speed by -1; write scale = -0\.1047198 there"):
        read_log(path, ["speed"], columns={"speed": Column("n", -1.0)})
    with pytest.raises(InputError, match=r"which is 100000 Pa, but the plant's \[log\] scales p1 by 1000"):
        read_log(path, ["p1"], columns={"p1": Column("p", 1e3)})


def test_a_calibration_needs_no_unit_of_the_channel(tmp_path):
    """Volts of a sensor, with pascals per volt in the plant's [log]."""
    path = tmp_path / "u.csv"
    path.write_text("t,ch1\ns,V\n0,1.5\n1,2\n")

    assert read_log(path, ["p1"], columns={"p1": Column("ch1", 4e6, -1e5)})["p1"] == pytest.approx([5.9e6, 7.9e6])
    with pytest.raises(InputError, match="the unit 'V', which is not a known unit of p1"):
        read_log(path, ["p1"], columns={"p1": Column("ch1")})


def test_numpys_header_in_a_comment_is_found(tmp_path):
    """As numpy.savetxt writes it, with blanks or commas between columns."""
    rows = np.array([[0.0, 1.5], [0.004, -1.25], [0.008, 0.0]])
    for delimiter in (" ", ","):
        np.savetxt(tmp_path / "u.txt", rows, header=delimiter.join(["t", "current"]), delimiter=delimiter)
        log = read_log(tmp_path / "u.txt", ["current"])

        assert np.array_equal(log["current"], rows[:, 1])
        assert "the last comment row as header" in log.notes[0]


def test_a_spreadsheets_first_line_is_no_header(tmp_path):
    """A first line sep=; is skipped."""
    (tmp_path / "u.csv").write_text("sep=;\nt;current\n0,0;1,5\n0,1;1\n")

    assert read_log(tmp_path / "u.csv", ["current"])["current"] == pytest.approx([1.5, 1.0])


def test_a_table_of_pandas_with_its_index_is_read(tmp_path, values):
    """The unnamed index column is not a channel; empty columns at the end are dropped."""
    frame = pandas.DataFrame(values)
    frame[["", " "]] = np.nan
    frame.to_csv(tmp_path / "u.csv")

    assert read_log(tmp_path / "u.csv", ["p1"])["p1"] == pytest.approx(values["p1"])


PLAIN = {"t": "s", "current": "A", "speed": "rad/s", "p1": "Pa", "p2": "Pa", "position": "m", "force": "N"}


@pytest.mark.parametrize(
    ("column", "channel", "scale"),
    [
        ("I [A]", "current", 1.0), ("i_cmd_mA", "current", 1e-3), ("omega_rpm", "speed", 2 * np.pi / 60),
        ("Motor speed (deg/s)", "speed", np.pi / 180), ("omega_rad/s", "speed", 1.0), ("p_1", "p1", 1.0),
        ("p2 / bar", "p2", 1e5), ("pB (psi)", "p2", 6894.757), ("x (mm)", "position", 1e-3), ("time_ms", "t", 1e-3),
        ("Zeit [s]", "t", 1.0), ("Kraft in kN", "force", 1e3), ("Time", "t", 1.0),
    ],
)  # fmt: skip
def test_plain_names_are_recognised(column, channel, scale):
    """Names with their unit in any usual form."""
    (found,) = match_columns([column, "valve", "T_oil [°C]"], PLAIN).items()

    assert found[0] == channel and found[1].scale == pytest.approx(scale, rel=1e-6)


@pytest.mark.parametrize("columns", [["I [A]", "i_cmd"], ["n [1/min]"], ["p1 [mm]"], ["pressure"], ["I [V]"]])
def test_what_is_not_plain_is_not_guessed(columns):
    """Two candidates, a unit of another quantity, revolutions that may be radians."""
    assert match_columns(columns, PLAIN) == {}


def test_a_missing_column_comes_with_the_lines_to_write(tmp_path):
    """Suggestions cover required and wanted channels; applied as [log] they read the file."""
    path = tmp_path / "u.csv"
    path.write_text("time_ms;I [A];omega_rpm;oil\n0;1,5;60;4\n4;1,5;120;5\n")

    with pytest.raises(
        InputError, match=r"no column 't'.* write (.*) under \[log\] in the plant's TOML \(ehsa-ctrl new plant"
    ) as caught:
        read_log(path, ["current"], wanted=["speed", "p1"])

    import tomllib

    lines = str(caught.value).partition(" write ")[2].partition(" under [log]")[0]
    table = tomllib.loads("[log]\n" + lines.replace(" }, ", " }\n"))["log"]
    log = read_log(path, ["current"], columns={channel: Column(**at) for channel, at in table.items()})
    assert table.keys() == {"t", "current", "speed"}
    assert log.time == pytest.approx([0.0, 0.004]) and log["speed"] == pytest.approx([2 * np.pi, 4 * np.pi], rel=1e-6)


def test_a_channel_that_is_only_wanted_is_mentioned(tmp_path):
    """The log is read without it."""
    path = tmp_path / "u.csv"
    path.write_text("t,current,P 1 [bar],oil\n0,1,20,4\n0.1,2,21,4\n")

    log = read_log(path, ["current"], wanted=["p1", "p2"])

    assert "p1" not in log.channels
    assert 'write p1 = { column = "P 1 [bar]", scale = 100000 } under [log]' in log.notes[0]
