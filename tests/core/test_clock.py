"""Time of a log: dates, stamps since an epoch, relative stamps, and files whose step is wrong."""

import numpy as np
import pandas
import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Column
from ehsa_ctrl.core.log_reader import read_log

N, STEP = 50, 0.004
TIME = STEP * np.arange(N)
#: 2024-05-31 12:00 UTC.
START = pandas.Timestamp("2024-05-31T12:00:00Z")
SECONDS = int(START.timestamp())


def write(path, stamps):
    pandas.DataFrame({"t": stamps, "current": np.arange(float(N))}).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        ([f"{SECONDS + t:.6f}" for t in TIME], "s since 1970"),
        ([SECONDS * 1000 + 4 * k for k in range(N)], "ms since 1970"),
        ([(SECONDS * 1000 + 4 * k) * 1000 for k in range(N)], "us since 1970"),
        ([(SECONDS * 1000 + 4 * k) * 10**6 + 1 for k in range(N)], "ns since 1970"),
        ([116_444_736 * 10**9 + (SECONDS * 1000 + 4 * k) * 10**4 for k in range(N)], "FILETIME"),
        ([f"{SECONDS + 2_082_844_800 + t:.6f}" for t in TIME], "LabVIEW"),
        ([f"{719529 + (SECONDS + t) / 86400:.12f}" for t in TIME], "datenum"),
        ([(START + pandas.Timedelta(seconds=t)).isoformat() for t in TIME], "dates"),
        ([(START + pandas.Timedelta(seconds=t)).strftime("%Y-%m-%d %H:%M:%S.%f") for t in TIME], "dates"),
        ([(START + pandas.Timedelta(seconds=t)).strftime("%H:%M:%S.%f") for t in TIME], "times of day"),
    ],
    ids=["s", "ms", "us", "ns", "filetime", "labview", "datenum", "iso", "blank", "clock"],
)
def test_absolute_stamps_are_counted_from_the_first_row(tmp_path, stamps, said):
    """Each is recognised by its size, and the note says as what it was read."""
    log = read_log(write(tmp_path / "u.csv", stamps), ["current"])

    np.testing.assert_allclose(log.time, TIME, atol=2e-5)
    assert any(said in note and ("2024-05-31" in note or said == "times of day") for note in log.notes)


@pytest.mark.parametrize("first", [0, 41_000, 3_400_000_000_000])
def test_a_relative_counter_is_no_date(tmp_path, first):
    """Nanoseconds since switching on, which as milliseconds since 1970 would be a date, with steps of hours."""
    path = write(tmp_path / "u.csv", [first + 4_000_000 * k for k in range(N)])

    log = read_log(path, ["current"], columns={"t": Column("t", 1e-9)})

    np.testing.assert_allclose(log.time, 1e-9 * first + TIME, atol=1e-9)
    assert not log.notes


def test_dates_of_other_forms_are_refused(tmp_path):
    """Day and month may be exchanged."""
    with pytest.raises(InputError, match=r"row 2: the date '03/04/2024 12:00:00' is not ISO 8601; write dates like"):
        read_log(write(tmp_path / "u.csv", ["03/04/2024 12:00:00"] * N), ["current"])


def test_a_damaged_date_has_its_row(tmp_path):
    """As any cell without a number."""
    stamps = [(START + pandas.Timedelta(seconds=t)).isoformat() for t in TIME]
    stamps[7] = "2024-05-31T25:00"

    with pytest.raises(InputError, match=r"column 't', row 9: '2024-05-31T25:00' is not"):
        read_log(write(tmp_path / "u.csv", stamps), ["current"])


def test_stamps_coarser_than_the_sampling_ask_for_the_sample_time(tmp_path):
    """Milliseconds at 4800 Hz: the mean step is proposed, and reads the file when it is given."""
    path = write(tmp_path / "u.csv", [f"{np.floor(1e3 * k / 4800) / 1e3:.3f}" for k in range(N)])

    with pytest.raises(InputError, match=r"repeats 3\d of 49 stamps: it is coarser .*--sample-time 0.0002"):
        read_log(path, ["current"])
    log = read_log(path, ["current"], sample_time=1 / 4800)
    assert log.sample_time == pytest.approx(1 / 4800)


def test_a_given_sample_time_wins_and_says_what_it_replaces(tmp_path):
    """An exporter that always writes steps of 1; a file without time at all."""
    path = write(tmp_path / "u.csv", range(N))
    log = read_log(path, ["current"], sample_time=STEP)

    np.testing.assert_allclose(log.time, TIME)
    assert "steps of 1 s are ignored for the given sample time of 0.004 s" in log.notes[0]
    (tmp_path / "v.csv").write_text("current\n" + "1\n" * N)
    with pytest.raises(InputError, match=r"no column 't'; known: current; or give the sample time of the rows"):
        read_log(tmp_path / "v.csv", ["current"])
    assert read_log(tmp_path / "v.csv", ["current"], sample_time=STEP).sample_time == pytest.approx(STEP)


def test_a_stated_rate_that_the_stamps_contradict_is_said(tmp_path):
    """The stamps are used; the stated sample time can be given instead."""
    nptdms = pytest.importorskip("nptdms")
    stated = {"wf_increment": 0.001, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(tmp_path / "u.tdms") as file:
        columns = {"time": TIME, "current": np.arange(float(N))}
        file.write_segment([nptdms.ChannelObject("rig", name, v, stated) for name, v in columns.items()])

    log = read_log(tmp_path / "u.tdms", ["current"], columns={"t": Column("time")})

    assert log.sample_time == pytest.approx(STEP)
    assert any("0.004 s apart, but wf_increment says 0.001 s" in n and "--sample-time 0.001" in n for n in log.notes)
