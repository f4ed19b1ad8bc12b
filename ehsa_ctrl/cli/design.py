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
class FigureOptions:
    """Figures that the designed loop must reach."""

    bandwidth: Annotated[
        str, typer.Option(help="'30 rad/s': crossover of a pid or cascade, else bandwidth from reference to position.")
    ] = ""
    phase_margin: Annotated[str, typer.Option(help="'60 deg'; makes a pid a classic design.")] = ""
    Ms: Annotated[str, typer.Option("--Ms", help="Largest sensitivity |S|, 1.5.")] = ""
    Mt: Annotated[str, typer.Option("--Mt", help="Largest complementary sensitivity |T|, 1.3.")] = ""
    disk_margin: Annotated[str, typer.Option(help="Least disk margin, 0.7.")] = ""
    noise_gain: Annotated[str, typer.Option(help="Most current per position noise, '8000 A/m'.")] = ""


@dataclass(frozen=True)
class KeyOptions:
    """Keys of the TOML, by options."""

    weight: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Of \\[weights]: position='0.5 mm'. Repeatable.")
    ] = field(default_factory=list)
    limit: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Of \\[limits]: pressure='150 bar'. Repeatable.")
    ] = field(default_factory=list)
    spec: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Any key of the TOML: tuning.minimise=IE. Repeatable.")
    ] = field(default_factory=list)
    current_limit: Annotated[str, typer.Option(help="Largest current, '6 A'.")] = ""
    sample_time: Annotated[str, typer.Option(help="Sample time of the loop, '4 ms'.")] = ""

    def dotted(self) -> dict[str, str]:
        """Dotted key -> text. Raises InputError as `read_pairs`."""
        found = {f"weights.{key}": text for key, text in read_pairs(self.weight, "--weight").items()}
        found |= {f"limits.{key}": text for key, text in read_pairs(self.limit, "--limit").items()}
        found |= read_pairs(self.spec, "--spec")
        return found | {word: text for word in ("current_limit", "sample_time") if (text := getattr(self, word))}


def command(
    plant: PlantArgument,
    kind: Annotated[
        str,
        typer.Option(
            help="pid, cascade, scheduled_pid, lqr, mpc: what `kind` may be in a TOML.", autocompletion=controller_kinds
        ),
    ],
    figure_options: FigureOptions,
    key_options: KeyOptions,
    output: OutputOptions,
    file: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.toml", help="The controller; printed without it.")
    ] = None,
    title: Annotated[str, typer.Option(help="What the controller is for.")] = "",
    base: Annotated[
        str | None,
        typer.Option(
            metavar="C", help="Controller whose other keys it takes; else a shipped one.", autocompletion=controllers
        ),
    ] = None,
    freeze: Annotated[
        bool, typer.Option("--freeze", help="Write a pid's gains instead of the specification they were designed from.")
    ] = False,
    settings: Settings = [],
) -> None:
    """Design a controller on the plant's linear model and write its TOML, with what it reached as comments.

    The file holds the specification: it is designed again on the model of each plant that it is used with.

    Examples: ehsa-ctrl design ehsa --kind pid --Ms 1.5 --noise-gain '8000 A/m' -o mine.toml --out results/mine ·
    ehsa-ctrl design ehsa --kind pid --bandwidth '35 rad/s' --phase-margin '60 deg' -o classic.toml ·
    ehsa-ctrl design ehsa --kind lqr --bandwidth '40 rad/s' --Ms 1.6 --weight current='2 A' -o lqr.toml
    """
    from ..core.catalogue import is_shipped
    from ..core.files import read_toml, refuse_existing, write_text
    from ..design.analysis.closed_loop import step_response
    from ..design.specification import definition_keys, design, split_figures, starting_definition, with_values
    from ..design.tuning.constraints import Tuning
    from ..plant.linear import three_state
    from ..scenario.rescaling import rescaling_to
    from .inputs import load_model

    if file is not None:
        if file.suffix != ".toml":
            raise InputError(f"-o {file}: expected a file that ends in .toml")
        refuse_existing(file, force=output.force)
    output.check("design", "design.json", "report.html", figures=["loop", "nyquist", "step"])
    chosen, begun = starting_definition(kind, base)
    content = read_toml(begun)
    figures = {word: text for word, text in vars(figure_options).items() if text}
    asked = key_options.dotted()
    content["title"] = title or f"{kind} designed for {plant}"
    content.pop("note", None)
    pairs = read_pairs(settings)
    loaded = load_model(plant, "linear", pairs)
    system = three_state(loaded)
    own: dict[str, Any] = {}
    defaults: dict[str, str] = {}
    unscaled: list[str] = []
    # The numbers of a shipped controller are for the shipped EHSA; the plant of a user's own is not known.
    if is_shipped("controllers", begun):
        rescaling = rescaling_to(plant, pairs)
        own, unscaled = rescaling.changes(content, definition_keys(chosen.file)), rescaling.unknown(content)
        content = with_values(content, chosen, {key: str(value) for key, value in own.items()})
        # A [tuning] that the options add has a default of its own.
        tuning = with_values(content, chosen, {**split_figures(chosen, figures)[0], **asked}).get("tuning", {})
        usual = f"{Tuning().noise_gain:g} A/m"
        if tuning and "noise_gain" not in tuning and rescaling.scale("tuning.noise_gain", usual) != usual:
            own["tuning.noise_gain"] = defaults["tuning.noise_gain"] = rescaling.scale("tuning.noise_gain", usual)
    name = file.stem if file is not None else f"{kind}_designed"
    found = design(name, chosen, content, system, figures=figures, values=defaults | asked)
    words = [f"{word} {text}" for word, text in {**figures, **asked}.items()]
    words += [f"{key} = {text}" for key, text in pairs.items()]
    comments = [f"Designed by ehsa-ctrl for {plant}: {', '.join(words) or 'default specification'}."]
    if own:
        scaled = ", ".join(f"{key} {value}" for key, value in own.items() if key not in asked)
        comments.append(f"Begun as {begun.stem}, whose numbers are for the shipped EHSA; for this plant: {scaled}.")
    if unscaled:
        comments.append(f"As in {begun.stem}, because {plant} does not state their scale: {', '.join(unscaled)}.")
    text = (_with_gains(found) if freeze else found).toml([*comments, "On its linear model:"])
    result: dict[str, Any] = {
        "plant": plant,
        "kind": kind,
        "settings": pairs,
        "asked": {**figures, **asked},
        "from_plant": own,
        "controller": str(file) if file is not None else None,
        "definition": found.content,
        "law": str(found.controller.law),
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


def _with_gains(found: ControllerDesign) -> ControllerDesign:
    """The design with its gains in the file. Raises InputError for a law that has none to write."""
    from ..design.kinds.pid import Pid
    from ..design.specification import ALTERNATIVES

    law = found.controller.law
    if not isinstance(law, Pid):
        raise InputError(f"--freeze is for kind = 'pid', which has gains to write; this is {found.controller.kind!r}")
    content = {key: item for key, item in found.content.items() if key not in ALTERNATIVES}
    units = {"k_p": "A/m", "k_i": "A/(m s)", "k_d": "A s/m", "T_f": "s"}
    content["gains"] = {key: f"{getattr(law.gains, key):.9g} {unit}" for key, unit in units.items()}
    return replace(found, content=content)
