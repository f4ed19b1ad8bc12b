"""One loop on two plants: what a diagnosis, or a change of the rig, means for it."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.artist import Artist
from matplotlib.figure import Figure

from ...core.errors import InputError
from ...simulation.closed_loop import ClosedLoop
from ..style import GREY, ROLES, SIGNALS, style
from . import _panels as panel

PANELS = ("x", "strip", "error", "current")


def closed_figure(loops: Mapping[str, ClosedLoop], title: str) -> Figure:
    """Position [mm] with reference, error [mm] and current [A] over time [s] of one or two runs of the same loop.

    A strip for each says when its rod sticks.

    Parameters
    ----------
    loops: what each plant is called -> its run, the one before first.

    Raises InputError for no run and for more than two.
    """
    if not 1 <= len(loops) <= 2:
        raise InputError(f"closed_figure got {len(loops)} runs; expected one or two")
    heights = [panel.PANEL] * len(PANELS)
    heights[0] *= 1.4
    heights[1] = panel.ROW * len(loops)
    first = next(iter(loops.values())).trajectory
    with style():
        figure, header, axes = panel.column(heights, title, right=panel.NARROW)
        places = dict(zip(PANELS, axes, strict=True))
        strip = places.pop("strip")
        reference = next(iter(loops.values())).reference[:, 0]
        look = ROLES["reference"] | {"drawstyle": "steps-post"}
        lines: list[Artist] = [panel.draw(places["x"], first.time, SIGNALS["x"].read(reference), look)]
        rows = {}
        for role, (word, loop) in zip(("before", "after"), loops.items(), strict=False):
            run = loop.trajectory
            how = ROLES[role] | {"label": f"{word} plant"}
            thin = how | {"linewidth": 0.7 * how["linewidth"], "drawstyle": "steps-post"}
            lines.append(panel.draw(places["x"], run.time, SIGNALS["x"].read(run["x"]), how))
            panel.draw(places["error"], run.time, SIGNALS["error"].read(loop.error), how)
            panel.draw(places["current"], run.time, SIGNALS["current"].read(run.current), thin)
            rows[f"{word}:\nsticks" if len(word) > 8 else f"{word}: sticks"] = (
                panel.phases(run.time, run.sticks("rod")), how["color"],
            )  # fmt: skip
        strip.set_xlim(first.time[0], first.time[-1])
        for name, ax in places.items():
            panel.fit(ax, SIGNALS[name])
        places["error"].axhline(0.0, color=GREY, linewidth=0.7, zorder=1.5)
        panel.strip(strip, rows)
        panel.legend(header, lines)
    return figure
