"""Live charts of results: panels, switches and strips from the names of a CSV's columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from ...core.log import CHANNELS
from ...diagnosis.unknown_inputs import UNITS
from ...simulation.limits import BOUNDED, range_of
from ..chart import LOOKS, PALETTE, Chart, ChartPanel, Line, Look, RegimeCurve, Span, Strip, Switch, columns_of
from ..page import Picture
from ..signals import (
    BALANCES,
    SIGNALS,
    ChannelDisplay,
    channel_display,
    signal_display,
    state_signal,
    unit_of_balance,
)
from ..style import GREY, PURPLE
from ..text import unit

Run = Mapping[str, Any]

#: File of the bins that the samples lie in along the regimes of a diagnosis.
REGIMES = "regimes.csv"
#: File of a replay in closed loop.
LOOP_REPLAY = "closed_loop_replay.csv"

#: How to use a chart, below each.
USE = "Drag to enlarge, double-click or press 0 for the whole run; arrow keys move, + and - zoom."


def free_run_chart(
    folder: Path,
    file: str,
    pictures: Sequence[Picture],
    *,
    after: str = "after",
    effect: str = "",
    shaded: Sequence[Span] = (),
    regimes: Sequence[RegimeCurve] = (),
) -> Chart | None:
    """Measured, before and after of each signal; None without the file.

    file: columns t, the inputs, and NAME, NAME_before, NAME_after of each signal. after: name of that run. effect: name
    of the causes that a button puts into the model and takes out of it.
    """
    columns = columns_of(folder / file)
    roles = {"measured": "measured", "before": "before (nominal)", "after": after}
    names = [c for c in columns[1:] if not c.endswith(("_before", "_after"))]
    panels = []
    for name in names:
        lines = _roles(name, columns, roles)
        if len(lines) == 1:
            panels.append(ChartPanel(display(name), [Line(name, "input", LOOKS["drive"], stepped=True)]))
            continue
        panels.append(ChartPanel(display(name), [replace(o, bounded=o.switches == ("before",)) for o in lines]))
    switches = _role_switches(panels, roles)
    if not switches:
        return None
    return Chart(
        pictures[0].heading, file, panels, pictures,
        switches=switches, shaded=shaded, regimes=regimes,
        swap=(effect, "before", "after") if effect and {"before", "after"} <= {s.key for s in switches} else None,
        caption="Free runs, driven by the logged input alone. " + ("Grey: held-out data. " if shaded else "") + USE,
    )  # fmt: skip


def loop_replay_chart(folder: Path, pictures: Sequence[Picture], after: str, shaded: Sequence[Span]) -> Chart | None:
    """What the models leave of the position in closed loop, then position and drive; None without the file.

    The file has the columns t, error_before and error_after (measured minus simulated position), and of position
    and drive NAME, NAME_before, NAME_after.
    """
    columns = columns_of(folder / LOOP_REPLAY)
    names = [name for name in columns[1:] if not name.endswith(("_before", "_after"))]
    if not names:
        return None
    roles = {"measured": "measured", "before": "before (nominal)", "after": after}
    position = display(names[0])
    panels = [
        ChartPanel(position._replace(words=f"{position.words}, measured − simulated"), _roles("error", columns, roles)),
        *(ChartPanel(display(name), _roles(name, columns, roles)) for name in names),
    ]
    return Chart(
        "Closed-loop replay", LOOP_REPLAY, panels, pictures, _role_switches(panels, roles), shaded=shaded,
        caption=("Grey: held-out data. " if shaded else "") + USE,
    )  # fmt: skip


def _roles(name: str, columns: Sequence[str], roles: Mapping[str, str]) -> list[Line]:
    """Measured, before and after of a signal, as far as they have columns."""
    runs = {"measured": name, "before": f"{name}_before", "after": f"{name}_after"}
    return [Line(runs[role], words, LOOKS[role], (role,)) for role, words in roles.items() if runs[role] in columns]


def _role_switches(panels: Sequence[ChartPanel], roles: Mapping[str, str]) -> list[Switch]:
    shown = [role for role in roles if any(line.switches == (role,) for panel in panels for line in panel.lines)]
    return [Switch(role, roles[role], LOOKS[role]) for role in shown]


def charted(chart: Chart | None, pictures: Sequence[Picture]) -> list[Any]:
    """The chart, which holds the pictures; the pictures alone without one."""
    return [chart] if chart is not None else list(pictures)


def display(name: str) -> ChannelDisplay:
    """Display of a channel or of a scored signal."""
    return channel_display(name) if name in CHANNELS else signal_display(name)


def comparison_chart(folder: Path, models: Sequence[str], pictures: Sequence[Picture]) -> Chart | None:
    """Measured and simulated outputs of each model in compare.csv; None without the file."""
    columns, panels = columns_of(folder / "compare.csv"), []
    ends = ("_measured", *(f"_{model}" for model in models))
    for name in dict.fromkeys(_base(column, ends) for column in columns[1:]):
        if name not in CHANNELS:
            continue
        lines = [Line(name, "input", LOOKS["drive"], stepped=True)] if name in columns else []
        for role in ("measured", *models):
            if f"{name}_{role}" in columns:
                lines.append(Line(f"{name}_{role}", _model_words(role), LOOKS[role], (role,)))
        panels.append(ChartPanel(channel_display(name), lines))
    if not panels:
        return None
    switches = [Switch(role, _model_words(role), LOOKS[role]) for role in ("measured", *models)]
    return Chart("Measured and simulated", "compare.csv", panels, pictures, switches, caption=USE)


def _base(column: str, ends: Sequence[str]) -> str:
    return next((column.removesuffix(end) for end in ends if column.endswith(end)), column)


def _model_words(role: str) -> str:
    return role if role == "measured" else f"{role} model"


def simulation_chart(folder: Path, content: Mapping[str, Any], pictures: Sequence[Picture]) -> Chart | None:
    """Input and states of simulation.csv, with sticking and exceeded limits; None without the file."""
    file, columns = "simulation.csv", columns_of(folder / "simulation.csv")
    inputs = content.get("inputs", [])
    panels = [
        ChartPanel(how, [Line(name, "simulated", LOOKS[role], stepped=name in inputs)])
        for name, how in _signals(content, columns).items()
        for role in ["drive" if name in inputs else content.get("model", "nonlinear")]
    ]
    if not panels:
        return None
    still = [Strip(f"{name} sticks", name, GREY, still=True) for name in content.get("contacts", []) if name in columns]
    return Chart(
        "Simulated run", file, panels, pictures, strips=[*still, *limit_strips(content.get("exceeded", []), columns)],
        caption=USE,
    )  # fmt: skip


def _signals(content: Mapping[str, Any], columns: Sequence[str], end: str = "") -> dict[str, ChannelDisplay]:
    """Inputs and states of a run that have a column, in the order of their panels. end: of the columns' names."""
    # A result that does not state its signals has no chart.
    units = {**content["signals"], "F_cell": "N"} if content.get("signals") else {}
    hydraulic = {"P_1", "P_2", "x"} <= set(units)
    # The rod's speed of the EHSA is its shaft's, but for the oil's spring.
    names = [name for name in units if f"{name}{end}" in columns and not (hydraulic and name == "v")]
    return {name: _shown(name, units[name]) for name in names}


def _shown(name: str, si: str) -> ChannelDisplay:
    """Display of a state or input: those of the EHSA as in its figures, others by their own names."""
    words = {"P_1": "pressure P₁", "P_2": "pressure P₂", "F_cell": "force", "v": "speed v"}.get(name)
    known = SIGNALS.get({"P_1": "pressures", "P_2": "pressures", "F_cell": "force"}.get(name, name))
    how = known or state_signal(name, si)
    return ChannelDisplay(words or how.words, how.display_unit, how.scale)


def limit_strips(
    exceeded: Sequence[Mapping[str, Any]], columns: Sequence[str], end: str = "", file: str = "", of: str = ""
) -> list[Strip]:
    """A strip for each exceeded limit whose quantity is a column.

    end: of the columns' names. of: named in the label.
    """
    found = []
    for trip in exceeded:
        limit = str(trip["limit"])
        if limit not in BOUNDED:
            continue
        low, high = range_of(limit, float(trip["allowed"]))
        for name in BOUNDED[limit][0]:
            if f"{name}{end}" in columns:
                words = f"{name.replace('_', '')} beyond {limit.replace('_', ' ')}{of}"
                found.append(Strip(words, f"{name}{end}", PURPLE, low=low, high=high, file=file))
    return found


def run_chart(folder: Path, group: Sequence[tuple[str, Run]]) -> Chart | None:
    """A scenario with all its controllers, which are switched on and off; None without the files.

    group: file stem and content of each run.
    """
    found = [(stem, run, columns_of(folder / f"{stem}.csv")) for stem, run in group]
    found = [(stem, run, columns) for stem, run, columns in found if "reference" in columns]
    if not found:
        return None
    several = len(found) > 1
    names = [f"{run['controller']}" for _, run, _ in found]
    lines: dict[str, list[Line]] = {}
    hows: dict[str, ChannelDisplay] = {}
    strips: list[Strip] = []
    for k, ((stem, run, columns), model) in enumerate(product(found, ("nonlinear", "linear"))):
        which = k // 2
        file, name = f"{stem}.csv", names[which]
        look = LOOKS[model] if not several else _of_controller(which, model)
        signals = _signals(run, columns, f"_{model}")
        hows |= signals
        for signal in signals:
            words = f"{name}, {model}" if several else f"{model} model"
            keys = (f"controller {which}", model) if several else (model,)
            line = Line(f"{signal}_{model}", words, look, keys, stepped=signal in run.get("inputs", []), file=file)
            lines.setdefault(signal, []).append(line)
        if model == "nonlinear":
            of = f" ({name})" if several else ""
            stuck = [contact for contact in run.get("contacts", []) if f"{contact}_{model}" in columns]
            # The shaft of an EHSA sticks with its rod.
            for contact in ["rod"] if "rod" in stuck else stuck:
                strips.append(Strip(f"{contact} sticks{of}", f"{contact}_{model}", GREY, still=True, file=file))
            strips += limit_strips(run["trips"], columns, f"_{model}", file, of)
    first, columns = f"{found[0][0]}.csv", found[0][2]
    for signal, column in (("x", "reference"), ("F_cell", "reference_force")):
        if column in columns and signal in lines:
            target = Line(column, "reference", LOOKS["reference"], ("reference",), stepped=True, file=first)
            lines[signal].insert(0, target)
    switches = [Switch("reference", "reference", LOOKS["reference"])]
    if several:
        switches += [Switch(f"controller {k}", name, _of_controller(k, "nonlinear")) for k, name in enumerate(names)]
    switches += [
        Switch(model, words, None if several else LOOKS[model], on=on)
        for model, words, on in (
            ("nonlinear", "nonlinear plant", True), ("linear", "linear prediction (dashed)", not several),
        )
    ]  # fmt: skip
    if not lines:
        return None
    inputs = found[0][1].get("inputs", [])
    # What the scenario is about comes first, the drive last.
    order = sorted(lines, key=lambda name: (name in inputs, name not in ("x", "F_cell"), name != "x"))
    panels = [ChartPanel(hows[each], lines[each]) for each in order]
    return Chart("Runs over time", first, panels, (), switches, strips, caption=USE)


def _of_controller(index: int, model: str) -> Look:
    colour = PALETTE[index % len(PALETTE)]
    # The dashes of a second round of colours differ.
    solid = () if index < len(PALETTE) else (10, 3)
    return Look(colour, solid, 1.5) if model == "nonlinear" else Look(colour, (5, 3), 1.0)


def regime_curves(regimes: Sequence[Mapping[str, Any]], folder: Path, file: str) -> list[RegimeCurve]:
    """The curves of a diagnosis' regimes whose samples are in the file."""
    columns = columns_of(folder / file)
    found = []
    for number, regime in enumerate(regimes, 1):
        column = f"regime_{number}"
        if column not in columns or "bins" not in regime:
            continue
        usual, scale = unit_of_balance(UNITS[regime["balance"]])
        variable, by = unit_of_balance(regime["unit"])
        rows = zip(regime["bins"], regime["mean"], regime["sd"], strict=True)
        points = [(z / by, mean / scale, sd / scale) for z, mean, sd in rows]
        name = BALANCES[regime["balance"]]
        across = f"{regime['against']} ({unit(variable)})" if variable else str(regime["against"])
        found.append(
            RegimeCurve(
                f"{name}: {regime['words']}", across, f"{name} ({unit(usual)})", points, column, file, unit(usual)
            )
        )
    return found
