"""Measured frequency responses with their uncertainty, beside those of models."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core.plotting import draw
from ...identification.frequency_response import FrequencyResponse, MeasuredChannel
from ..style import BLUE, GREEN, PURPLE, VERMILION
from ._layout import XLABEL, share_x, sheet
from .frequency import degrees, few_ticks, phase

#: Look of the models, in their order.
LOOKS: tuple[dict[str, Any], ...] = (
    {"color": VERMILION, "linestyle": "-", "linewidth": 1.4, "zorder": 4},
    {"color": GREEN, "linestyle": (0, (5, 2)), "linewidth": 1.4, "zorder": 4},
    {"color": PURPLE, "linestyle": (0, (2, 1)), "linewidth": 1.4, "zorder": 4},
)
#: Units of the axes: output -> (factor to SI, text of the output's unit).
SHOWN = {"pressure_difference": (1e5, "bar"), "position": (1e-3, "mm"), "speed": (1.0, "rad/s")}
UNITS = {"current": "A", "force": "N"}


@draw.register
def response_figure(response: FrequencyResponse) -> Figure:
    """Gain and phase [deg] of each output over frequency [Hz]: measured with two standard deviations, and models.

    Below, the coherence of a spectral estimate.
    """
    names = [each.output for each in response.channels]
    rows = [[f"{name} gain", f"{name} phase"] for name in names]
    coherent = response.method == "spectral"
    heights = [1.6] * len(rows)
    if coherent:
        rows.append(["coherence", "coherence"])
        heights.append(1.1)
    title = f"Frequency response from {response.drive}, {', '.join(response.logs)}"
    notes = ["dots: measured where noise allows, with two standard deviations; lines: sampled models"]
    with sheet(title, rows, heights, notes=notes, header=0.22, extra=XLABEL) as (figure, axes):
        for each, (left, right) in zip(response.channels, rows, strict=False):
            _channel(axes[left], axes[right], each, response)
        if coherent:
            for each, color in zip(response.channels, (BLUE, VERMILION, GREEN, PURPLE), strict=False):
                axes["coherence"].semilogx(each.lines.frequency, each.lines.coherence, color=color, label=each.output)
            axes["coherence"].set_ylim(0.0, 1.05)
            axes["coherence"].set_ylabel("coherence")
            axes["coherence"].legend(loc="lower left", ncols=4)
            axes["coherence"].set_xlabel("frequency (Hz)")
        for k in (0, 1):
            column = [axes[row[k]] for row in rows[: len(names)]]
            few_ticks(column)
            share_x(column)
            column[-1].set_xlabel("frequency (Hz)")
            lines = response.channels[0].lines.frequency
            column[-1].set_xlim(lines[0] / 1.2, 1.2 * lines[-1])
        if coherent:
            few_ticks([axes["coherence"]])
        first = axes[rows[0][0]]
        handles, labels = first.get_legend_handles_labels()
        axes["header"].legend(handles, labels, loc="lower left", ncols=4, borderpad=0.2, bbox_to_anchor=(0.0, -0.1))
    return figure


def _channel(gain: Axes, angle: Axes, channel: MeasuredChannel, response: FrequencyResponse) -> None:
    """Gain and phase of one output."""
    lines = channel.lines
    scale, unit = SHOWN.get(channel.output, (1.0, channel.unit.partition("/")[0]))
    there = lines.reliable
    frequency, response_there, sd = lines.frequency[there], lines.response[there], lines.sd[there]
    size, bar = np.abs(response_there) / scale, 2.0 * sd / scale
    look: dict[str, Any] = {"fmt": "o", "markersize": 2.6, "color": BLUE, "elinewidth": 0.9, "zorder": 2.5}
    # A bar must not reach zero on a logarithmic axis.
    gain.errorbar(frequency, size, yerr=[np.minimum(bar, 0.9 * size), bar], label="measured", **look)
    # Relative to the first model, because noise makes unwrapping along the frequencies jump.
    models = [values[channel.output] for values in response.models.values()]
    measured = phase(response_there) if size.size else np.zeros(0)
    if models:
        measured = phase(models[0])[there] + np.degrees(np.angle(response_there / models[0][there]))
    turned = np.degrees(np.arcsin(np.minimum(2.0 * sd / np.abs(response_there), 1.0)))
    angle.errorbar(frequency, measured, yerr=turned, **look)
    for (name, values), style in zip(response.models.items(), LOOKS, strict=False):
        model = values[channel.output]
        gain.plot(lines.frequency, np.abs(model) / scale, label=f"{name} model", **style)
        of = phase(model)
        angle.plot(lines.frequency, of - 360.0 * np.round(np.mean(of - phase(models[0])) / 360.0), **style)
    gain.set_xscale("log")
    gain.set_yscale("log")
    angle.set_xscale("log")
    drive = UNITS.get(response.drive, channel.unit.partition("/")[2])
    gain.set_ylabel(f"{channel.output.replace('_', ' ')}\n({unit} per {drive})")
    angle.set_ylabel("phase\n(deg)")
    degrees(angle)
