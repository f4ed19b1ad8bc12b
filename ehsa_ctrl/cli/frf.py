"""`ehsa-ctrl frf`: frequency response of logs beside the Bode plot of the plant's models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from .options import LogOptions, Models, PlantOption, Settings, read_pairs
from .output import OutputOptions, provenance


def command(
    logs: Annotated[
        list[Path], typer.Argument(help="Logs; with a multisine, one of each seed (realisations of its phases).")
    ],
    plant: PlantOption,
    preparation: LogOptions,
    output: OutputOptions,
    model: Models = "both",
    method: Annotated[
        Literal["auto", "periodic", "spectral"],
        typer.Option(help="periodic (multisine), spectral (any input), or auto: periodic if the drive repeats."),
    ] = "auto",
    estimator: Annotated[
        Literal["H1", "H2"],
        typer.Option(help="H1 (noise at the output) or H2 (noise at the drive); spectral method."),
    ] = "H1",
    segment: Annotated[float | None, typer.Option(metavar="S", help="Length of the averaged segments.")] = None,
    period: Annotated[float | None, typer.Option(metavar="S", help="Period of the input; by default found.")] = None,
    settle: Annotated[
        float | None, typer.Option(metavar="S", help="Discarded at the beginning; by default one period.")
    ] = None,
    subspace: Annotated[
        bool, typer.Option("--subspace", help="Also identify a linear model without physics from the first log.")
    ] = False,
    order: Annotated[
        int | None, typer.Option(help="Order of that model; by default by its singular values.", min=1)
    ] = None,
    settings: Settings = [],
) -> None:
    """Measure the frequency response from the drive to each output, and compare it with the plant's linear models.

    Spectral: H1 or H2 with coherence. Periodic: best linear approximation, with its variance by noise and, from several
    logs, by nonlinearity. The models are linearised (a plant with friction during sliding) and sampled.

    Examples: ehsa-ctrl frf log.csv --plant ehsa · ehsa-ctrl frf seed0.csv seed1.csv seed2.csv --plant my/rig.toml
    --set load.stiffness=50e3 --out results/frf · ehsa-ctrl frf steps.csv --plant ehsa --subspace --resample 50
    """
    from ..core.log import named
    from ..identification.frequency_response import frequency_response
    from ..plant.linearise import linearise
    from ..report.figures import save
    from .inputs import load_models, read_prepared

    pairs = read_pairs(settings)
    plants = load_models(plant, model, pairs)
    output.check("frf", "frequency_response.json", "response.csv", "report.html", figures=["response"])
    last = plants[-1]
    read = [read_prepared(path, last, preparation.preparation()) for path in logs]
    found = frequency_response(
        last, named([each.log for each in read]),
        models={each.model: linearise(each) for each in plants}, method=method, estimator=estimator,
        segment=segment, period=period, settle=settle, subspace=subspace or order is not None, order=order,
    )  # fmt: skip
    result: dict[str, Any] = {
        **found.to_dict(), "plant": plant, "settings": pairs,
        "preparation": [step for each in read for step in each.step_dicts()],
        "rests_on": provenance(plants, logs),
    }  # fmt: skip

    def write_files(draft: Path) -> None:
        found.to_pandas().to_csv(draft / "response.csv", index=False, float_format="%.9g")
        save(found.plot(), draft / "response")

    output.deliver("frf", "frequency_response.json", result, lambda: print(found), files=write_files)
