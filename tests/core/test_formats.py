"""Every file format: the same channels, times, units and sentences, whatever the file."""

import json
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from written_formats import EPOCH, SI, STEP, TIME, WRITTEN

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.formats import FORMATS, format_of, read_tables
from ehsa_ctrl.core.log import Column
from ehsa_ctrl.core.log_reader import read_log

#: Formats in which a file cut anywhere may be a shorter log.
SHORTER = ()


@pytest.fixture(params=WRITTEN)
def file(request, tmp_path):
    """Writes a file of each format: columns in, path out."""
    form = WRITTEN[request.param]
    for module in form.needs:
        pytest.importorskip(module)

    def write(columns=SI, time=TIME, units=()):
        path = tmp_path / (f"rig.{form.ending}" if form.ending else "rig")
        form.write(path, columns, time, dict(units))
        return path

    write.form = form
    return write


def test_every_format_has_a_file_that_its_library_wrote():
    """A new format comes with a fixture."""
    assert set(WRITTEN) == set(FORMATS)


def test_channels_times_and_format_are_those_written(file):
    """The content decides the format; time begins where the file's does, or at its first row."""
    path = file()
    log = read_log(path, list(SI))

    assert format_of(path).name == file.form.name
    np.testing.assert_allclose(log.time, TIME, atol=1e-9)
    for name, values in SI.items():
        np.testing.assert_allclose(log[name], values, rtol=1e-9, atol=1e-9)


def test_units_of_the_file_are_converted(file):
    """Bar and mm of the file become SI units, and the notes say so."""
    if not file.form.units:
        pytest.skip("a format without units")
    columns = {"current": SI["current"], "p1": SI["p1"] / 1e5, "position": SI["position"] * 1e3}
    log = read_log(file(columns, units={"current": "A", "p1": "bar", "position": "mm"}), list(SI))

    np.testing.assert_allclose(log["p1"], SI["p1"], rtol=1e-9)
    np.testing.assert_allclose(log["position"], SI["position"], atol=1e-12)
    assert any("p1 from bar, position from mm" in note for note in log.notes)


def test_columns_are_mapped_as_those_of_a_csv(file):
    """By the plant's [log]: another name, scale and sign; a wrong name is a sentence with the known ones."""
    path = file({"i_soll": -10 * SI["current"], "druck_a": SI["p1"]})
    mapped = {"current": Column("i_soll", -0.1), "p1": Column("druck_a")}

    np.testing.assert_allclose(read_log(path, ["current", "p1"], columns=mapped)["current"], SI["current"], atol=1e-9)
    with pytest.raises(InputError, match=r"no column 'druk_a', where .*; did you mean 'druck_a'"):
        read_log(path, ["current", "p1"], columns=mapped | {"p1": Column("druk_a")})


def test_a_value_that_is_no_number_has_column_and_row(file):
    """NaN in the seventh sample."""
    values = SI["p1"].copy()
    values[6] = np.nan

    with pytest.raises(InputError, match=r"column 'p1', row \d+: ('nan' is not a finite|the cell is empty)") as caught:
        read_log(file(SI | {"p1": values}), list(SI))
    assert "\n" not in str(caught.value)


def test_a_gap_and_a_short_log_are_sentences(file):
    """Ten samples lost, and 25 asked of 20."""
    path = file({name: np.delete(values, slice(30, 40)) for name, values in SI.items()}, np.delete(TIME, slice(30, 40)))

    with pytest.raises(InputError, match=r"row \d+: a gap of 0.044 s after 0.116 s"):
        read_log(path, list(SI))
    with pytest.raises(InputError, match="has 50 rows of data; expected at least 99"):
        read_log(path, list(SI), shortest=99)


@pytest.mark.parametrize("how", ["truncated", "foreign", "empty"])
def test_a_damaged_or_foreign_file_is_a_sentence(file, how, tmp_path):
    """Half of the file, another kind of content, or none: never a traceback. A text cut at a row is a shorter log."""
    path = file()
    if path.is_dir():
        (path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}" if how == "foreign" else "")
    else:
        content = path.read_bytes()
        cut = {"truncated": content[: len(content) // 2], "foreign": b"\x89PNG\r\n\x1a\n\x00\x00" * 40}
        path = tmp_path / f"damaged.{file.form.ending}"
        path.write_bytes(cut.get(how, b""))

    if how == "truncated" and file.form.name in SHORTER:
        assert 2 < len(read_log(path, list(SI))) < TIME.size
        return
    with pytest.raises(InputError) as caught:
        read_log(path, list(SI))
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [name for name, form in FORMATS.items() if form.extra])
def test_without_its_library_the_command_to_install_it_is_said(name, tmp_path, monkeypatch):
    """The extra by its name."""
    form, path = FORMATS[name], tmp_path / "rig.log"
    path.write_bytes(form.magic[0])
    for module in form.modules:
        monkeypatch.setitem(sys.modules, module, None)

    with pytest.raises(InputError, match=rf'needs {form.modules[0]}; install it with pip install "ehsa_ctrl\[\w+\]"$'):
        read_tables(path)


def test_the_extras_of_the_formats_are_declared():
    """pyproject.toml names them, and one for all."""
    extras = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    for form in FORMATS.values():
        if form.extra:
            assert set(extras[form.extra]) <= set(extras["formats"])


def test_a_folder_that_is_no_bag_is_no_log(tmp_path):
    """A folder counts only with a bag's metadata.yaml."""
    with pytest.raises(InputError, match="is a folder; give the file of one log"):
        read_tables(tmp_path)


def test_several_groups_of_equal_times_need_no_resampling(tmp_path):
    """Two groups of one clock, one of them a sample longer: the common samples, as they are."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "u.tdms") as file:
        for group, name, count in (("drive", "current", 50), ("rod", "position", 51)):
            properties = {"wf_increment": STEP, "wf_start_offset": 0.0}
            file.write_segment([nptdms.ChannelObject(group, name, np.arange(float(count)), properties)])

    log = read_log(tmp_path / "u.tdms", ["current", "position"])

    assert log.rates is None and len(log) == 50
    np.testing.assert_array_equal(log["position"], np.arange(50.0))


def test_a_column_that_several_groups_have_is_named_with_its_group(tmp_path):
    """Ambiguous by itself, read with its group."""
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(tmp_path / "u.tdms") as file:
        for k, group in enumerate(("set", "actual")):
            properties = {"wf_increment": STEP, "wf_start_offset": 0.0}
            file.write_segment([nptdms.ChannelObject(group, "position", np.full(50, float(k)), properties)])

    with pytest.raises(InputError, match=r"2 columns 'position'; .* 'set/position' or 'actual/position'"):
        read_log(tmp_path / "u.tdms", ["position"])
    log = read_log(tmp_path / "u.tdms", ["position"], columns={"position": Column("actual/position")})
    np.testing.assert_array_equal(log["position"], np.ones(50))


def test_a_structure_with_time_of_simulink_is_read(tmp_path):
    """Labels are the columns, and the structure's time is theirs."""
    from scipy.io import savemat

    signals = np.array(
        [{"label": name, "values": values[:, None], "dimensions": 1} for name, values in SI.items()], dtype=object
    )
    savemat(tmp_path / "u.mat", {"out": {"time": TIME[:, None], "signals": signals}})

    log = read_log(tmp_path / "u.mat", list(SI))

    np.testing.assert_allclose(log.time, TIME)
    np.testing.assert_array_equal(log["p1"], SI["p1"])


def test_stamps_of_headers_go_before_times_of_recording(tmp_path):
    """A recorder is late and writes out of order; a topic of one number is its channel."""
    writer = pytest.importorskip("mcap_ros2.writer")
    header = "std_msgs/Header header\nfloat64 data\n" + 80 * "=" + (
        "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + 80 * "="
        + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
    )  # fmt: skip
    order = np.r_[0:20, 21, 20, 22:50]
    with (tmp_path / "u.mcap").open("wb") as stream, writer.Writer(stream) as file:
        schema = file.register_msgdef("rig/Stamped", header)
        for place, k in enumerate(order):
            at = 4_000_000 * int(k)
            stamp = {"sec": 1_700_000_000, "nanosec": at}
            late = 1_700_000_000_000_000_000 + 4_100_000 * place
            message = {"header": {"stamp": stamp, "frame_id": ""}, "data": float(k)}
            file.write_message("/position", schema, message, log_time=late, publish_time=late)

    log = read_log(tmp_path / "u.mcap", ["position"])

    np.testing.assert_allclose(log.time, STEP * np.arange(50), atol=1e-9)
    np.testing.assert_array_equal(log["position"], np.arange(50.0))


def test_topics_in_json_are_read_like_others(tmp_path):
    """As Foxglove writes them; a topic of text or of another encoding is left out."""
    mcap = pytest.importorskip("mcap.writer")
    pytest.importorskip("mcap_ros2")
    with (tmp_path / "u.mcap").open("wb") as stream:
        file = mcap.Writer(stream)
        file.start()
        schema = file.register_schema("State", "jsonschema", b"{}")
        topics = {t: file.register_channel(t, e, schema) for t, e in (("/rig", "json"), ("/other", "protobuf"))}
        for k in range(50):
            at = EPOCH + 4_000_000 * k
            content = json.dumps({"current": k, "rod": {"position": [0.1 * k, 0.0]}, "note": "run 1"}).encode()
            file.add_message(topics["/rig"], log_time=at, data=content, publish_time=at)
            file.add_message(topics["/other"], log_time=at, data=b"?", publish_time=at)
        file.finish()

    log = read_log(tmp_path / "u.mcap", ["current"], columns={"position": Column("rod.position[0]")})

    np.testing.assert_array_equal(log["current"], np.arange(50.0))
    np.testing.assert_allclose(log["position"], 0.1 * np.arange(50))


def test_groups_of_hdf5_share_a_time_of_their_length(tmp_path):
    """/t for /sensors/p1; without it a stated rate is the time, and records are columns."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "u.h5", "w") as file:
        file["t"], file["sensors/p1"] = TIME, SI["p1"]
        file["drive/current"] = SI["current"]
    with h5py.File(tmp_path / "v.h5", "w") as file:
        file["log"] = np.rec.fromarrays([SI["current"], SI["p1"]], names=["current", "p1"])
        file["log"].attrs["fs"] = 250

    for name in ("u.h5", "v.h5"):
        log = read_log(tmp_path / name, ["current", "p1"])
        np.testing.assert_allclose(log.time, TIME)
        np.testing.assert_array_equal(log["p1"], SI["p1"])


def test_invalid_samples_of_mdf_are_no_numbers(tmp_path):
    """Invalidation bits mark a value that the sensor did not give."""
    asammdf = pytest.importorskip("asammdf")
    invalid = np.zeros(TIME.size, dtype=bool)
    invalid[7] = True
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(SI["p1"], TIME, name="p1", invalidation_bits=invalid)])
        file.save(tmp_path / "u.mf4")

    with pytest.raises(InputError, match="column 'p1', row 8: 'nan' is not a finite number"):
        read_log(tmp_path / "u.mf4", ["p1"])


def test_scope_channels_of_several_rates_keep_their_own_time(tmp_path):
    """Groups of other lengths, one that begins earlier, decimal commas, full time stamps."""
    steps = {"current": 0.2, "position": 4.0, "force": 10.0}
    times = {name: np.arange(-3.0 if name == "force" else 0.0, 1000.0, step) for name, step in steps.items()}
    rows = ["Name\tS", "File\tx", "Starttime of export\t1", "Endtime of export\t2", "",
            *("".join(f"{key}\t{cell.format(name)}\t" for name in steps)
              for key, cell in (("Name", "{}"), ("Data-Type", "REAL64"), ("SampleTime[ms]", "1")))]  # fmt: skip
    for k in range(len(times["current"])):
        cells = (f"{t[k]:.1f}\t{np.sin(t[k] / 50):.9f}" if k < len(t) else "\t" for t in times.values())
        rows.append("\t".join(cells).replace(".", ","))
    (tmp_path / "u.csv").write_text("\n".join(rows))

    log = read_log(tmp_path / "u.csv", list(steps), rate=250.0)

    assert log.rates.before == pytest.approx({"current": 5000.0, "position": 250.0, "force": 100.0})
    np.testing.assert_allclose(log["position"], np.sin(log.time / 0.05), atol=1e-8)
    np.testing.assert_allclose(log["force"][60:-60], np.sin(log.time / 0.05)[60:-60], atol=0.01)


def test_the_page_lists_every_format():
    """Its extra and its endings, too."""
    docs = Path(__file__).parents[2] / "docs"
    reference = (docs / "reference" / "files.md").read_text()
    page = (docs / "how-to" / "own-log.md").read_text()
    table = page[page.index("| format |") : page.index("What follows is the same")]
    for form in FORMATS.values():
        for word in (form.name.partition(" ")[0], form.extra, *form.suffixes[:2]):
            assert word in table, form.name
        assert form.name in reference[reference.index("## Formats of logs") :]
