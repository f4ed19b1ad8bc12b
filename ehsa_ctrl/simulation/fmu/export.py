"""Write a plant as an FMU: pythonfmu's binary, its Python side, and the plant's files in one zip."""

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

#: What the FMU's binary loads: a name of its own for every plant, as a process may hold several FMUs.
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
    sensors: outputs are true signals. The engine of `simulate` runs inside, inputs held over each step of the master.

    The FMU needs Python with ehsa_ctrl where it is run, and Windows or Linux on 64-bit Intel, for which pythonfmu has
    binaries. On Linux a tool that is not itself Python has to be started with LD_PRELOAD=libpython3.X.so.
    pythonfmu up to 0.7.0 may abort a Linux process that ran an FMU when that process ends, after all results: its
    binary releases an object twice. A script whose exit status matters ends with os._exit(0).

    Parameters
    ----------
    path: the file, ending in .fmu.
    force: replace one that is there.

    Raises
    ------
    InputError: pythonfmu is missing, the path is no .fmu or is there already, or the plant came from no TOML.
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
        # The same plant gives the same identifier, so that FMUs with one identifier behave alike.
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
            # The builder imports the script by name, from a folder that is about to go.
            sys.path[:] = known_paths
            sys.modules.pop(module, None)
    return path


def identifier(name: str) -> str:
    """A plant's name as FMI wants a model's: letters, digits and underscores, no digit first.

    It is also the name of a Python class, so that keywords and built-in names get a leading underscore.
    """
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    own = keyword.iskeyword(word) or hasattr(builtins, word) or word == "PlantSlave"
    return f"_{word}" if own or not word or word[0].isdigit() else word
