"""Write a plant as an FMU: a zip with pythonfmu's binary, a Python script and the plant's files."""

from __future__ import annotations

import builtins
import keyword
import re
import sys
import tempfile
import uuid
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.errors import InputError
from ...core.files import atomic_write, refuse_existing
from .exported import write_exported

if TYPE_CHECKING:
    from ...plant.plant import Plant

#: Script that the FMU's binary loads. Its class has the plant's name, because a process may load several FMUs.
SCRIPT = '''\
"""Loaded by the FMU: {title}."""

try:
    from ehsa_ctrl.simulation.fmu.slave import PlantSlave
except ImportError as error:
    raise ImportError(
        "this FMU needs the package ehsa_ctrl (written by {version}) in the Python that runs it; install it there"
    ) from error


class {name}(PlantSlave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.guid = "{guid}"
'''


def export_fmu(plant: Plant, path: str | Path, *, force: bool = False) -> Path:
    """Write the plant as an FMU for co-simulation, FMI 2.0; returns the file's path.

    Inputs, outputs and parameters are those of `variables_of`, in SI units: for the EHSA inputs current and F_D,
    outputs speed, p1, p2, velocity, position, force, shaft_sticks and rod_sticks, and every symbol of the plant as a
    parameter that can be set before the run. The FMU contains friction laws, effects and nominal values, but no
    sensors: outputs are true signals. It runs the engine of `simulate`, with inputs held over each step of the master.

    The machine that runs the FMU needs Python with ehsa_ctrl, and Windows or Linux on 64-bit Intel, for which pythonfmu
    has binaries. On Linux, start a tool not written in Python with LD_PRELOAD=libpython3.X.so. With pythonfmu up to
    0.7.0, a Linux process that ran an FMU may abort at its end, after all results, because the binary releases an
    object twice; end a script whose exit status matters with os._exit(0).

    Parameters
    ----------
    path: the file, ending in .fmu.
    force: replace an existing file.

    Raises
    ------
    InputError: pythonfmu is missing, the path does not end in .fmu or exists, or the plant does not come from a TOML.
    """
    path = Path(path)
    if path.suffix != ".fmu":
        raise InputError(f"{path}: expected the path of a file that ends in .fmu")
    refuse_existing(path, force=force, how="use --force (force=True)")
    try:
        from pythonfmu.builder import FmuBuilder
    except ImportError:
        raise InputError('writing an FMU needs pythonfmu; install it with pip install "ehsa_ctrl[fmu]"') from None
    from importlib.metadata import version

    name = identifier(plant.name)
    known_paths, module = list(sys.path), f"{name}_slave"
    with atomic_write(path) as draft, tempfile.TemporaryDirectory() as folder:
        files = write_exported(plant, Path(folder))
        # The same plant gives the same identifier, as FMI demands of FMUs that behave alike.
        guid = uuid.uuid5(uuid.NAMESPACE_URL, "".join(file.read_text(encoding="utf-8") for file in files))
        script = Path(folder) / f"{module}.py"
        title = plant.title.replace("\\", " ").replace('"', "'")
        script.write_text(SCRIPT.format(title=title, version=version("ehsa_ctrl"), name=name, guid=guid), "utf-8")
        sys.modules.pop(module, None)
        try:
            FmuBuilder.build_FMU(
                script,
                dest=draft,
                project_files=files,
                canGetAndSetFMUstate=True,
                canSerializeFMUstate=True,
            )
        finally:
            # The builder has imported the script by name, from the temporary folder.
            sys.path[:] = known_paths
            sys.modules.pop(module, None)
    return path


def identifier(name: str) -> str:
    """A plant's name as an FMI model identifier: letters, digits and underscores, no digit first.

    It is also the name of a Python class, so keywords and built-in names get a leading underscore.
    """
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    own = keyword.iskeyword(word) or hasattr(builtins, word) or word == "PlantSlave"
    return f"_{word}" if own or not word or word[0].isdigit() else word
