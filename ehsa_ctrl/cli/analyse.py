"""`ehsa-ctrl analyse`: the linear model and its loops, through python-control, and the worst case over many plants."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError
from .complete import several_controllers
from .options import OneModel, PlantArgument, Settings, read_pairs, split_names
from .output import OutputOptions, provenance

if TYPE_CHECKING:
    from ..design.review import Known
    from ..plant.plant import Plant


def command(
    plant: PlantArgument,
    output: OutputOptions,
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="A[,B]",
            help="Controllers (names or files) whose loops are analysed.",
            autocompletion=several_controllers,
        ),
    ] = None,
    model: Annotated[
        OneModel | None,
        typer.Option(
            help="linear: the plant's linear set; nonlinear: its nonlinear set, linearised during sliding. By default "
            "the linear one, if the plant has one."
        ),
    ] = None,
    position: Annotated[
        str, typer.Option(help="Rod positions of the operating points, m; for --model nonlinear, e.g. '0,50 mm'.")
    ] = "0",
    velocity: Annotated[
        str, typer.Option(help="Rod velocities of the operating points, m/s; for --model nonlinear.")
    ] = "0.05",
    stiffness: Annotated[
        str, typer.Option(help="Load stiffnesses to check the loop with, N/m, e.g. '0,50 kN/m,100 kN/m'.")
    ] = "",
    mass: Annotated[str, typer.Option(help="Load masses to check the loop with, kg, e.g. '0,100 kg'.")] = "",
    draws: Annotated[int, typer.Option(min=0, help="Number of plants drawn from the parameters' uncertainty.")] = 0,
    covariance: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw from the covariance of this identification.json.")
    ] = None,
    spread: Annotated[
        float, typer.Option(min=0, help="Relative sd of identified parameters whose file states none.")
    ] = 0.05,
    assumed: Annotated[
        bool, typer.Option("--assumed", help="Also draw assumed parameters, uniformly between their bounds.")
    ] = False,
    lag: Annotated[int, typer.Option(min=0, help="Samples of delay between measurement and current.")] = 0,
    review: Annotated[bool, typer.Option("--review", help="Review each design, including friction.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the draws.")] = 0,
    settings: Settings = [],
) -> None:
    """Compute poles, zeros, damping, DC gains and Bode figure of the plant's linear model; margins of its loops.

    With --draws or several operating conditions, also find the plant with the worst margins.

    Examples: ehsa-ctrl analyse ehsa · ehsa-ctrl analyse ehsa --controller pid_position --out results/loop ·
    ehsa-ctrl analyse ehsa --controller pid_position,lqr_position --draws 200 --stiffness '0,50 kN/m,100 kN/m' --review
    """
    from ..core.catalogue import controllers
    from ..design.analysis.loop import analyse_loop
    from ..design.analysis.robustness import robust_margins
    from ..design.analysis.system import analyse
    from ..design.load import load_controller
    from ..design.review import review as review_design
    from ..plant.conditions import conditions
    from ..plant.draws import draw, drawn_models, read_covariance
    from ..plant.load import models_of
    from .inputs import load_model

    model = model or ("linear" if "linear" in models_of(plant) else "nonlinear")
    names = split_names(controller or "")
    at = conditions(
        positions=_quantities("--position", position, "m"),
        velocities=_quantities("--velocity", velocity, "m/s"),
        stiffnesses=_quantities("--stiffness", stiffness, "N/m"),
        masses=_quantities("--mass", mass, "kg"),
    )
    many = bool(draws) or len(at) > 1 or bool(stiffness or mass)
    if (many or review or lag) and not names:
        raise InputError(
            "--draws, --stiffness, --mass, --lag, --review and several operating points analyse a loop; name its "
            "controller with --controller"
        )
    if covariance is not None and not draws:
        raise InputError("--covariance is for drawing plants; give their number with --draws")
    ends = [f"-{Path(name).stem}" for name in names] if len(names) > 1 else [""] * len(names)
    figures = ["bode", *(f"{word}{end}" for word in ("loop", "nyquist") for end in ends)]
    output.check("analyse", "analysis.json", "report.html", figures=figures)
    pairs = read_pairs(settings)
    loaded = load_model(plant, model, pairs)
    system = conditions(positions=[at[0].position], velocities=[at[0].velocity])[0].model(loaded)
    unit = loaded.structure.system.drive_unit
    analysis = analyse(system, drive_unit=unit)
    if names and loaded.structure.system.no_controller:
        raise InputError(f"{loaded.name}: {loaded.structure.system.no_controller}; leave --controller out")
    known = _known(plant, loaded, pairs)
    systems = {}
    if many:
        matrix = read_covariance(covariance) if covariance is not None else None
        drawn = draw(loaded, draws, seed=seed, covariance=matrix, unknown=spread, assumed=assumed) if draws else []
        systems = drawn_models(loaded, drawn, at)
    loops, robust, reviews = [], [], []
    for name in names:
        chosen = load_controller(name, system, sample_time=loaded.sample_time)
        loops.append(analyse_loop(system, chosen, lag=lag, noise=known.noise))
        robust.append(robust_margins(systems, chosen, lag=lag) if systems else None)
        if review:
            reviews.append(review_design(system, chosen, known=known, robust=robust[-1], lag=lag))
    result: dict[str, Any] = {"plant": plant, "model": model, **analysis.to_dict()}
    if loops:
        result |= {"loop": loops[0], "loops": loops}
    if many:
        result["robust"] = [margins for margins in robust if margins is not None]
    if review:
        result["reviews"] = reviews
    if output.out is not None:
        result["rests_on"] = provenance([loaded], [*map(controllers.find, names), covariance])

    def write_files(draft: Path) -> None:
        from ..report.figures import bode_figure, loop_figure, nyquist_figure, robustness_figure, save

        save(bode_figure(analysis), draft / "bode")
        for loop, margins in zip(loops, robust, strict=True):
            end = f"-{loop.controller}" if len(loops) > 1 else ""
            save(loop_figure(loop), draft / f"loop{end}")
            save(nyquist_figure(loop, margins), draft / f"nyquist{end}")
            if margins is not None and any(one.stable for one in margins.loops.values()):
                save(robustness_figure(margins), draft / f"robustness{end}")
                margins.to_pandas().to_csv(draft / f"robustness{end}.csv")

    def print_result() -> None:
        print(analysis)
        for k, loop in enumerate(loops):
            for shown in (loop, robust[k], *reviews[k : k + 1]):
                if shown is not None:
                    print(shown)

    output.deliver("analyse", "analysis.json", result, print_result, files=write_files)


def _quantities(option: str, text: str, unit: str) -> list[float]:
    """Turn "0,50 kN/m" into [0.0, 50e3]. Raises InputError naming the option."""
    from ..core.unit import parse

    values = []
    for part in split_names(text):
        try:
            values.append(float(part))
        except ValueError:
            try:
                values.append(parse(part, unit))
            except InputError as error:
                raise InputError(f"{option} {text!r}: {error}") from None
    return values


def _known(name: str, plant: Plant, settings: dict[str, str]) -> Known:
    """Friction and noise for a review, from the nonlinear set if the file has one."""
    from ..plant.load import load_plant, models_of
    from ..scenario.plant_data import known_of

    if "nonlinear" not in models_of(name):
        return known_of(plant)
    symbols = load_plant(name).parameters
    return known_of(load_plant(name, settings={key: value for key, value in settings.items() if key in symbols}))
