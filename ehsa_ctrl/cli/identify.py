"""`ehsa-ctrl identify`: from logs to a plant whose numbers one can trust."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError
from .complete import models_or_both, plants, several_symbols, symbols
from .options import (
    Align,
    First,
    Force,
    Json,
    Last,
    Out,
    Resample,
    Rest,
    Settings,
    Zero,
    names,
    read_pairs,
    read_preparation,
)

if TYPE_CHECKING:
    from ..core.log import Log
    from ..identification.identification import Identification
    from ..identification.preparation import Preparation
    from ..identification.refits import EstimateSensitivity
    from ..plant.plant import Plant


def command(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Measured logs: CSV, Parquet or MAT.")],
    plant: Annotated[
        str,
        typer.Option("--plant", help="Name of a plant, or the path of its TOML: start values.", autocompletion=plants),
    ],
    model: Annotated[str, typer.Option(help="linear, nonlinear or both.", autocompletion=models_or_both)] = "nonlinear",
    validate: Annotated[
        list[Path], typer.Option("--validate", metavar="LOG", help="Log that is only scored. Repeatable.")
    ] = [],  # noqa: B006 - typer reads the default, nobody changes it
    settings: Settings = [],  # noqa: B006
    free: Annotated[
        str,
        typer.Option(
            metavar="K_T,beta", help="Estimate these too; also bias.p1, delay.speed.", autocompletion=several_symbols
        ),
    ] = "",
    fix: Annotated[
        str, typer.Option(metavar="M", help="Leave these as they are.", autocompletion=several_symbols)
    ] = "",
    bounds: Annotated[
        list[str],
        typer.Option(
            "--bounds", metavar="KEY=LOW:HIGH", help="Keep a parameter between. Repeatable.", autocompletion=symbols
        ),
    ] = [],  # noqa: B006
    prior: Annotated[
        list[str],
        typer.Option(
            "--prior",
            metavar="KEY[=SD]",
            help="Hold a parameter with this sd (or the file's). Repeatable.",
            autocompletion=symbols,
        ),
    ] = [],  # noqa: B006
    linear: Annotated[
        str, typer.Option(help="Linear set in the written plant: keep, or sliding (derived from the nonlinear one).")
    ] = "keep",
    method: Annotated[
        str | None, typer.Option(help="simulation or balances; by default what the plant's file says.")
    ] = None,
    window: Annotated[
        float | None, typer.Option(metavar="S", help="Length of simulated windows; by default the whole log.")
    ] = None,
    starts: Annotated[int, typer.Option(help="At most so many starts.", min=1)] = 6,
    seed: Annotated[int, typer.Option(help="Of the drawn starts.", min=0)] = 0,
    profiles: Annotated[
        str,
        typer.Option("--profile", metavar="KEYS", help="Profile these parameters too.", autocompletion=several_symbols),
    ] = "",
    assumed: Annotated[
        bool,
        typer.Option(
            "--assumed",
            help="Fit again with each assumed parameter at both ends of its believed range: how far the others move. "
            "Takes about as long as the identification.",
        ),
    ] = False,
    start: First = None,
    stop: Last = None,
    zero: Zero = "",
    rest: Rest = "",
    resample: Resample = None,
    align: Align = "",
    as_json: Json = False,
    out: Out = None,
    force: Force = False,
) -> None:
    """Estimate a plant's free parameters from logs, with their uncertainty, and check them on other logs.

    Examples: ehsa-ctrl identify log.csv --plant ehsa --validate steps.csv --out results/rig ·
    ehsa-ctrl identify a.csv b.csv --plant my/rig.toml --free K_T --prior K_T=0.05 --fix M ·
    ehsa-ctrl identify log.csv --plant ehsa --model both --set load.stiffness=50e3 --out results/rig
    """
    from ..core.result_folder import ResultFolder
    from .output import rests_on, to_json, warn, warn_implausible
    from .progress import compiling, watching

    models = _models(plant, model, read_pairs(settings))
    warn_implausible(models)
    if linear not in ("keep", "sliding"):
        raise InputError(f"--linear {linear!r}: expected keep or sliding")
    if linear == "sliding" and model != "nonlinear":
        raise InputError(f"--linear sliding derives the linear set from the nonlinear one; it does not go with {model}")
    if method not in (None, "simulation", "balances"):
        raise InputError(f"--method {method!r}: expected simulation or balances")
    if set(map(_resolved, validate)) & set(map(_resolved, logs)) and start is None and stop is None:
        raise InputError(f"{validate[0]}: is used for the estimate and to validate it; give another log")
    place, written = None, f"{models[-1].name}_identified.toml"
    if out is not None:
        ends = [f"-{each.model}" for each in models] if len(models) > 1 else [""]
        place = ResultFolder(out, "identify", force).check(
            "identification.json", written, "report.html", *(f"parameters{end}.csv" for end in ends),
            figures=[f"{word}{end}" for word in ("fit", "parameters", "correlation", "residuals") for end in ends],
        )  # fmt: skip
    preparation = read_preparation(start, stop, zero, rest, resample, align)
    results = []
    with compiling(), watching() as watch:
        for nominal in models:
            results.append(
                _one(
                    nominal, logs, validate, preparation, watch,
                    names(free), names(fix), bounds, prior, method, window, starts, seed, names(profiles),
                    nominal is models[0],
                )
            )  # fmt: skip
    answer = {**results[-1][1], "plant": plant, "settings": read_pairs(settings)}
    answer["rests_on"] = rests_on(models, [*logs, *validate])
    drifts = []
    if assumed:
        from ..identification.refits import assumption_sensitivities

        drifts = [assumption_sensitivities(result[0]) for result in results]
        for result, tried in zip(results, drifts, strict=True):
            result[1]["assumed_ranges"] = [drift.to_dict() for drift in tried]
        answer["assumed_ranges"] = results[-1][1]["assumed_ranges"]
    if len(results) > 1:
        answer["models"] = {nominal.model: result[1] for nominal, result in zip(models, results, strict=True)}
    found = [result[0] for result in results]
    findings = dict.fromkeys(str(finding) for each in found for finding in each.findings)
    for finding in findings:
        warn(finding)
    if place is not None:
        with place.draft() as draft:
            _write(draft, found, {**answer, "written": place.folder / written}, linear, drifts)
    if as_json:
        print(to_json(answer))
        for sentence in {sentence for each in found for sentence in each.warnings}:
            warn(sentence)
    else:
        for identification in found:
            print(identification)
        for sentence in answer["untold"]:
            if not any(sentence in finding for finding in findings):
                print(sentence)
        if len(found) > 1:
            print(_models_table(found))
        if out is not None:
            print(f"written to {out}; use it as --plant {out / written}")
    if any(identification.interrupted for identification in found):
        warn("interrupted: what is written is the best so far")
        raise typer.Exit(130)


def _resolved(path: Path) -> Path:
    return path.resolve()


def _models(plant: str, model: str, settings: dict[str, str]) -> list[Plant]:
    """The models to identify; a plant with one model has that one, whatever the default is."""
    from ..plant.load import models_of
    from .compare import load_models

    known = models_of(plant)
    if model == "nonlinear" and known == ("linear",):
        model = "linear"
    return load_models(plant, model, settings)


def _one(
    nominal: Plant,
    logs: list[Path],
    validate: list[Path],
    preparation: Preparation,
    watch: Any,
    free: tuple[str, ...],
    fix: tuple[str, ...],
    bounds: list[str],
    prior: list[str],
    method: Any,
    window: float | None,
    starts: int,
    seed: int,
    profiles: tuple[str, ...],
    tell: bool,
) -> tuple[Identification, dict[str, Any]]:
    """Identify one model; the result and what goes into the JSON."""
    from ..identification.identify import identify
    from ..identification.parameters import read_quantity
    from ..identification.plant_log import missing_information
    from ..identification.refits import profile
    from .prepared import read_prepared, whole

    steps: list[dict[str, Any]] = []
    missing: dict[str, str] = {}

    def ready(path: Path, how: Preparation) -> Log:
        read = read_prepared(path, nominal, how, tell=tell)
        steps.extend(read.stated)
        missing.update(missing_information(read.log, nominal))
        return read.log

    used = [ready(path, preparation) for path in logs]
    held_out = [ready(path, whole(preparation)) for path in validate]
    limits = {}
    for text in bounds:
        key, _, pair = text.partition("=")
        low, colon, high = pair.partition(":")
        if not colon:
            raise InputError(f"--bounds {text!r}: expected KEY=LOW:HIGH, as in --bounds K_T=0.9:1.5")
        limits[key] = (read_quantity(nominal, key, low), read_quantity(nominal, key, high))
    priors: dict[str, float | None] = {}
    for text in prior:
        key, equals, value = text.partition("=")
        priors[key] = read_quantity(nominal, key, value) if equals else None
    found = identify(
        nominal, used, validate=held_out, free=free, fix=fix, bounds=limits, priors=priors, method=method,
        window=window, starts=starts, seed=seed, watch=watch,
    )  # fmt: skip
    answer = {**found.to_dict(), "model": nominal.model, "preparation": steps, "untold": list(missing.values())}
    if profiles:
        lines = [profile(found, name) for name in profiles]
        answer["profiles"] = {
            line.name: {"values": line.values, "rise": line.rise, "interval_95": list(line.interval)} for line in lines
        }
    return found, answer


def _write(
    out: Path,
    found: list[Identification],
    answer: dict[str, Any],
    linear: str,
    drifts: list[tuple[EstimateSensitivity, ...]],
) -> None:
    """Plant, JSON, table, figures and page."""
    from ..identification.plant_toml import sliding_linear, write_plant
    from ..report.figures import (
        correlation_figure,
        identification_figure,
        parameters_figure,
        residuals_figure,
        save,
    )
    from ..report.identification_page import write_identification_page
    from .output import command_line, to_json

    plants = [each.plant for each in found]
    if linear == "sliding":
        plants.insert(0, sliding_linear(plants[0]))
    write_plant(out / Path(answer["written"]).name, *plants)
    (out / "identification.json").write_text(to_json(answer) + "\n")
    for each in found:
        suffix = f"-{each.plant.model}" if len(found) > 1 else ""
        each.to_pandas().to_csv(out / f"parameters{suffix}.csv")
        save(identification_figure(each), out / f"fit{suffix}")
        save(parameters_figure(each), out / f"parameters{suffix}")
        if each.method == "simulation":
            save(correlation_figure(each), out / f"correlation{suffix}")
        if each.residual_tests:
            save(residuals_figure(each), out / f"residuals{suffix}")
    write_identification_page(found, out, command=command_line(), drifts=drifts)


def _models_table(found: list[Identification]) -> str:
    """Fit in free run, a row a channel and a log's use, a column a model."""
    from ..identification.comparison import fit_cell

    lines = ["fit in free run, %     " + "".join(f"{each.plant.model:>12}" for each in found)]
    for word in ("train", "validation"):
        reaches = [getattr(each, word) for each in found]
        for channel in reaches[0].fit_percent:
            cells = "".join(f"{fit_cell(reach.fit_percent[channel]):>12}" for reach in reaches)
            lines.append(f"  {'used' if word == 'train' else 'held out':<9}{channel:<12}{cells}")
    return "\n".join(lines)
