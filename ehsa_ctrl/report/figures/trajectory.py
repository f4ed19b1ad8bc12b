"""One run of a plant over time."""

from __future__ import annotations

from matplotlib.figure import Figure

from ...core.errors import InputError
from ...core.plotting import draw
from ...simulation.trajectory import Trajectory
from ..style import PRESSURES, ROLES, SIGNALS, style
from . import _panels as panel


@draw.register
def trajectory_figure(run: Trajectory) -> Figure:
    """Current [A], speed [rpm], both pressures [bar] and position [mm] over time [s].

    A strip shows when shaft and rod stick; the force from outside [kN] has a panel if there is one. Limits of the
    plant that the run passed are lines, with a cross at the first sample beyond.

    Raises InputError for a plant of another system than the EHSA, whose signals are others.
    """
    system = run.plant.structure.system_name
    if system != "ehsa":
        raise InputError(f"{run.plant.name} is a {system!r} system; the figure of a run is made for 'ehsa' alone")
    names = ["current", "omega", "pressures", "x"] + (["force"] if run.outer_force.any() else [])
    contacts = [contact.name for contact in run.plant.structure.system.contacts]
    heights = [panel.PANEL] * len(names) + [panel.ROW * len(contacts)]
    # Dashes tell models apart where two are overlaid; alone they would only hide what happens between them.
    how = {"color": ROLES[run.plant.model]["color"], "linewidth": 1.2, "label": f"{run.plant.model} model"}
    held = {"drawstyle": "steps-post"} if run.hold == "zero_order" else {}
    signals = {"force": run.outer_force} | {name: run[name] for name in ("current", "omega", "x")}
    with style():
        title = f"{run.plant.name}: simulated run"
        words = panel.passed_words(run.exceeded)
        figure, header, axes = panel.column(heights, title, notes=words, right=panel.beside_width(run))
        places = dict(zip(names, axes, strict=False))
        pressures = [
            panel.draw(places["pressures"], run.time, SIGNALS["pressures"].read(run[symbol]), line)
            for symbol, line in PRESSURES.items()
        ]
        for name in names:
            if name != "pressures":
                stepwise = held if name in ("current", "force") else {}
                line = panel.draw(places[name], run.time, SIGNALS[name].read(signals[name]), how | stepwise)
        axes[-1].set_xlim(run.time[0], run.time[-1])
        limits = panel.passed_limits(places, run)
        for name, ax in places.items():
            panel.fit(ax, SIGNALS[name])
            panel.beside(ax, (pressures if name == "pressures" else []) + limits[name])
        stuck = {f"{name} sticks": (panel.phases(run.time, run.sticks(name)), panel.STUCK) for name in contacts}
        panel.strip(axes[-1], stuck)
        panel.legend(header, [line])
    return figure
