"""Files of each format, written by the format's own library: channels of one table, sampled at 250 Hz."""

from dataclasses import dataclass

import numpy as np
import pandas
from scipy.io import savemat

N, STEP = 60, 0.004
TIME = STEP * np.arange(N)
#: Column -> values in SI units, as the log is expected to hold them.
SI = {"current": np.sin(20 * TIME), "p1": 2e6 + 1e5 * np.cos(20 * TIME), "position": 0.05 * TIME}
#: 2024-05-31 12:00 UTC in ns.
EPOCH = 1_717_156_800_000_000_000


def write_csv(path, columns, time, units):
    units = [units.get(name, "-") for name in ("t", *columns)]
    text = pandas.DataFrame({"t": time, **columns}).to_csv(index=False, float_format="%.12g")
    head, _, body = text.partition("\n")
    path.write_text("\n".join([head, ",".join(["s", *units[1:]]), body]))


def write_parquet(path, columns, time, units):
    pandas.DataFrame({"t": time, **columns}).to_parquet(path)


def write_mat(path, columns, time, units):
    savemat(path, {"t": time, **columns})


def write_mat_73(path, columns, time, units):
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in {"t": time, **columns}.items():
            item = file.create_dataset(name, data=values[None, :])
            item.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def write_hdf5(path, columns, time, units):
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in {"t": time, **columns}.items():
            file.create_dataset(name, data=values).attrs["unit"] = units.get(name, "")


def write_tdms(path, columns, time, units):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as file:
        stamps = {"wf_increment": time[1] - time[0], "wf_start_offset": time[0]}
        if not np.allclose(np.diff(time), time[1] - time[0]):
            stamps, columns = {}, {"t": time, **columns}
        file.write_segment(
            [
                ChannelObject("rig", name, values, {**stamps, "unit_string": units.get(name, "")})
                for name, values in columns.items()
            ]
        )


def write_mdf(path, columns, time, units):
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(v, time, unit=units.get(k, ""), name=k) for k, v in columns.items()])
        file.save(path, overwrite=True)


def write_twincat(path, columns, time, units):
    names = "\t".join(columns)
    count = len(columns)
    rows = [
        "Name\tScope Project", "File\trig.csv", f"Starttime of export\t{133_616_304_000_000_000}\tFriday\t12:00:00",
        f"Endtime of export\t{133_616_304_000_000_000}\tFriday\t12:00:01", "", "", f"Name\t{names}",
        "SymbolComment" + "\t" * count, "Data-Type" + "\tREAL64" * count, "SampleTime[ms]" + "\t4" * count,
        "\t".join(["Unit", *(f"{units[k]} (X)" if units.get(k) else "(None)" for k in columns)]), "",
    ]  # fmt: skip
    rows += ["\t".join(f"{x:.12g}" for x in row) for row in zip(1e3 * time, *columns.values(), strict=True)]
    path.write_text("\r\n".join([*rows, "EOF"]) + "\r\n")


def write_mcap(path, columns, time, units):
    from mcap_ros2.writer import Writer

    with path.open("wb") as stream, Writer(stream) as file:
        schema = file.register_msgdef("rig/State", "\n".join(f"float64 {name}" for name in columns))
        for k, t in enumerate(time):
            at = EPOCH + round(1e9 * t)
            message = {name: float(values[k]) for name, values in columns.items()}
            file.write_message("/rig/state", schema, message, log_time=at, publish_time=at)


def write_rosbag(path, columns, time, units):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    types.register(get_types_from_msg("\n".join(f"float64 {name}" for name in columns), "rig/msg/State"))
    state = types.types["rig/msg/State"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as file:
        connection = file.add_connection("/rig/state", "rig/msg/State", typestore=types)
        for k, t in enumerate(time):
            message = state(**{name: float(values[k]) for name, values in columns.items()})
            file.write(connection, EPOCH + round(1e9 * t), types.serialize_cdr(message, "rig/msg/State"))


@dataclass(frozen=True)
class Written:
    """How a format is written; needs: modules that may be missing; units: whether the format has units."""

    name: str
    ending: str
    write: object
    needs: tuple[str, ...] = ()
    units: bool = True


WRITTEN = {
    one.name: one
    for one in (
        Written("CSV", "csv", write_csv),
        Written("Parquet", "parquet", write_parquet, ("pyarrow",), units=False),
        Written("MAT", "mat", write_mat, units=False),
        Written("MAT 7.3", "mat", write_mat_73, ("pymatreader", "h5py"), units=False),
        Written("HDF5", "h5", write_hdf5, ("h5py",)),
        Written("TDMS", "tdms", write_tdms, ("nptdms",)),
        Written("MDF", "mf4", write_mdf, ("asammdf",)),
        Written("TwinCAT Scope CSV", "csv", write_twincat),
        Written("MCAP", "mcap", write_mcap, ("mcap", "mcap_ros2"), units=False),
        Written("ROS bag", "", write_rosbag, ("rosbags",), units=False),
    )
}
