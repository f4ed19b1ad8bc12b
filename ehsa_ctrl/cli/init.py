"""`ehsa-ctrl init`: a project folder with definitions, an effect, a notebook, tests and a CI file.

The files without a definition of their own are templates in cli/templates/project, under their path in the project and
the ending .txt.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .complete import plants
from .options import Json
from .template import FOLDER

TEMPLATES = FOLDER / "project"
#: Shipped controller and scenario that the project starts from.
CONTROLLER, SCENARIO = "pid_friction", "steps_spring"


def command(
    folder: Annotated[Path, typer.Argument(help="Folder of the project; the working directory by default.")] = Path(),
    base: Annotated[
        str, typer.Option("--from", metavar="PLANT", help="Plant to start from.", autocompletion=plants)
    ] = "ehsa",
    as_json: Json = False,
) -> None:
    """Make a project: plant, controller, scenario, effect, notebook, tests and a CI file. Its tests pass as it is.

    No file that exists is replaced.

    Examples: ehsa-ctrl init · ehsa-ctrl init press --from my/rig.toml
    """
    from ..core.files import write_text
    from .output import to_json

    texts = _texts(base, folder.absolute().name)
    for name in texts:
        path = folder / name
        if path.exists() or path.is_symlink():
            raise InputError(f"{path} exists; give another folder, or remove the file: init replaces nothing")
    for name, text in texts.items():
        write_text(folder / name, text)
    following = [*([f"cd {folder}"] if folder != Path() else []), "pytest", "ehsa-ctrl run steps --out results/steps"]
    if as_json:
        print(to_json({"written": [str(folder / name) for name in texts], "from": base, "next": following}))
        return
    print("\n".join(f"written to {folder / name}" for name in texts))
    print("README.md says what each file is for; begin with\n" + "\n".join(f"  {line}" for line in following))


def _texts(base: str, name: str) -> dict[str, str]:
    """Path in the project -> text. Raises InputError for a plant that is unknown, or that has no position control."""
    from .. import __version__
    from ..core.catalogue import plants as catalogue
    from ..core.notebook import notebook_of
    from ..plant.load import load_plant, models_of
    from .definitions import controller_toml, plant_toml, scenario_toml

    path = catalogue.find(base).resolve()
    system = load_plant(path).structure.system
    if "linear" not in models_of(path) or system.name != "ehsa":
        raise InputError(
            f"--from {base}: the project's controller and scenario need a plant of the system 'ehsa' with a [linear] "
            f"set, and this is one of {system.name!r}; write its files with ehsa-ctrl new plant NAME --from {base}"
        )
    made: tuple[tuple[str, Callable[[], str]], ...] = (
        ("plants/rig.toml", lambda: plant_toml(str(path), "rig")),
        ("controllers/position.toml", lambda: controller_toml(CONTROLLER, "position", plant="rig")),
        ("scenarios/steps.toml", lambda: scenario_toml(SCENARIO, "steps", plant="rig", controller="position")),
    )
    texts: dict[str, str] = {}
    # Each file refers to those before it by name, which the catalogue finds in the working directory.
    with tempfile.TemporaryDirectory() as draft, chdir(draft):
        for place, write in made:
            texts[place] = write()
            Path(place).parent.mkdir()
            Path(place).write_text(texts[place], encoding="utf-8")
    for file in sorted(TEMPLATES.rglob("*.txt")):
        target = file.relative_to(TEMPLATES).with_suffix("")
        content = file.read_text(encoding="utf-8").replace("NAME", name).replace("VERSION", __version__)
        texts[target.as_posix()] = (
            json.dumps(notebook_of(content), indent=1) + "\n" if target.suffix == ".ipynb" else content
        )
    return texts
