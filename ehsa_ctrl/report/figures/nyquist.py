"""The loop gain in the complex plane, and the disks that it stays out of."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ...design.analysis.loop import LoopAnalysis
from ...design.analysis.robustness import RobustMargins
from ..number import number
from ..style import BLACK, BLUE, GREY, PURPLE, SKY, VERMILION, WIDTH, style
from ._layout import sheet

#: What is shown of the plane, and the panel's height, in.
REAL, IMAGINARY, HEIGHT = (-3.2, 1.6), (-2.0, 2.0), 5.6
#: So many other plants are drawn; more only blacken the sheet.
MOST = 150


def nyquist_figure(loop: LoopAnalysis, robust: RobustMargins | None = None) -> Figure:
    """L(e^{iwh}) around -1 [1], up to half of the sampling's frequency, with the disk of the disk margin.

    The filled disk is all -1/f for the factors f that the disk margin guarantees; the dashed circle is |1 + L| = 1/Ms.
    With `robust`, thin lines are the loop with each of its plants, and the disk is that of the worst.
    """
    alpha = loop.disk_margin if robust is None else robust.disk_margin
    plants = "" if robust is None else f", {len(robust.loops)} plants"
    if robust is not None and robust.unstable:
        plants += f", {len(robust.unstable)} of them NOT STABLE"
    unstable = "" if loop.stable else ": NOT STABLE when closed"
    with style():
        title = f"Position loop with {loop.controller}{plants}{unstable}"
        figure, start = sheet(title, header=0.1, heights=[HEIGHT])
        total = figure.get_figheight()
        ax = figure.add_axes((0.9 / WIDTH, 1 - (start + HEIGHT) / total, (WIDTH - 1.05) / WIDTH, HEIGHT / total))
        if robust is not None:
            for k, other in enumerate(list(robust.loops.values())[:MOST]):
                label = "other plants" if k == 0 else None
                ax.plot(*_parts(other), color=SKY, linewidth=0.5, zorder=1.8, label=label)
        ax.plot(*_parts(loop), color=BLUE, linewidth=1.8, zorder=2.4, label="loop gain L")
        _unit(ax)
        if alpha > 0:
            _disk(ax, alpha, "disk margin" if robust is None else "worst disk margin")
        if np.isfinite(loop.Ms) and robust is None:
            how = {"fill": False, "edgecolor": PURPLE, "linestyle": (0, (5, 2)), "linewidth": 1.1, "zorder": 2.2}
            ax.add_patch(Circle((-1.0, 0.0), 1 / loop.Ms, label=f"|1 + L| = 1/Ms, Ms = {number(loop.Ms)}", **how))
        ax.plot(-1.0, 0.0, marker="+", color=BLACK, markersize=10, markeredgewidth=1.6, linestyle="none", zorder=3)
        ax.set_xlim(REAL)
        ax.set_ylim(IMAGINARY)
        ax.set_aspect("equal", adjustable="box")
        ax.set_xlabel("real part of L (1)")
        ax.set_ylabel("imaginary part of L (1)")
        ax.legend(loc="upper right", frameon=True, framealpha=0.9, edgecolor="none")
    return figure


def disk_of(alpha: float) -> tuple[float, float]:
    """Centre and radius of the disk that L stays out of: diameter from -(2 + a) / (2 - a) to -(2 - a) / (2 + a)."""
    far, near = -(2 + alpha) / (2 - alpha), -(2 - alpha) / (2 + alpha)
    return (far + near) / 2, (near - far) / 2


def _disk(ax: Axes, alpha: float, name: str) -> None:
    # Beyond 2 the set is no disk any more; what is drawn then is as large as the sheet.
    centre, radius = disk_of(min(alpha, 1.99))
    how = {"facecolor": VERMILION, "alpha": 0.25, "edgecolor": VERMILION, "linewidth": 1.2, "zorder": 1.6}
    ax.add_patch(Circle((centre, 0.0), radius, label=f"{name} {number(round(alpha, 3))}", **how))


def _unit(ax: Axes) -> None:
    """The circle on which the phase margin is read."""
    how = {"fill": False, "edgecolor": GREY, "linestyle": (0, (2, 2)), "linewidth": 0.9, "zorder": 1.7}
    ax.add_patch(Circle((0.0, 0.0), 1.0, label="|L| = 1", **how))


def _parts(loop: LoopAnalysis) -> tuple[np.ndarray, np.ndarray]:
    """Real and imaginary part where they are not far off the sheet: an integrator's branch goes to infinity."""
    near = np.abs(loop.response) < 50.0
    return loop.response.real[near], loop.response.imag[near]
