"""`ehsa-ctrl new`: write a commented TOML to the folder where commands find it by name."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError
from .complete import controller_kinds, controllers, plants, reference_kinds, scenarios
from .options import Force, Json

if TYPE_CHECKING:
    from ..core.catalogue import Catalogue

app = typer.Typer(
    help="Write a commented TOML of your own: plant, controller or scenario.\n\n"
    "Examples: ehsa-ctrl new plant rig · ehsa-ctrl new controller mine --kind lqr · ehsa-ctrl new scenario press "
    "--kind moves --plant rig --controller mine",
    no_args_is_help=True,
)

Name = Annotated[
    str | None,
    typer.Argument(metavar="[NAME]", help="Name of the file without .toml; by default my_ and the name of its base."),
]


@app.command("plant")
def plant(
    name: Name = None,
    base: Annotated[
        str, typer.Option("--from", metavar="PLANT", help="Plant to start from.", autocompletion=plants)
    ] = "ehsa",
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write ./plants/NAME.toml: every parameter with unit, meaning, range; sensors, limits, effects, columns of logs.

    Examples: ehsa-ctrl new plant rig · ehsa-ctrl new plant axis --from emps
    """
    from ..core.catalogue import plants as catalogue
    from .definitions import plant_commands, plant_toml

    stem = _stem(name, catalogue, base)
    commands = plant_commands(base, stem)
    _write(catalogue, stem, base, lambda: plant_toml(base, stem), commands, as_json=as_json, force=force)


@app.command("controller")
def controller(
    name: Name = None,
    kind: Annotated[
        str | None,
        typer.Option(help="Kind, out of `ehsa-ctrl list kinds`.", autocompletion=controller_kinds),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option("--from", metavar="CONTROLLER", help="Controller to start from.", autocompletion=controllers),
    ] = None,
    plant: Annotated[
        str | None,
        typer.Option(help="Plant that gives limits, sample time and scales; by default ehsa.", autocompletion=plants),
    ] = None,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write ./controllers/NAME.toml: every key of its kind with unit and meaning, optional ones switched off.

    Examples: ehsa-ctrl new controller mine --kind pid · ehsa-ctrl new controller calm --from lqr_friction ·
    ehsa-ctrl new controller strong --kind mpc --plant rig
    """
    from ..core.catalogue import controllers as catalogue
    from ..design.kinds import CONTROLLER_KINDS
    from ..design.specification import example_of, starting_definition
    from .definitions import controller_commands, controller_of_form, controller_toml

    if kind in CONTROLLER_KINDS and base is None and example_of(kind) is None:
        stem, start = _stem(name, catalogue, kind), f"the keys of the kind {kind!r}"
        text = partial(controller_of_form, kind, stem, plant=plant)
    else:
        start = starting_definition(kind, base)[1].stem if kind is not None else base or "pid_position"
        stem = _stem(name, catalogue, kind or start)
        text = partial(controller_toml, base or start, stem, plant=plant)
    _write(catalogue, stem, start, text, controller_commands(stem, plant), as_json=as_json, force=force)


@app.command("scenario")
def scenario(
    name: Name = None,
    kind: Annotated[
        str | None,
        typer.Option(
            help="Kind of the reference: steps, moves, ramp, sine, trapezoid or file.", autocompletion=reference_kinds
        ),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option("--from", metavar="SCENARIO", help="Scenario to start from.", autocompletion=scenarios),
    ] = None,
    plant: Annotated[
        str | None, typer.Option(help="Plant of the scenario; by default that of the base.", autocompletion=plants)
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(help="Controller of the scenario; by default that of the base.", autocompletion=controllers),
    ] = None,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Write ./scenarios/NAME.toml: reference, load, faults, sensors and a limit on any metric, each with its meaning.

    Examples: ehsa-ctrl new scenario mine · ehsa-ctrl new scenario press --kind moves --plant rig --controller mine ·
    ehsa-ctrl new scenario lost --from fault_lost_position
    """
    from ..core.catalogue import controllers as known_controllers
    from ..core.catalogue import plants as known_plants
    from ..core.catalogue import scenarios as catalogue
    from ..scenario.definition import load_scenario
    from .definitions import scenario_commands, scenario_of_kind, scenario_toml

    if kind is not None and base is not None:
        found = load_scenario(base).definition.reference.kind
        if found != kind:
            raise InputError(
                f"--kind {kind}: the reference of {base} is of the kind {found!r}; give either --kind or --from"
            )
    chosen = base or scenario_of_kind(kind or "steps")
    stem = _stem(name, catalogue, kind or chosen)
    for known, given in ((known_plants, plant), (known_controllers, controller)):
        if given is not None:
            known.find(given)
    begun = load_scenario(chosen)
    file = getattr(begun.definition.reference, "file", None)
    beside = []
    if file is not None and not Path(file).is_absolute() and begun.path is not None:
        beside.append((begun.path.parent / file, Path("scenarios") / file))
    text = partial(scenario_toml, chosen, stem, plant=plant, controller=controller)
    _write(catalogue, stem, chosen, text, scenario_commands(stem), beside=beside, as_json=as_json, force=force)


def _stem(name: str | None, catalogue: Catalogue, base: str) -> str:
    """Name of the file. Raises InputError for a path, and for a name that commands could not take."""
    stem = f"my_{Path(base).stem}" if name is None else name.removesuffix(".toml")
    if not re.fullmatch(r"\w[\w-]*", stem):
        raise InputError(
            f"{name!r} is not a valid name; use letters, digits, _ and -, and no folder: the file goes to "
            f"{catalogue.kind}/"
        )
    return stem


def _write(
    catalogue: Catalogue,
    stem: str,
    base: str,
    text: Callable[[], str],
    following: list[str],
    *,
    as_json: bool,
    force: bool,
    beside: Sequence[tuple[Path, Path]] = (),
) -> None:
    """Write the file and those that it refers to, and print the next commands."""
    from ..core.files import atomic_write, refuse_existing, write_text
    from .output import to_json, warn

    path = Path(catalogue.kind) / f"{stem}.toml"
    refuse_existing(path, force=force)
    shadowed = stem in catalogue and catalogue[stem].resolve() != path.resolve()
    content = text()
    for source, target in beside:
        if not target.exists():
            with atomic_write(target) as draft:
                shutil.copyfile(source, draft)
    write_text(path, content)
    if shadowed:
        warn(f"in this folder, {stem} now hides the shipped {catalogue.kind[:-1]} of the same name")
    if as_json:
        files = [str(path), *(str(target) for _, target in beside)]
        print(to_json({"written": files, "from": base, "next": following}))
        return
    print(f"written to {path}, started from {base}; edit it, then")
    print("\n".join(f"  {line}" for line in following))
