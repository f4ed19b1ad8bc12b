"""Bode plots of the linear model and of a loop with its margins."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, MultipleLocator, NullFormatter

from ...core.plotting import draw
from ...core.unit import factor
from ...design.analysis.loop import LoopAnalysis
from ...design.analysis.system import OUTPUTS, Analysis
from ..signals import SIGNALS
from ..style import BLACK, BLUE, GREEN, GREY, VERMILION
from ..text import number, unit
from ._layout import XLABEL, share_x, sheet

#: Units of a gain per unit of the drive.
SHOWN = {"omega": "rad/s", "dP": "bar", "v": "mm/s", "x": "mm", "theta": "rad"}
#: Names of outputs that are not among SIGNALS.
NAMES = {"theta": "angle"}
#: |S| and |T| are not shown below this, dB.
FLOOR = -45.0
#: rad/s in 1 Hz.
HERTZ = 2 * np.pi
#: A margin.
BAR: dict[str, Any] = {
    "color": VERMILION, "linewidth": 3.0, "zorder": 3, "solid_capstyle": "butt", "clip_on": False,
}  # fmt: skip


@draw.register
def bode_figure(analysis: Analysis) -> Figure:
    """Magnitude [rad/s, bar, mm/s, mm, rad per unit of the drive] and phase [deg] from the drive to each output over
    frequency [Hz].

    One row per output; dotted lines mark the natural frequencies of the poles.
    """
    outputs = [name for name in OUTPUTS if name in analysis.system.output_labels]
    poles = _poles(analysis)
    centres = [frequency for frequency, _ in poles] or [1.0]
    omega = np.geomspace(min(centres) / 50, 50 * max(centres), 2000)
    response = np.asarray(analysis.system(1j * omega))
    rows = [[f"{name} gain", f"{name} phase"] for name in outputs]
    title = f"Bode plot of {analysis.system.name}, input: {analysis.drive}"
    notes = ["dotted, poles at " + "; ".join(words for _, words in poles)] if poles else []
    with sheet(title, rows, [1.5] * len(rows), notes=notes) as (figure, axes):
        for name, (left, right) in zip(outputs, rows, strict=True):
            channel = response[analysis.system.output_labels.index(name), 0]
            axes[left].loglog(omega / HERTZ, np.abs(channel) / factor(SHOWN[name], OUTPUTS[name]), color=BLUE)
            words = NAMES.get(name) or SIGNALS[name].words
            axes[left].set_ylabel(f"{words}\n({unit(SHOWN[name])} per {unit(analysis.drive_unit)})")
            axes[right].semilogx(omega / HERTZ, phase(channel), color=BLUE)
            axes[right].set_ylabel("phase\n(deg)")
            degrees(axes[right])
        for column in ([axes[row[k]] for row in rows] for k in (0, 1)):
            few_ticks(column)
            share_x(column)
            column[-1].set_xlim(omega[0] / HERTZ, omega[-1] / HERTZ)
            column[-1].set_xlabel("frequency (Hz)")
            for frequency, _ in poles:
                mark(column, frequency)
    return figure


def phase(response: np.ndarray) -> np.ndarray:
    """Phase (n,) [deg], unwrapped, shifted by multiples of 360 deg to start between -270 and 90 deg."""
    unwrapped = np.degrees(np.unwrap(np.angle(response)))
    return unwrapped - 360 * np.floor((unwrapped[0] + 270 - 1e-6) / 360)


def _poles(analysis: Analysis) -> list[tuple[float, str]]:
    """Natural frequency [rad/s] and description of each pole or pole pair that is not an integrator."""
    found: dict[str, tuple[float, str]] = {}
    for pole, frequency, damping in zip(analysis.poles, analysis.natural_frequencies, analysis.damping, strict=True):
        if frequency > 0:
            kind = f"ζ = {number(round(damping, 3))}" if pole.imag else ("real" if pole.real < 0 else "unstable")
            found[f"{frequency:.6g} {kind}"] = (float(frequency), f"{number(frequency / HERTZ)} Hz, {kind}")
    return sorted(found.values())


@draw.register
def loop_figure(loop: LoopAnalysis) -> Figure:
    """Open loop: gain [dB] and phase [deg] over frequency [Hz]; below |S| and |T| [dB] with their peaks.

    Thick bars are the gain margin (top) and the phase margin (middle); their values are above the panels.
    """
    omega, turned = loop.omega, _loop_phase(loop)
    crossover = loop.crossover if np.isfinite([loop.crossover, loop.phase_margin]).all() else None
    turnover = loop.gain_frequency if loop.gain_frequency > 0 else None
    stable = "" if loop.stable else ": NOT STABLE when closed"
    title = f"Position loop with {loop.controller}, broken at the current{stable}"
    rows = [["gain"], ["phase"], ["closed"]]
    notes = list(_margins(loop, crossover, turnover))
    with sheet(title, rows, (2.0, 1.8, 1.8), extra=XLABEL + 0.25, notes=notes) as (figure, axes):
        top, middle, bottom = (axes[row[0]] for row in rows)
        top.semilogx(omega / HERTZ, decibel(np.abs(loop.response)), color=BLUE)
        top.axhline(0.0, color=BLACK, linewidth=0.7, zorder=1.5)
        top.set_ylabel("open loop |L|\n(dB)")
        middle.semilogx(omega / HERTZ, turned, color=BLUE)
        middle.axhline(-180.0, color=BLACK, linewidth=0.7, zorder=1.5)
        middle.set_ylabel("phase of L\n(deg)")
        degrees(middle)
        _closed(bottom, loop)
        if crossover is not None:
            mark([top, middle], crossover)
            middle.plot([crossover / HERTZ] * 2, [-180.0, loop.phase_margin - 180.0], **BAR)
        if turnover is not None:
            mark([top, middle], turnover)
            top.plot([turnover / HERTZ] * 2, [0.0, -float(decibel(loop.gain_margin))], **BAR)
        few_ticks([top, middle, bottom])
        share_x([top, middle, bottom])
        bottom.set_xlabel("frequency (Hz), up to the Nyquist frequency")
        bottom.set_xlim(omega[0] / HERTZ, omega[-1] / HERTZ)
    return figure


def _closed(ax: Axes, loop: LoopAnalysis) -> None:
    """|S| and |T| with their peaks."""
    sensitivity = np.abs(1 / (1 + loop.response))
    curves = {
        "S": (sensitivity, loop.Ms, VERMILION, "-"),
        "T": (np.abs(loop.response) * sensitivity, loop.Mt, GREEN, (0, (5, 2))),
    }
    for name, (curve, peak, colour, dashes) in curves.items():
        label = f"|{name}|, M{name.lower()} = {number(peak)}"
        ax.semilogx(loop.omega / HERTZ, decibel(curve), color=colour, linestyle=dashes, label=label)
        k = int(np.argmax(curve))
        ax.plot(loop.omega[k] / HERTZ, decibel(curve[k]), marker="o", color=colour, markeredgecolor="white", zorder=3)
    decibel_axis(ax, max(ax.dataLim.y0, FLOOR), ax.dataLim.y1 + 5)
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=2, borderpad=0.2, borderaxespad=0.2)
    ax.set_ylabel("closed loop\n(dB)")


def _margins(loop: LoopAnalysis, crossover: float | None, turnover: float | None) -> Iterator[str]:
    """The margins as sentences for the header."""
    if crossover is not None:
        delay = f", delay margin {number(1e3 * loop.delay_margin)} ms" if np.isfinite(loop.delay_margin) else ""
        yield f"crossover {number(crossover / HERTZ)} Hz: phase margin {number(loop.phase_margin)}°{delay}"
    if turnover is not None:
        depth = f"{number(loop.gain_margin)} ({number(float(decibel(loop.gain_margin)))} dB)"
        yield f"phase −180° at {number(turnover / HERTZ)} Hz: gain margin {depth}"


def _loop_phase(loop: LoopAnalysis) -> np.ndarray:
    """Phase (n,) [deg], unwrapped, shifted by multiples of 360 deg to match the phase margin at the crossover."""
    unwrapped = np.degrees(np.unwrap(np.angle(loop.response)))
    if not np.isfinite([loop.crossover, loop.phase_margin]).all():
        return unwrapped - 360 * np.round(unwrapped[0] / 360)
    at = np.interp(np.log(loop.crossover), np.log(loop.omega), unwrapped)
    return unwrapped - 360 * np.round((at - loop.phase_margin + 180) / 360)


def decibel(gain: np.ndarray | float) -> np.ndarray:
    """20 log10 of a gain, with a floor of -240 dB."""
    return np.asarray(20 * np.log10(np.maximum(gain, 1e-12)))


def decibel_axis(ax: Axes, low: float, high: float) -> None:
    """Set range and ticks of a gain axis in dB, with a line at 0 dB."""
    ax.axhline(0.0, color=BLACK, linewidth=0.7, zorder=1.5)
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))


def mark(axes: Sequence[Axes], frequency: float) -> None:
    """Draw a dotted line at a frequency [rad/s] through the panels."""
    for ax in axes:
        ax.axvline(frequency / HERTZ, color=GREY, linestyle=(0, (2, 2)), linewidth=0.9)


def few_ticks(axes: Iterable[Axes]) -> None:
    """Keep only minor ticks at 2 and 5 on logarithmic axes, as all eight take half of the drawing time."""
    for ax in axes:
        for axis in (ax.xaxis, ax.yaxis):
            if axis.get_scale() == "log":
                axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
                axis.set_minor_formatter(NullFormatter())


def degrees(ax: Axes) -> None:
    """Set ticks at multiples of 45 or 90 deg, and a range that contains the curve."""
    low, high = ax.dataLim.y0, ax.dataLim.y1
    step = 45 if high - low <= 200 else 90
    middle, half = (low + high) / 2, max((high - low) / 2 * 1.12, 60.0)
    ax.set_ylim(middle - half, middle + half)
    ax.yaxis.set_major_locator(MultipleLocator(step))
