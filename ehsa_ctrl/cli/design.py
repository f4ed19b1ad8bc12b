"""`ehsa-ctrl design`: from a specification to a controller file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ..core.errors import InputError
from .complete import controller_kinds, controllers, plants
from .options import Force, Json, Out, Settings, read_pairs


def command(
    plant: Annotated[str, typer.Argument(help="Name of a plant, or the path of its TOML.", autocompletion=plants)],
    kind: Annotated[
        str,
        typer.Option(
            help="pid, cascade, scheduled_pid, lqr, mpc: what `kind` may be in a TOML.", autocompletion=controller_kinds
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.toml", help="The controller; printed without it.")
    ] = None,
    bandwidth: Annotated[
        str, typer.Option(help="'30 rad/s': crossover of a pid or cascade; of others how far x follows.")
    ] = "",
    phase_margin: Annotated[str, typer.Option(help="'60 deg'; makes a pid a classic design.")] = "",
    Ms: Annotated[str, typer.Option("--Ms", help="Largest sensitivity |S|, 1.5.")] = "",
    Mt: Annotated[str, typer.Option("--Mt", help="Largest complementary sensitivity |T|, 1.3.")] = "",
    disk_margin: Annotated[str, typer.Option(help="Least disk margin, 0.7.")] = "",
    noise_gain: Annotated[str, typer.Option(help="Most current per position noise, '8000 A/m'.")] = "",
    weight: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Of \\[weights]: position='0.5 mm'. Repeatable.")
    ] = [],  # noqa: B006 - typer reads the default, nobody changes it
    limit: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Of \\[limits]: pressure='150 bar'. Repeatable.")
    ] = [],  # noqa: B006
    spec: Annotated[
        list[str], typer.Option(metavar="KEY=VALUE", help="Any key of the TOML: tuning.minimise=IE. Repeatable.")
    ] = [],  # noqa: B006
    current_limit: Annotated[str, typer.Option(help="Largest current, '6 A'.")] = "",
    sample_time: Annotated[str, typer.Option(help="Of the loop, '4 ms'.")] = "",
    title: Annotated[str, typer.Option(help="What the controller is for.")] = "",
    base: Annotated[
        str | None,
        typer.Option(
            metavar="C", help="Controller whose other keys it takes; else a shipped one.", autocompletion=controllers
        ),
    ] = None,
    freeze: Annotated[
        bool, typer.Option("--freeze", help="Write a pid's gains instead of what they were designed from.")
    ] = False,
    settings: Settings = [],  # noqa: B006
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Design a controller on the plant's linear model and write its TOML, with what it reached as comments.

    The file holds the specification: it is designed again on the model of each plant that it is used with.

    Examples: ehsa-ctrl design ehsa --kind pid --Ms 1.5 --noise-gain '8000 A/m' -o mine.toml --out results/mine ·
    ehsa-ctrl design ehsa --kind pid --bandwidth '35 rad/s' --phase-margin '60 deg' -o classic.toml ·
    ehsa-ctrl design ehsa --kind lqr --bandwidth '40 rad/s' --Ms 1.6 --weight current='2 A' -o lqr.toml
    """
    from ..core.catalogue import is_shipped
    from ..core.files import read_toml, refuse_existing, write_text
    from ..core.result_folder import ResultFolder
    from ..design.specification import begin, design, keys_for, leaves, put
    from ..design.tuning.constraints import Tuning
    from ..plant.linear import three_state
    from ..plant.load import load_plant
    from ..scenario.rescaling import rescaling_to
    from .output import rests_on, to_json, warn_implausible

    if output is not None and output.suffix != ".toml":
        raise InputError(f"-o {output}: expected a file that ends in .toml")
    if output is not None:
        refuse_existing(output, force=force)
    place = None
    if out is not None:
        place = ResultFolder(out, "design", force).check(
            "design.json", "report.html", figures=["loop", "nyquist", "step"]
        )
    chosen, begun = begin(kind, base)
    content = read_toml(begun)
    given = {
        "bandwidth": bandwidth,
        "phase_margin": phase_margin,
        "Ms": Ms,
        "Mt": Mt,
        "disk_margin": disk_margin,
        "noise_gain": noise_gain,
    }
    figures = {word: text for word, text in given.items() if text}
    asked = {f"weights.{key}": text for key, text in read_pairs(weight, "--weight").items()}
    asked |= {f"limits.{key}": text for key, text in read_pairs(limit, "--limit").items()}
    asked |= read_pairs(spec, "--spec")
    asked |= {key: text for key, text in {"current_limit": current_limit, "sample_time": sample_time}.items() if text}
    name = output.stem if output is not None else f"{kind}_designed"
    content["title"] = title or f"{kind} designed for {plant}"
    content.pop("note", None)
    pairs = read_pairs(settings)
    loaded = load_plant(plant, model="linear", settings=pairs)
    warn_implausible([loaded])
    system = three_state(loaded)
    own: dict[str, Any] = {}
    begins: dict[str, str] = {}
    left: list[str] = []
    # A controller of the user's own was chosen for who knows which plant.
    if is_shipped("controllers", begun):
        to_plant = rescaling_to(plant, pairs)
        own, left = to_plant.changes(content, leaves(chosen.file)), to_plant.unknown(content)
        content = put(content, chosen, {key: str(value) for key, value in own.items()})
        # A [tuning] that the options begin has a default of its own.
        tuning = put(content, chosen, {**keys_for(chosen, figures)[0], **asked}).get("tuning", {})
        usual = f"{Tuning().noise_gain:g} A/m"
        if tuning and "noise_gain" not in tuning and to_plant.scale("tuning.noise_gain", usual) != usual:
            own["tuning.noise_gain"] = begins["tuning.noise_gain"] = to_plant.scale("tuning.noise_gain", usual)
    found = design(name, chosen, content, system, figures=figures, asked=begins | asked)
    words = [f"{word} {text}" for word, text in {**figures, **asked}.items()]
    words += [f"{key} = {text} believed" for key, text in pairs.items()]
    comments = [f"Designed by ehsa-ctrl for {plant}: {', '.join(words) or 'nothing in particular'}."]
    if own:
        said = ", ".join(f"{key} {value}" for key, value in own.items() if key not in asked)
        comments.append(f"Begun as {begun.stem}, whose numbers are for the shipped EHSA; for this plant: {said}.")
    if left:
        comments.append(f"As in {begun.stem}, because {plant} states nothing of it: {', '.join(left)}.")
    comments.append("On its linear model:")
    text = (frozen(found) if freeze else found).toml(comments)
    result: dict[str, Any] = {
        "plant": plant,
        "kind": kind,
        "settings": pairs,
        "asked": {**figures, **asked},
        "from_plant": own,
        "controller": str(output) if output is not None else None,
        "definition": found.content,
        "law": str(found.controller.law),
        "loop": found.loop.to_dict(),
    }
    if output is not None:
        write_text(output, text)
    if place is not None:
        from ..design.analysis.closed_loop import step_response
        from ..report.figures import loop_figure, nyquist_figure, save, step_figure
        from ..report.result_page import write_result_page

        steps = step_response(system, found.controller)
        result |= {"overshoot": steps.overshoot, "settling_time": steps.settling_time}
        result["rests_on"] = rests_on([loaded], [output])
        with place.draft() as draft:
            (draft / "design.json").write_text(to_json(result) + "\n")
            save(loop_figure(found.loop), draft / "loop")
            save(nyquist_figure(found.loop), draft / "nyquist")
            save(step_figure(steps), draft / "step")
            write_result_page(draft, "design.json")
    if as_json:
        print(to_json(result))
        return
    print(text.rstrip() if output is None else f"{found.controller}\n{found.loop}")
    for written in (output, out):
        if written is not None:
            print(f"written to {written}")


def frozen(found: Any) -> Any:
    """The same with its gains in the file. Raises InputError for a law that has none to write."""
    from dataclasses import replace

    from ..design.kinds.pid import Pid
    from ..design.specification import ALTERNATIVES

    law = found.controller.law
    if not isinstance(law, Pid):
        raise InputError(f"--freeze is for kind = 'pid', which has gains to write; this is {found.controller.kind!r}")
    content = {key: item for key, item in found.content.items() if key not in ALTERNATIVES}
    units = {"k_p": "A/m", "k_i": "A/(m s)", "k_d": "A s/m", "T_f": "s"}
    content["gains"] = {key: f"{getattr(law.gains, key):.9g} {unit}" for key, unit in units.items()}
    return replace(found, content=content)
