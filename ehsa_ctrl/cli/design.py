"""`ehsa-ctrl design`: from a specification to a controller file."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError
from .complete import controller_kinds, controllers
from .options import PlantArgument, Settings, read_pairs
from .output import OutputOptions, provenance

if TYPE_CHECKING:
    from ..design.specification import ControllerDesign


@dataclass(frozen=True)
class SpecificationOptions:
    """What the designed loop must reach."""

    bandwidth: Annotated[
        str,
        typer.Option(
            help="Crossover of a pid or cascade, key `bandwidth` of a kind that has one, otherwise bandwidth from "
            "reference to position, e.g. '5 Hz' or '30 rad/s'."
        ),
    ] = ""
    phase_margin: Annotated[
        str, typer.Option(help="Phase margin, e.g. '60 deg'; a pid is then loop-shaped instead of optimised.")
    ] = ""
    Ms: Annotated[str, typer.Option("--Ms", help="Largest sensitivity |S|, e.g. 1.5.")] = ""
    Mt: Annotated[str, typer.Option("--Mt", help="Largest complementary sensitivity |T|, e.g. 1.3.")] = ""
    disk_margin: Annotated[str, typer.Option(help="Least disk margin, e.g. 0.7.")] = ""
    noise_gain: Annotated[str, typer.Option(help="Largest current noise per position noise, e.g. '8000 A/m'.")] = ""


@dataclass(frozen=True)
class KeyOptions:
    """Keys of the controller's TOML."""

    weight: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Key of \\[weights]: position='0.5 mm'. Repeatable.")
    ] = field(default_factory=list)
    limit: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Key of \\[limits]: pressure='150 bar'. Repeatable.")
    ] = field(default_factory=list)
    spec: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Any key of the TOML: tuning.minimise=IE. Repeatable.")
    ] = field(default_factory=list)
    current_limit: Annotated[str, typer.Option(help="Largest current, e.g. '6 A'.")] = ""
    sample_time: Annotated[str, typer.Option(help="Sample time of the loop, e.g. '4 ms'.")] = ""

    def dotted(self) -> dict[str, str]:
        """Dotted key -> text. Raises InputError as `read_pairs` does."""
        found = {f"weights.{key}": text for key, text in read_pairs(self.weight, "--weight").items()}
        found |= {f"limits.{key}": text for key, text in read_pairs(self.limit, "--limit").items()}
        found |= read_pairs(self.spec, "--spec")
        return found | {word: text for word in ("current_limit", "sample_time") if (text := getattr(self, word))}


def command(
    plant: PlantArgument,
    kind: Annotated[
        str,
        typer.Option(help="Kind of controller, out of `ehsa-ctrl list kinds`.", autocompletion=controller_kinds),
    ],
    specification: SpecificationOptions,
    key_options: KeyOptions,
    output: OutputOptions,
    file: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="FILE.toml", help="File for the controller; by default it is printed."),
    ] = None,
    title: Annotated[str, typer.Option(help="Title of the controller.")] = "",
    base: Annotated[
        str | None,
        typer.Option(
            metavar="C",
            help="Controller to take all other keys from; by default a shipped one of this kind.",
            autocompletion=controllers,
        ),
    ] = None,
    freeze: Annotated[
        bool, typer.Option("--freeze", help="Write a pid's gains instead of their specification.")
    ] = False,
    tune: Annotated[
        bool,
        typer.Option(
            "--tune",
            help="Choose the kind's main keys for the least ITAE of a load step within --Ms, --Mt, --disk-margin and "
            "--noise-gain or their defaults; keys that are given stay.",
        ),
    ] = False,
    settings: Settings = [],
) -> None:
    """Design a controller on the plant's linear model and write its TOML, with its margins as comments.

    The TOML holds the specification: each plant that uses it gets a design on its own linear model.

    Examples: ehsa-ctrl design ehsa --kind pid --Ms 1.5 --noise-gain '8000 A/m' -o mine.toml --out results/mine ·
    ehsa-ctrl design ehsa --kind pid --bandwidth '35 rad/s' --phase-margin '60 deg' -o classic.toml ·
    ehsa-ctrl design ehsa --kind lqr --bandwidth '40 rad/s' --Ms 1.6 --weight current='2 A' -o lqr.toml ·
    ehsa-ctrl design ehsa --kind adrc --tune --Ms 1.4 -o adrc.toml
    """
    from ..core.definition import validate
    from ..core.files import read_toml, refuse_existing, write_text
    from ..design.analysis.closed_loop import step_response
    from ..design.load import read_content
    from ..design.specification import (
        definition_keys,
        design,
        parse_value,
        split_figures,
        starting_definition,
        with_values,
        without_keys,
    )
    from ..design.tuning.constraints import Tuning
    from ..plant.conditions import linear_model
    from ..plant.load import load_plant, models_of
    from ..scenario.plant_data import check_controller_limits
    from ..scenario.rescaling import is_for_shipped_ehsa, rescaling_to
    from .inputs import load_model

    if file is not None:
        if file.suffix != ".toml":
            raise InputError(f"-o {file}: expected a file that ends in .toml")
        refuse_existing(file, force=output.force)
    output.check("design", "design.json", "report.html", figures=["loop", "nyquist", "step"])
    chosen, begun = starting_definition(kind, base)
    content = read_toml(begun)
    figures = {word: text for word, text in vars(specification).items() if text}
    asked = key_options.dotted()
    content["title"] = title or f"{kind} designed for {plant}"
    content.pop("note", None)
    pairs = read_pairs(settings)
    if reason := load_plant(plant, model=models_of(plant)[0]).structure.system.no_controller:
        raise InputError(f"{plant}: {reason}; controllers are for plants whose drive a controller computes")
    loaded = load_model(plant, "linear", pairs)
    system, drive_unit = linear_model(loaded), loaded.structure.system.drive_unit
    if drive_unit != "A" and base is None and "current_limit" not in asked:
        raise InputError(
            f"{plant}: its drive is in {drive_unit}, the shipped controllers are in A; give the largest drive, such as "
            f"--current-limit '100 {drive_unit}', which scales the others"
        )
    own: dict[str, Any] = {}
    defaults: dict[str, str] = {}
    unscaled: list[str] = []
    foreign: list[str] = []
    rescaling = rescaling_to(plant, pairs)
    # The numbers of a shipped controller are for the shipped EHSA; which plant a user's controller is for is unknown.
    if is_for_shipped_ehsa(begun):
        if drive_unit != "A" and "current_limit" in asked:
            try:
                rescaling = rescaling.to_drive(
                    content["current_limit"], asked["current_limit"], drive_unit, chosen.file
                )
            except InputError as error:
                raise InputError(f"--current-limit {asked['current_limit']!r}: {error}") from None
        foreign = [key for key in rescaling.foreign(content) if key not in asked]
        content = without_keys(content, foreign)
        own, unscaled = rescaling.changes(content, definition_keys(chosen.file)), rescaling.unknown(content)
        content = with_values(content, chosen, {key: str(value) for key, value in own.items()})
        # If the options add a [tuning], the default of its noise_gain is for the shipped EHSA too.
        tuning = with_values(content, chosen, {**split_figures(chosen, figures)[0], **asked}).get("tuning", {})
        usual = f"{Tuning().noise_gain:g} A/m"
        if tuning and "noise_gain" not in tuning and rescaling.scale("tuning.noise_gain", usual) != usual:
            own["tuning.noise_gain"] = defaults["tuning.noise_gain"] = rescaling.scale("tuning.noise_gain", usual)
    name = file.stem if file is not None else f"{kind}_designed"
    bounds = None
    if tune:
        usual = rescaling.scale("tuning.noise_gain", f"{Tuning().noise_gain:g} A/m")
        if drive_unit != "A" and rescaling.drive is None and "noise_gain" not in figures:
            raise InputError(f"--tune: give the bound on the drive's noise, such as --noise-gain '1e5 {drive_unit}/m'")
        names = ("Ms", "Mt", "disk_margin", "noise_gain")
        given = {"noise_gain": usual} | {word: figures[word] for word in names if word in figures}
        values = {key: parse_value(text) for key, text in given.items()}
        bounds = validate(values, Tuning, "--tune", context={"drive_unit": drive_unit})
    found = design(name, chosen, content, system, figures=figures, values=defaults | asked, tuning=bounds)
    check_controller_limits(name, read_content(found.content, name, loaded.sample_time, drive_unit)[1], loaded)
    words = [f"{word} {text}" for word, text in {**figures, **asked}.items()]
    words += ["tuned"] * tune
    words += [f"{key} = {text}" for key, text in pairs.items()]
    comments = [f"Designed by ehsa-ctrl for {plant}: {', '.join(words) or 'default specification'}."]
    if own:
        scaled = ", ".join(f"{key} {value}" for key, value in own.items() if key not in asked)
        comments.append(f"Started from {begun.stem}, a controller of the shipped EHSA; for this plant: {scaled}.")
    if foreign:
        comments.append(f"Without those keys of {begun.stem} that are the shipped EHSA's own: {', '.join(foreign)}.")
    if unscaled:
        comments.append(f"As in {begun.stem}, because {plant} gives no scale for them: {', '.join(unscaled)}.")
    text = (_with_gains(found, drive_unit) if freeze else found).toml([*comments, "On its linear model:"])
    result: dict[str, Any] = {
        "plant": plant,
        "kind": kind,
        "settings": pairs,
        "asked": {**figures, **asked},
        "from_plant": own,
        "controller": str(file) if file is not None else None,
        "definition": found.content,
        "law": found.controller.law_words,
        "loop": found.loop,
    }
    if file is not None:
        write_text(file, text)
    steps = step_response(system, found.controller) if output.out is not None else None
    if steps is not None:
        result |= {"overshoot": steps.overshoot, "settling_time": steps.settling_time}
        result["rests_on"] = provenance([loaded], [file])

    def write_files(draft: Path) -> None:
        from ..report.figures import loop_figure, nyquist_figure, save, step_figure

        assert steps is not None
        save(loop_figure(found.loop), draft / "loop")
        save(nyquist_figure(found.loop), draft / "nyquist")
        save(step_figure(steps), draft / "step")

    def print_result() -> None:
        if file is None:
            print(text.rstrip())
        else:
            print(f"{found.controller}\n{found.loop}\nwritten to {file}")

    output.deliver("design", "design.json", result, print_result, files=write_files)


def _with_gains(found: ControllerDesign, drive_unit: str) -> ControllerDesign:
    """The design with its gains in the file; drive_unit: SI unit of the drive.

    Raises InputError for a controller that is not a pid.
    """
    from ..design.kinds.pid import Pid
    from ..design.specification import ALTERNATIVES

    law = found.controller.law
    if not isinstance(law, Pid):
        raise InputError(f"--freeze is for kind = 'pid', but this kind is {found.controller.kind!r}; leave it out")
    content = {key: item for key, item in found.content.items() if key not in ALTERNATIVES}
    units = {"k_p": f"{drive_unit}/m", "k_i": f"{drive_unit}/(m s)", "k_d": f"{drive_unit} s/m", "T_f": "s"}
    content["gains"] = {key: f"{getattr(law.gains, key):.9g} {unit}" for key, unit in units.items()}
    return replace(found, content=content)
