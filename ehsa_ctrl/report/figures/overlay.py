"""Measured against simulated, one panel a signal."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ...core.errors import InputError, choices
from ..style import ROLES, Signal, style
from . import _panels as panel


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
    with style():
        figure, header, axes = panel.column([1.5 * panel.PANEL] * len(panels), title)
        lines = {}
        for ax, (label, roles) in zip(axes, panels.items(), strict=True):
            for role, values in roles.items():
                lines[role] = panel.draw(ax, time, np.asarray(values, dtype=float), ROLES[role])
            panel.fit(ax, Signal(label.rpartition(" (")[0], "1", "1", 0.0))
            ax.set_ylabel("\n(".join(label.rsplit(" (", 1)))
        axes[-1].set_xlim(time[0], time[-1])
        panel.legend(header, [lines[role] for role in ROLES if role in lines])
    return figure
