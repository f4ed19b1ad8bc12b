"""The figure of the first page: steps, the linear prediction and the plant with friction.

python docs/_site/first_figure.py writes docs/figures/first_step.svg.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ehsa_ctrl as e
from ehsa_ctrl.report.figures import overlay_figure, save

FIGURES = Path(__file__).parents[1] / "figures"
#: Shown duration [s] and shown range of the error [m].
LAST, SMALL = 5.0, 0.5e-3

if __name__ == "__main__":
    result = e.run("steps_spring")
    shown = result.nonlinear.trajectory.time <= LAST
    time = result.nonlinear.trajectory.time[shown]
    loops = {"linear": result.linear, "nonlinear": result.nonlinear}
    reference = result.nonlinear.reference[shown, 0]
    position = {"reference": reference, **{name: loop.trajectory["x"][shown] for name, loop in loops.items()}}
    error = {name: reference - position[name] for name in loops}
    # The steady-state error is a hundredth of the step; larger errors are cut off.
    error = {name: np.where(np.abs(values) < SMALL, values, np.nan) for name, values in error.items()}
    panels = {
        "position (mm)": {name: 1e3 * values for name, values in position.items()},
        "error, enlarged (mm)": {name: 1e3 * values for name, values in error.items()},
    }
    png, svg = save(overlay_figure(time, panels, title=result.scenario.title), FIGURES / "first_step")
    png.unlink()
    print(f"written to {svg}")
