"""Measured and simulated signals: free runs on a log, before and after an identification or a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ...core.errors import InputError, choices
from ...core.plotting import draw
from ...diagnosis.diagnosis import Diagnosis
from ...diagnosis.signals import scored_signals
from ...identification.comparison import Comparison
from ...identification.identification import Identification
from ..outcome import after_model, after_words
from ..signals import ChannelDisplay, Signal, channel_display, most_active_part, signal_display
from ..style import BLACK, BLUE, GREY, ROLES
from ..text import percent
from . import _panels as panel
from ._layout import LEGEND_LINE, header_legend, share_x, sheet

if TYPE_CHECKING:
    import pandas

    from ...core.log import Log

#: Lines with more samples are rasterised: over the whole log, drift is of interest rather than each sample.
POINTS = 1500
#: Height of a row, in; share of the width that the detail has.
ROW, WIDTHS = 0.95, (1.0, 0.85)
#: Length of the part of a diagnosis that is shown in detail [s].
DETAIL = 1.5
LOOKS = ROLES | {"drive": {"label": "drive", "color": BLUE, "linewidth": 0.9, "drawstyle": "steps-post"}}
HELD_OUT: dict[str, Any] = {"facecolor": "#ececec", "edgecolor": BLACK, "linewidth": 0.0, "zorder": 0.4}
ENLARGED: dict[str, Any] = {"facecolor": BLUE, "alpha": 0.15, "linewidth": 0.0, "zorder": 0.5}


def overlay_figure(
    time: np.ndarray, panels: Mapping[str, Mapping[str, np.ndarray]], *, title: str = "Measured and simulated"
) -> Figure:
    """Measured, linear and nonlinear signals over time [s], as in Fig. 7 and 8 of the paper.

    Parameters
    ----------
    time: (N,) s.
    panels: axis label with unit, as "rod speed (mm/s)", -> role (reference, measured, linear or nonlinear) -> values
        (N,) in that unit. nan leaves a gap.

    Raises
    ------
    InputError: no panel, a label without unit, an unknown role, or a length that differs from that of time.
    """
    time = np.asarray(time, dtype=float)
    if not panels:
        raise InputError("overlay_figure got no panel; give at least one, as {'speed (rpm)': {'measured': values}}")
    for label, roles in panels.items():
        if not label.endswith(")") or " (" not in label:
            raise InputError(f"panel {label!r} has no unit; write it in brackets, as 'speed (rpm)'")
        for role, values in roles.items():
            if role not in ROLES:
                raise InputError(f"panel {label!r}: no role {role!r}; {choices(role, ROLES)}")
            if np.shape(values) != time.shape:
                raise InputError(
                    f"panel {label!r}, {role}: shape {np.shape(values)}; expected that of time, {time.shape}"
                )
    with panel.column(title, dict.fromkeys(panels, 1.5 * panel.PANEL)) as (figure, axes):
        lines = {}
        for label, roles in panels.items():
            ax = axes[label]
            for role, values in roles.items():
                lines[role] = panel.draw(ax, time, np.asarray(values, dtype=float), ROLES[role])
            panel.set_range(ax, Signal(label.rpartition(" (")[0], "1", "1", 0.0))
            ax.set_ylabel("\n(".join(label.rsplit(" (", 1)))
            ax.set_xlim(time[0], time[-1])
        header_legend(axes["header"], [lines[role] for role in ROLES if role in lines])
    return figure


def replay_figure(replays: Sequence[Comparison], *, detail: bool = False) -> Figure:
    """Inputs and outputs of the log, and the simulated outputs of each model, over time [s].

    Parameters
    ----------
    replays: of one log by different models, each model once.
    detail: show only the second in which the input varies most.

    Raises
    ------
    InputError: no replay, or replays of logs of different length.
    """
    if not replays:
        raise InputError("replay_figure got no replay; give at least one")
    log, system = replays[0].log, replays[0].plant.structure.system
    drives = list(system.drives.values())
    rows = most_active_part(log, drives[0]) if detail else slice(None)
    panels: dict[str, dict[str, np.ndarray]] = {}
    for channel in (*drives, *replays[0].fit_percent):
        how = channel_display(channel)
        panels[how.label] = {"measured": log[channel][rows] / how.scale}
        for replay in replays:
            if channel in replay.simulated:
                panels[how.label][replay.plant.model] = np.asarray(replay.simulated[channel])[rows] / how.scale
    part = ", the second in which the input varies most" if detail else ""
    return overlay_figure(log.time[rows], panels, title=f"{replays[0].plant.name} and {log.name}{part}")


@draw.register
def _(replay: Comparison) -> Figure:
    return replay_figure([replay])


@dataclass(frozen=True)
class Trace:
    """A row of a figure: an input, or a signal measured, before and after.

    how: name and display unit. lines: role -> (N,) in SI units; all nan if the run stopped early. words: text beside.
    """

    name: str
    how: ChannelDisplay
    lines: Mapping[str, np.ndarray]
    words: str = ""


def _whole_and_detail(
    title: str,
    time: np.ndarray,
    traces: Sequence[Trace],
    part: slice,
    labels: Mapping[str, str],
    *,
    detail: str,
    held_spans: Sequence[tuple[float, float]] = (),
) -> Figure:
    """One row per trace: the whole log on the left, a part of it on the right.

    labels: role -> legend text. detail: description of the part. held_spans: start and end of the held-out parts [s].
    """
    rows = [[f"{trace.name} whole", f"{trace.name} detail"] for trace in traces]
    roles = [role for role in ROLES if any(role in trace.lines for trace in traces)]
    # Four entries fit into one row.
    entries = len(roles) + (2 if held_spans else 1)
    columns = entries if entries <= 4 else 3
    header = LEGEND_LINE * math.ceil(entries / columns) + 0.08
    with sheet(title, rows, [ROW] * len(rows), widths=WIDTHS, header=header) as (figure, axes):
        wholes, details = ([axes[row[k]] for row in rows] for k in (0, 1))
        share_x(wholes)
        share_x(details)
        start, stop = time[part][[0, -1]]
        lines: dict[str, Artist] = {}
        for trace, whole, near in zip(traces, wholes, details, strict=True):
            for ax, samples in ((whole, slice(None)), (near, part)):
                lines |= _trace(ax, time[samples], trace, samples, labels)
            whole.set_ylabel(trace.how.two_lines)
            look: dict[str, Any] = {"transform": near.transAxes, "va": "center", "fontsize": 8, "linespacing": 1.35}
            if trace.words:
                near.text(1.03, 0.5, trace.words, **look)
            whole.axvspan(start, stop, **ENLARGED)
            for held_from, held_to in held_spans:
                whole.axvspan(held_from, held_to, **HELD_OUT)
                whole.axvline(held_from, color=GREY, linestyle=(0, (4, 2)), linewidth=0.9, zorder=1.5)
        wholes[-1].set_xlim(time[0], time[-1])
        details[-1].set_xlim(start, stop)
        wholes[-1].set_xlabel("time (s), whole log")
        details[-1].set_xlabel(f"time (s), {detail}")
        handles = [lines[role] for role in roles]
        handles.append(Patch(label="enlarged on the right", **ENLARGED))
        if held_spans:
            handles.append(Patch(label="held out", **HELD_OUT | {"linewidth": 0.6, "linestyle": (0, (4, 2))}))
        header_legend(axes["header"], handles, ncols=columns, fontsize=8.5)
    return figure


def _trace(ax: Axes, time: np.ndarray, trace: Trace, samples: slice, labels: Mapping[str, str]) -> dict[str, Artist]:
    values = {role: line[samples] / trace.how.scale for role, line in trace.lines.items()}
    drawn = {}
    for role, line in values.items():
        drawn[role] = panel.draw(ax, time, line, LOOKS[role] | ({"label": labels[role]} if role in labels else {}))
        drawn[role].set_rasterized(line.size > POINTS)
    panel.set_range_around(ax, [line for role, line in values.items() if role != "before"], values.get("before"))
    return drawn


@draw.register
def identification_figure(identification: Identification, index: int = 0) -> Figure:
    """A log with the free runs of the nominal and the identified plant.

    One row for each input and output, as in Fig. 7 and 8 of the paper: left the whole log, right the second in which
    the input varies most, with the fit of each output in percent. A run far from the measurement leaves its panel.

    Parameters
    ----------
    index: of the log among the held-out logs, or among the logs used if none was held out.

    Raises
    ------
    InputError: there is no such log.
    """
    held_out = bool(identification.validation.after)
    log, traces = identification_traces(identification, index)
    plant = identification.plant
    title = f"{plant.name} ({plant.model}) and {log.name}, {'held out' if held_out else 'used to identify'}"
    return _whole_and_detail(title, log.time, traces, most_active_part(log, traces[0].name), {}, detail="detail")


def identification_traces(identification: Identification, index: int = 0) -> tuple[Log, list[Trace]]:
    """A log with its inputs and outputs; arguments and errors as of `identification_figure`."""
    reach = identification.validation if identification.validation.after else identification.train
    if not 0 <= index < len(reach.after):
        raise InputError(f"identification_figure got index {index}; expected 0 to {len(reach.after) - 1}")
    before, after = reach.before[index], reach.after[index]
    log = after.log
    drives = after.plant.structure.system.drives.values()
    traces = [Trace(name, channel_display(name), {"drive": np.asarray(log[name])}) for name in drives]
    for name in after.fit_percent:
        runs = {"measured": log[name], "before": before.simulated.get(name), "after": after.simulated.get(name)}
        lines = {role: np.asarray(values) for role, values in runs.items() if values is not None}
        fits = [
            f"{word} –" if math.isnan(fit) else f"{word} {fit:.1f} %".replace("-", "−")
            for word, fit in (("before", before.fit_percent[name]), ("after", after.fit_percent[name]))
        ]
        traces.append(Trace(name, channel_display(name), lines, "\n".join(["fit", *fits])))
    return log, traces


@draw.register
def diagnosis_figure(diagnosis: Diagnosis) -> Figure:
    """A log with the free runs of the nominal plant and the plant with causes; right, the part of largest error.

    One row for the input, each scored signal, and the position, with the gap of each signal on held-out data in percent
    before and after. Held-out data of this log is shaded.
    """
    log, plant = diagnosis.log, diagnosis.plant
    after = after_words(diagnosis.verdict, len(diagnosis.effects), diagnosis.gap)
    before = "simulated, nominal" if diagnosis.verdict == "no_gap" else str(ROLES["before"]["label"])
    return _whole_and_detail(
        f"{plant.name} ({plant.model}) and {log.name}", log.time, diagnosis_traces(diagnosis),
        largest_error_part(diagnosis),
        {"before": before, "after": f"after, {after}"}, detail="largest error", held_spans=diagnosis.held_spans,
    )  # fmt: skip


def diagnosis_traces(diagnosis: Diagnosis) -> list[Trace]:
    """The drive, the scored signals of the log, and the position if the plant has one."""
    log, drive = diagnosis.log, diagnosis.plant.structure.system.drive
    signals = diagnosis.plant.structure.system.scored
    drifting = [one.channel for one in signals if one.span and one.channel in log.channels]
    names = [*(one.name for one in signals if one.name in diagnosis.whole), *drifting]
    models = {"before": "nominal", "after": after_model(diagnosis.verdict, diagnosis.gap)}
    found = [Trace(drive, channel_display(drive), {"drive": np.asarray(log[drive])})]

    def read(channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {**channels, **scored_signals(signals, channels, log.sample_time)}

    for name in names:
        lines = {"measured": read(log.channels)[name]}
        for role, model in models.items():
            if model is not None:
                # The result does not contain runs that stopped early.
                runs = diagnosis.simulated.get(model)
                nothing = np.full(len(log), np.nan)
                lines[role] = nothing if runs is None else read(runs)[name]
        gaps = {role: percent(diagnosis.gap[m].get(name), 2) for role, m in models.items() if m is not None}
        words = [f"{role} {gap}" for role, gap in gaps.items()] if len(gaps) > 1 else list(gaps.values())
        held_out_gaps = "\n".join(["held-out gap", *words])
        drifts = "no gap given:\nit drifts in\nfree run"
        found.append(Trace(name, signal_display(name), lines, drifts if name in drifting else held_out_gaps))
    return found


def largest_error_part(diagnosis: Diagnosis) -> slice:
    """Samples of the part in which the error of the nominal plant is largest, over all scored signals."""
    log = diagnosis.log
    width = min(max(int(round(DETAIL / log.sample_time)), 2), len(log))
    off = np.zeros(len(log))
    for trace in diagnosis_traces(diagnosis):
        if trace.name in diagnosis.whole and (spread := float(np.std(trace.lines["measured"]))) > 0.0:
            off += np.nan_to_num((trace.lines["measured"] - trace.lines["before"]) / spread) ** 2
    sums = np.cumsum(np.concatenate([[0.0], off]))
    first = int(np.argmax(sums[width:] - sums[:-width]))
    return slice(first, first + width)


def traces_table(time: np.ndarray, traces: Sequence[Trace]) -> pandas.DataFrame:
    """One row per sample, SI units: t, the inputs, and each signal measured, before and after."""
    import pandas

    columns = {"t": time}
    for trace in traces:
        ends = {"drive": "", "measured": "", "before": "_before", "after": "_after"}
        columns |= {f"{trace.name}{ends[role]}": values for role, values in trace.lines.items()}
    return pandas.DataFrame(columns)
