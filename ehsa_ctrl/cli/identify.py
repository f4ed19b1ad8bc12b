"""`ehsa-ctrl identify`: estimate a plant's parameters from logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..core.errors import InputError
from ..core.result import as_dict
from .complete import plants, several_symbols, symbols
from .options import LogOptions, LogSettings, Models, Settings, read_pairs, settings_by_log, split_names
from .output import OutputOptions, provenance, warn

if TYPE_CHECKING:
    from ..core.log import Log
    from ..identification.identification import Identification
    from ..identification.preparation import Preparation
    from ..plant.plant import Plant


@dataclass(frozen=True)
class FitOptions:
    """Estimated parameters and method."""

    free: Annotated[
        str,
        typer.Option(
            metavar="K_T,beta",
            help="Further parameters to estimate; also sensor errors: bias.p1, delay.speed.",
            autocompletion=several_symbols,
        ),
    ] = ""
    fix: Annotated[str, typer.Option(metavar="M", help="Parameters to keep fixed.", autocompletion=several_symbols)] = (
        ""
    )
    bounds: Annotated[
        list[str],
        typer.Option(
            "--bounds", metavar="KEY=LOW:HIGH", help="Bounds of a parameter. Repeatable.", autocompletion=symbols
        ),
    ] = field(default_factory=list)
    prior: Annotated[
        list[str],
        typer.Option(
            "--prior",
            metavar="KEY[=SD]",
            help="Prior of a parameter with this sd, by default the file's. Repeatable.",
            autocompletion=symbols,
        ),
    ] = field(default_factory=list)
    method: Annotated[
        Literal["simulation", "balances"] | None, typer.Option(help="Method; by default that of the plant's file.")
    ] = None
    window: Annotated[
        float | None, typer.Option(metavar="S", help="Length of simulated windows; by default the whole log.")
    ] = None
    starts: Annotated[
        int,
        typer.Option(help="Largest number of starting points; a few more near the best if no two agree.", min=1),
    ] = 6
    seed: Annotated[int, typer.Option(help="Seed of the random starting points.", min=0)] = 0

    def arguments(self, plant: Plant) -> dict[str, Any]:
        """Keyword arguments of `identify`. Raises InputError for malformed bounds and priors."""
        from ..identification.parameters import read_quantity

        bounds = {}
        for text in self.bounds:
            key, _, pair = text.partition("=")
            low, colon, high = pair.partition(":")
            if not colon:
                raise InputError(f"--bounds {text!r}: expected KEY=LOW:HIGH, as in --bounds K_T=0.9:1.5")
            bounds[key] = (read_quantity(plant, key, low), read_quantity(plant, key, high))
        priors = {}
        for text in self.prior:
            key, equals, value = text.partition("=")
            priors[key] = read_quantity(plant, key, value) if equals else None
        found = {name: getattr(self, name) for name in ("method", "window", "starts", "seed")}
        return {
            **found, "free": split_names(self.free), "fix": split_names(self.fix), "bounds": bounds, "priors": priors
        }  # fmt: skip


def command(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Measured logs: CSV, TDMS, MDF, MCAP, MAT ...")],
    plant: Annotated[
        str,
        typer.Option(
            "--plant", help="Plant with the start values: its name, or the path of its TOML.", autocompletion=plants
        ),
    ],
    fit: FitOptions,
    preparation: LogOptions,
    output: OutputOptions,
    model: Models = "nonlinear",
    validate: Annotated[
        list[Path], typer.Option("--validate", metavar="LOG", help="Log for validation only. Repeatable.")
    ] = [],
    settings: Settings = [],
    linear: Annotated[
        Literal["keep", "sliding"],
        typer.Option(help="Linear set of the written plant: kept, or derived from the nonlinear set while sliding."),
    ] = "keep",
    profiles: Annotated[
        str,
        typer.Option(
            "--profile",
            metavar="KEYS",
            help="Parameters whose cost profile and 95 % interval are computed.",
            autocompletion=several_symbols,
        ),
    ] = "",
    log_settings: LogSettings = [],
    assumed: Annotated[
        bool,
        typer.Option(
            "--assumed",
            help="Fit again with each assumed parameter at both ends of its plausible range, to see how far the "
            "estimates move. Takes about as long as the identification.",
        ),
    ] = False,
) -> None:
    """Estimate a plant's free parameters from logs, with their uncertainty, and validate them on other logs.

    Examples: ehsa-ctrl identify log.csv --plant ehsa --validate steps.csv --out results/rig ·
    ehsa-ctrl identify a.csv b.csv --plant my/rig.toml --free K_T --prior K_T=0.05 --fix M ·
    ehsa-ctrl identify log.csv --plant ehsa --model both --set load.stiffness=50e3 --out results/rig
    """
    from ..identification.refits import assumption_sensitivities
    from ..plant.load import models_of
    from ..report.kinds.identification import DRAWN, fit_stem
    from .inputs import fit_table, load_models
    from .progress import compiling, watching

    pairs = read_pairs(settings)
    # For a plant with only a linear model, the default "nonlinear" means that one.
    only_linear = model == "nonlinear" and models_of(plant) == ("linear",)
    models = load_models(plant, "linear" if only_linear else model, pairs)
    if linear == "sliding" and model != "nonlinear":
        raise InputError(
            f"--linear sliding derives the linear set from the nonlinear one; use --model nonlinear, not {model}"
        )
    used = {path.resolve() for path in logs}
    shared = [path for path in validate if path.resolve() in used]
    if shared and preparation.start is None and preparation.stop is None:
        raise InputError(f"{shared[0]}: is used for both estimation and validation; give --validate another log")
    plant_file = f"{models[-1].name}_identified.toml"
    ends = [f"-{each.model}" for each in models] if len(models) > 1 else [""]
    fits = [fit_stem(end, k) for end in ends for k in range(min(len(validate or logs), DRAWN))]
    output.check(
        "identify", "identification.json", plant_file, "report.html", *(f"parameters{end}.csv" for end in ends),
        *(f"{stem}.csv" for stem in fits),
        figures=[*(f"{word}{end}" for word in ("parameters", "correlation", "residuals") for end in ends), *fits],
    )  # fmt: skip
    how = preparation.preparation()
    own = settings_by_log(log_settings, [*logs, *validate])
    found: list[Identification] = []
    answers: list[dict[str, Any]] = []
    with compiling(), watching() as watch:
        for each in models:
            identification, answer = _identify(
                each, logs, validate, how, fit, watch, split_names(profiles), own, notes=each is models[0]
            )
            found.append(identification)
            answers.append(answer)
    by_log = {str(path): one for path, one in own.items() if one}
    result = {
        **answers[-1],
        "plant": plant,
        "settings": pairs,
        **({"log_settings": by_log} if by_log else {}),
        "rests_on": provenance(models, [*logs, *validate]),
    }
    for identified, answer in zip(found, answers, strict=True) if assumed else ():
        answer["assumed_ranges"] = result["assumed_ranges"] = assumption_sensitivities(identified)
    if len(found) > 1:
        result["models"] = {each.model: answer for each, answer in zip(models, answers, strict=True)}
    findings = dict.fromkeys(str(finding) for each in found for finding in each.findings)
    for finding in findings:
        warn(finding)

    def write_files(draft: Path) -> None:
        from ..identification.plant_toml import sliding_linear, write_plant
        from ..report.result_figures import identification_figures, save_all
        from ..report.result_tables import identification_tables, save_tables

        written = [each.plant for each in found]
        write_plant(draft / plant_file, *([sliding_linear(written[0])] if linear == "sliding" else []), *written)
        for each, end in zip(found, ends, strict=True):
            each.to_pandas().to_csv(draft / f"parameters{end}.csv")
        by_model: dict[str, Identification] = {each.plant.model: each for each in found}
        save_tables(identification_tables(by_model), draft)
        save_all(identification_figures(by_model), draft)

    def print_result() -> None:
        for identification in found:
            print(identification)
        for sentence in result["untold"]:
            if not any(sentence in finding for finding in findings):
                print(sentence)
        if len(found) > 1:
            fits = {
                f"  {use:<9}{channel:<11}": [getattr(each, word).fit_percent[channel] for each in found]
                for word, use in (("train", "used"), ("validation", "held out"))
                for channel in getattr(found[0], word).fit_percent
            }
            print(fit_table("fit in free run, %", [each.plant.model for each in found], fits))

    out = output.out
    stored = {**result, "written": out / plant_file} if out is not None else None
    then = f"; use it as --plant {out / plant_file}" if out is not None else ""
    output.deliver("identify", "identification.json", result, print_result, stored=stored, files=write_files, then=then)
    if output.as_json:
        for sentence in {sentence for each in found for sentence in each.warnings}:
            warn(sentence)
    if any(identification.interrupted for identification in found):
        warn("interrupted: the result is the best fit so far")
        raise typer.Exit(130)


def _identify(
    plant: Plant,
    logs: list[Path],
    validate: list[Path],
    how: Preparation,
    fit: FitOptions,
    watch: Any,
    profiles: tuple[str, ...],
    own: Mapping[Path, Mapping[str, str]],
    *,
    notes: bool,
) -> tuple[Identification, dict[str, Any]]:
    """Identify one model; returns the identification and its JSON content."""
    from ..identification.identify import identify
    from ..identification.plant_log import missing_information
    from ..identification.refits import profile
    from ..plant.load import read_settings
    from .inputs import read_prepared, whole

    steps: list[dict[str, Any]] = []
    missing: dict[str, str] = {}

    def read(path: Path, how: Preparation) -> Log:
        prepared = read_prepared(path, plant, how, notes=notes)
        steps.extend(prepared.step_dicts())
        missing.update(missing_information(prepared.log, plant))
        return replace(prepared.log, settings=read_settings(plant, own[path]))

    used = [read(path, how) for path in logs]
    held_out = [read(path, whole(how)) for path in validate]
    found = identify(plant, used, validate=held_out, watch=watch, **fit.arguments(plant))
    answer = {**found.to_dict(), "model": plant.model, "preparation": steps, "untold": list(missing.values())}
    if profiles:
        lines = [profile(found, name) for name in profiles]
        answer["profiles"] = {line.name: as_dict(line, "values rise", interval_95=line.interval) for line in lines}
    return found, answer
