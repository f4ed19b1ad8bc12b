"""`ehsa-ctrl effects`: what is known of the effects of a project's TOML files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import InputError
from .options import Json, LogOptions, NominalModel, PlantOption, Settings, Threshold, expand_groups, read_pairs
from .output import to_json

app = typer.Typer(
    help="Effects of a project's TOML files.\n\nExample: ehsa-ctrl effects confirm my_law second.csv --plant ehsa",
    no_args_is_help=True,
)


@app.callback()
def effects() -> None:
    """Keep `confirm` a command of its own, although it is the only one."""


@app.command("confirm")
@expand_groups
def confirm(
    name: Annotated[str, typer.Argument(help="Effect, or its file effects/NAME.toml; it is known where its plant is.")],
    logs: Annotated[list[Path], typer.Argument(help="Further logs of the rig: another load or waveform.")],
    plant: PlantOption,
    preparation: LogOptions,
    model: NominalModel = "nonlinear",
    settings: Settings = [],
    threshold: Threshold = 0.03,
    as_json: Json = False,
) -> None:
    """Test a proposed law on further logs; if they confirm it, its file says so: status, hashes and ranges.

    The law is simulated in free run as proposed, and with its numbers refitted. Refused are logs from which it was
    found, a law that hardly acts, gains nothing or changes its size in them, and one that the catalogue beats. All else
    in the file stays as it is, with its comments.

    Exit status: 0 confirmed, 1 refused, 2 wrong input.

    Examples: ehsa-ctrl effects confirm drag second.csv --plant ehsa · ehsa-ctrl effects confirm
    results/effects/proposed_force_v_3fa20c.toml spring.csv --plant ehsa --set load.stiffness=50e3
    """
    from ..core.registry import add_project
    from ..diagnosis.law.confirm import confirm_law, law_effect
    from .inputs import load_model, read_prepared
    from .progress import compiling, counting

    file = Path(name)
    if file.suffix == ".toml":
        if not file.is_file():
            raise InputError(f"{file}: no such file; give the effect's file, or its name")
        add_project(file)
        name = file.stem
    for path in logs:
        if path.suffix == ".toml":
            raise InputError(f"{path}: is no log; give the effect's file first, then the logs")
    nominal = load_model(plant, model, read_pairs(settings))
    own = law_effect(name).law
    assert own is not None
    if not os.access(Path(own.where).parent, os.W_OK):
        raise InputError(
            f"{own.where}: its folder is not writable, so that the file could not say that the law is confirmed; copy "
            "the file to effects/ of a project of yours"
        )
    how = preparation.preparation()
    with compiling(), counting() as watch:
        ready = [read_prepared(path, nominal, how).log for path in logs]
        found = confirm_law(nominal, name, ready, threshold=threshold, watch=watch)
    if found.confirmed:
        found.write()
    if as_json:
        print(to_json(found.to_dict()))
    else:
        print(found)
        if found.confirmed:
            print(f"written to {found.file}")
    if not found.confirmed:
        raise typer.Exit(1)
