"""`ehsa-ctrl serve`: the plant or the controller of a loop whose other side is a rig or another program, over UDP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.errors import InputError
from ..simulation.link import PATIENCE
from .complete import controllers, plants, scenarios
from .options import Settings, read_pairs
from .output import OutputOptions, command_line, note, warn_implausible

if TYPE_CHECKING:
    from ..simulation.closed_loop import ClosedLoop
    from ..simulation.link.controller_side import ControllerSide
    from ..simulation.link.summary import LinkSummary

#: Files of each side.
FILES = {"plant": ("serve.json", "loop.csv"), "controller": ("serve.json", "samples.csv")}


def command(
    output: OutputOptions,
    plant: Annotated[
        str | None, typer.Option(help="Plant to simulate on this side (name or file).", autocompletion=plants)
    ] = None,
    controller: Annotated[
        str | None, typer.Option(help="Controller to run on this side (name or file).", autocompletion=controllers)
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            help="With --plant: load, reference, disturbances, sensors and duration of the run; with --controller: "
            "reference, supervision and design model.",
            autocompletion=scenarios,
        ),
    ] = None,
    design: Annotated[
        str | None,
        typer.Option(
            help="Plant whose linear model the controller is designed on; by default the scenario's, else ehsa.",
            autocompletion=plants,
        ),
    ] = None,
    address: Annotated[str, typer.Option(help="IPv4 address at which the controller's side listens.")] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(help="UDP port of the controller's side; 0 there takes a free one.", min=0, max=65535)
    ] = 47400,
    period: Annotated[
        float | None,
        typer.Option(metavar="S", help="Real time: wall-clock seconds a sample; left out, lock-step without a clock."),
    ] = None,
    patience: Annotated[float, typer.Option(metavar="S", help="Time to wait for the other side.")] = PATIENCE,
    duration: Annotated[float, typer.Option(metavar="S", help="Length of a plant's run without a scenario.")] = 10.0,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the plant's sensor noise, for the scenario's.", min=0)
    ] = None,
    settings: Settings = [],
) -> None:
    """Run one side of a loop in real time or lock-step: the other side, a rig or another program, answers over UDP.

    The plant's side sends a packet of readings each sample, the controller's side answers it with a current. After the
    time-out in \\[watchdog] of its definition a side goes to the safe current given there. Ctrl-C ends the run with the
    summary. Exit status 1: a safe output acted.

    Examples: ehsa-ctrl serve --controller pid_position --port 47400 ·
    ehsa-ctrl serve --plant ehsa --scenario steps_spring --port 47400 --period 0.004 --out results/link
    """
    if (plant is None) == (controller is None):
        raise InputError("give either --plant P, to simulate the plant here, or --controller C, to run it here")
    for option, value in (("--period", period), ("--patience", patience), ("--duration", duration)):
        if value is not None and not 0.0 < value <= 3600.0:
            raise InputError(f"{option} {value:g}: expected more than 0 s and at most an hour")
    pairs = read_pairs(settings)
    side = "controller" if plant is None else "plant"
    output.check("serve", *FILES[side])
    run: Any
    if plant is not None:
        if design is not None:
            raise InputError("--design is for --controller; the plant's side designs nothing")
        summary, run = _plant_side(plant, scenario, address, port, period, patience, duration, seed, pairs)
    else:
        if pairs or seed is not None:
            raise InputError("--set and --seed change the simulated plant; give them on the plant's side")
        summary, run = _controller_side(str(controller), scenario, design, address, port, period, patience)
    result = {**summary.to_dict(), "command": command_line()}
    file, series = FILES[side]
    output.deliver(
        "serve", file, result, lambda: print(summary),
        files=lambda draft: run.to_pandas().to_csv(draft / series, index=False),
    )  # fmt: skip
    if summary.ended == "interrupted":
        raise KeyboardInterrupt(f"after {summary.samples} samples")
    if summary.tripped:
        raise typer.Exit(1)


def _plant_side(
    plant: str,
    scenario: str | None,
    address: str,
    port: int,
    period: float | None,
    patience: float,
    duration: float,
    seed: int | None,
    pairs: dict[str, str],
) -> tuple[LinkSummary, ClosedLoop]:
    """Simulate the plant with the other side's currents."""
    from ..plant.load import load_plant
    from ..scenario.definition import load_scenario
    from ..scenario.prepare import prepare
    from ..simulation.link.plant_side import RemoteController
    from .progress import compiling

    loaded = load_plant(plant, model="nonlinear", settings=pairs)
    warn_implausible([loaded])
    steady = {"duration": duration, "reference": {"kind": "steps", "times": [0.0], "positions": [0.0]}}
    chosen = load_scenario(scenario) if scenario else load_scenario(steady, label="steady")
    remote = RemoteController.connected(
        address, port, loaded.sample_time, loaded.watchdog, period=period, patience=patience
    )
    try:
        case = prepare(chosen, controller=remote, plant=plant, settings=pairs)
        note(f"asks {address} port {port} for currents; waits at most {patience:g} s for the first")
        with compiling():
            loop = case.simulate(case.nonlinear, seed)
    finally:
        summary = remote.finish()
    # After Ctrl-C the rest of the run was simulated under the safe current.
    return summary, loop.first(summary.samples)


def _controller_side(
    controller: str,
    scenario: str | None,
    design: str | None,
    address: str,
    port: int,
    period: float | None,
    patience: float,
) -> tuple[LinkSummary, ControllerSide]:
    """Answer the other side's readings."""
    import numpy as np

    from ..core.watchdog import Watchdog
    from ..design.load import load_controller
    from ..plant.conditions import linear_model
    from ..plant.load import load_plant
    from ..scenario.prepare import prepare
    from ..simulation.link.controller_side import ControllerSide
    from ..simulation.link.endpoint import Endpoint
    from ..simulation.link.packet import READINGS
    from .progress import compiling

    rows = None
    if scenario is not None:
        case = prepare(scenario, controller=controller, design=design)
        law: Any = case.controller
        definition = case.scenario.definition
        rows = definition.reference.rows(law.sample_time * np.arange(round(definition.duration / law.sample_time) + 1))
    else:
        base = load_plant(design or "ehsa", model="linear")
        law = load_controller(controller, linear_model(base), sample_time=base.sample_time)
    watchdog = getattr(law, "watchdog", Watchdog())
    served = ControllerSide(
        Endpoint.bound(READINGS, address, port), law, watchdog, reference=rows, period=period, patience=patience
    )
    with compiling():
        served.warm_up()
    note(f"{law.name} waits for readings on {address} port {served.endpoint.port}, at most {patience:g} s")
    return served.serve(lambda peer: note(f"answers {peer[0]} port {peer[1]}")), served
