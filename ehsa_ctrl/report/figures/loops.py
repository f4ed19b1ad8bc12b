"""Linear loops: Nyquist plot, robustness over several plants, reference and force steps."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ...core.plotting import draw
from ...design.analysis.closed_loop import StepResponse
from ...design.analysis.loop import LoopAnalysis
from ...design.analysis.robustness import RobustMargins
from ..signals import SIGNALS, drive_signal
from ..style import BLACK, BLUE, GREEN, GREY, PURPLE, SKY, VERMILION
from ..text import number
from . import _panels as panel
from ._layout import XLABEL, share_x, sheet
from .frequency import HERTZ, decibel, decibel_axis, few_ticks

#: Range of the complex plane that is shown, and the panel's height, in.
REAL, IMAGINARY, HEIGHT = (-3.2, 1.6), (-2.0, 2.0), 5.6
#: Largest number of other plants drawn; more would only fill the panel.
MOST = 150
#: |S| and |T| over many plants are not shown below this, dB.
FLOOR = -25.0
#: Largest number of characters of a plant's name in a legend.
NAME = 62
#: Steps of the linear loop: 1 mm of reference, 1 kN of force.
STEPS = {"reference": (1e-3, "reference 1 mm"), "force": (1e3, "force on the rod 1 kN")}


def nyquist_figure(loop: LoopAnalysis, robust: RobustMargins | None = None) -> Figure:
    """L(e^{iwh}) around -1, up to the Nyquist frequency, with the disk of the disk margin.

    The filled disk contains -1/f for all factors f that the disk margin guarantees; the dashed circle is
    |1 + L| = 1/Ms. With `robust`, thin lines show the loop with each of its plants, and the disk is that of the worst.
    """
    alpha = loop.disk_margin if robust is None else robust.disk_margin
    plants = "" if robust is None else f", {len(robust.loops)} plants"
    if robust is not None and robust.unstable:
        plants += f", {len(robust.unstable)} of them NOT STABLE"
    unstable = "" if loop.stable else ": NOT STABLE when closed"
    with sheet(f"Nyquist plot with {loop.controller}{plants}{unstable}", [["plane"]], [HEIGHT]) as (figure, axes):
        ax = axes["plane"]
        for k, other in enumerate(list(robust.loops.values())[:MOST] if robust is not None else []):
            label = "other plants" if k == 0 else None
            ax.plot(*_parts(other), color=SKY, linewidth=0.5, zorder=1.8, label=label)
        ax.plot(*_parts(loop), color=BLUE, linewidth=1.8, zorder=2.4, label="loop gain L")
        # The unit circle, on which the phase margin is read.
        unit = {"fill": False, "edgecolor": GREY, "linestyle": (0, (2, 2)), "linewidth": 0.9, "zorder": 1.7}
        ax.add_patch(Circle((0.0, 0.0), 1.0, label="|L| = 1", **unit))
        if alpha > 0:
            # For alpha >= 2 the set is not a disk; the one drawn instead exceeds the panel.
            centre, radius = disk_of(min(alpha, 1.99))
            look = {"facecolor": VERMILION, "alpha": 0.25, "edgecolor": VERMILION, "linewidth": 1.2, "zorder": 1.6}
            name = "disk margin" if robust is None else "worst disk margin"
            ax.add_patch(Circle((centre, 0.0), radius, label=f"{name} {number(round(alpha, 3))}", **look))
        if np.isfinite(loop.Ms) and robust is None:
            look = {"fill": False, "edgecolor": PURPLE, "linestyle": (0, (5, 2)), "linewidth": 1.1, "zorder": 2.2}
            ax.add_patch(Circle((-1.0, 0.0), 1 / loop.Ms, label=f"|1 + L| = 1/Ms, Ms = {number(loop.Ms)}", **look))
        ax.plot(-1.0, 0.0, marker="+", color=BLACK, markersize=10, markeredgewidth=1.6, linestyle="none", zorder=3)
        ax.set_xlim(REAL)
        ax.set_ylim(IMAGINARY)
        ax.set_aspect("equal", adjustable="box")
        ax.set_xlabel("real part of L (1)")
        ax.set_ylabel("imaginary part of L (1)")
        ax.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")
    return figure


def disk_of(alpha: float) -> tuple[float, float]:
    """Centre and radius of the disk that L avoids: diameter from -(2 + a) / (2 - a) to -(2 - a) / (2 + a)."""
    far, near = -(2 + alpha) / (2 - alpha), -(2 - alpha) / (2 + alpha)
    return (far + near) / 2, (near - far) / 2


def _parts(loop: LoopAnalysis) -> tuple[np.ndarray, np.ndarray]:
    """Real and imaginary parts of L with |L| < 50, far beyond the panel; the branch of an integrator is unbounded."""
    near = np.abs(loop.response) < 50.0
    return loop.response.real[near], loop.response.imag[near]


@draw.register
def robustness_figure(robust: RobustMargins) -> Figure:
    """|S| (top) and |T| [dB] over frequency [Hz]: the band of all plants, the first and the worst plant.

    Raises InputError if no loop is stable.
    """
    many = len(robust.loops)
    lost = f", {len(robust.unstable)} of them NOT STABLE" if robust.unstable else ""
    title = f"Position loop with {robust.controller} and {many} plants{lost}"
    omega, _, highest = robust.band("S")
    with sheet(title, [["S"], ["T"]], [2.3, 2.3], extra=XLABEL + 1.2) as (figure, axes):
        _band(axes["S"], robust, "S", "Ms", VERMILION)
        _band(axes["T"], robust, "T", "Mt", GREEN)
        few_ticks(axes.values())
        share_x(list(axes.values()))
        axes["T"].set_xlabel("frequency (Hz), up to the Nyquist frequency")
        axes["T"].set_xlim(0.7 * omega[int(np.argmax(decibel(highest) > FLOOR))] / HERTZ, omega[-1] / HERTZ)
    return figure


def _band(ax: Axes, robust: RobustMargins, name: str, margin: str, colour: str) -> None:
    omega, low, high = robust.band(name)
    label = f"range over the {len(robust.loops) - len(robust.unstable)} stable loops"
    ax.fill_between(omega / HERTZ, decibel(low), decibel(high), color=colour, alpha=0.25, linewidth=0, label=label)
    stable = {label: loop for label, loop in robust.loops.items() if loop.stable}
    first = next(iter(stable))
    worst = max(stable, key=lambda label: float(getattr(stable[label], margin)))
    shown = [(first, BLUE, "-", 1.5)] + [(worst, colour, (0, (4, 1.5)), 1.5)] * (worst != first)
    for label, own, dashes, width in shown:
        loop = stable[label]
        curve = np.abs(loop.sensitivity if name == "S" else 1 - loop.sensitivity)
        short = textwrap.shorten(label, NAME, placeholder=" ...")
        words = f"{short}: {margin} = {number(round(float(getattr(loop, margin)), 3))}"
        ax.semilogx(loop.omega / HERTZ, decibel(curve), color=own, linestyle=dashes, linewidth=width, label=words)
    decibel_axis(ax, FLOOR, float(decibel(np.max(high))) + 4)
    ax.set_ylabel(f"|{name}|\n(dB)")
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=1, borderpad=0.2, borderaxespad=0.2, labelspacing=0.2)


def step_figure(steps: StepResponse) -> Figure:
    """Position [mm] and drive over time [s]: left after a reference step of 1 mm, right after 1 kN on the rod."""
    title = f"Linear loop with {steps.controller}: steps of reference and force, no limit, no friction"
    rows = [[f"{name} {signal}" for name in STEPS] for signal in ("x", "current")]
    drive = "current" if steps.drive_unit == "A" else "drive_force"
    shown = {"x": SIGNALS["x"], "current": drive_signal(drive, steps.drive_unit)}
    with sheet(title, rows, [1.8, 1.5], extra=XLABEL + 0.2) as (figure, axes):
        for name, (size, words) in STEPS.items():
            column = [axes[f"{name} {signal}"] for signal in ("x", "current")]
            share_x(column)
            column[0].set_title(words, fontsize=9)
            for ax, signal, values in zip(column, ("x", "current"), (steps.position, steps.current), strict=True):
                stepwise = "steps-post" if signal == "current" else "default"
                ax.plot(steps.time, shown[signal].read(size * values[name]), color=BLUE, drawstyle=stepwise)
                panel.set_range(ax, shown[signal])
                if name == "force":
                    ax.set_ylabel("")
            column[-1].set_xlim(steps.time[0], steps.time[-1])
            column[-1].set_xlabel("time (s)")
        axes["reference x"].axhline(1.0, color=BLACK, linewidth=0.7, linestyle=(0, (6, 3)), zorder=1.5)
    return figure
