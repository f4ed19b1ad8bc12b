"""The linear model from the current to its outputs."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...core.unit import factor
from ...design.analysis.system import OUTPUTS, Analysis
from ..number import number, unit
from ..style import BLUE, SIGNALS, WIDTH, style
from ._frequency import arranged, degrees, few_ticks, header, mark, name_marks
from ._layout import sheet, stack

#: A person reads a gain in these units per ampere; the speed in rad/s, so that it fits the frequency axis.
SHOWN = {"omega": "rad/s", "dP": "bar", "v": "mm/s", "x": "mm"}
#: Height of a row and what is left of the panels, in.
ROW, LEFT = 1.5, 1.05


def bode_figure(analysis: Analysis) -> Figure:
    """Magnitude [rad/s, bar, mm/s, mm per A] and phase [deg] from the current to each output over frequency [rad/s].

    One row an output; poles are marked at their natural frequency.
    """
    outputs = [name for name in OUTPUTS if name in analysis.system.output_labels]
    poles = _poles(analysis)
    centres = [frequency for frequency, _ in poles] or [1.0]
    omega = np.geomspace(min(centres) / 50, 50 * max(centres), 2000)
    response = np.asarray(analysis.system(1j * omega))
    marks = arranged(poles, omega[0], omega[-1], width=0.27)
    heights = [ROW] * len(outputs)
    with style():
        title = f"{analysis.system.name}: from the current"
        figure, top = sheet(title, header=header(marks), heights=heights)
        columns = [
            stack(figure, heights, top=top, left=LEFT, right=WIDTH / 2 + 0.05, ticks=0.52),
            stack(figure, heights, top=top, left=WIDTH / 2 + 0.8, right=0.15, ticks=0.45),
        ]
        for left, right, name in zip(*columns, outputs, strict=True):
            channel = response[analysis.system.output_labels.index(name), 0]
            left.loglog(omega, np.abs(channel) / factor(SHOWN[name], OUTPUTS[name]), color=BLUE)
            left.set_ylabel(f"{SIGNALS[name].words}\n({unit(SHOWN[name])} per A)")
            right.semilogx(omega, phase(channel), color=BLUE)
            right.set_ylabel("phase\n(deg)")
            degrees(right)
        for axes in columns:
            few_ticks(axes)
            axes[-1].set_xlim(omega[0], omega[-1])
            axes[-1].set_xlabel("frequency (rad/s)")
            name_marks(axes[0], marks)
            for frequency, _ in poles:
                mark(axes, frequency)
    return figure


def phase(response: np.ndarray) -> np.ndarray:
    """Phase (n,) [deg], unwrapped, on the turn on which it begins between -270 and 90 deg."""
    unwrapped = np.degrees(np.unwrap(np.angle(response)))
    return unwrapped - 360 * np.floor((unwrapped[0] + 270 - 1e-6) / 360)


def _poles(analysis: Analysis) -> list[tuple[float, str]]:
    """Natural frequency [rad/s] and words of each pole or pair that is not an integrator."""
    found: dict[str, tuple[float, str]] = {}
    for pole, frequency, damping in zip(analysis.poles, analysis.natural_frequencies, analysis.damping, strict=True):
        if frequency > 0:
            kind = f"ζ = {number(round(damping, 3))}" if pole.imag else ("real" if pole.real < 0 else "unstable")
            found[f"{frequency:.6g} {kind}"] = (float(frequency), f"{number(frequency)} rad/s\n{kind}")
    return sorted(found.values())
