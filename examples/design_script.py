"""From the paper's linear set to a checked loop, as a design script.

python examples/design_script.py [FOLDER]
"""

import sys
from pathlib import Path

import control
import numpy as np

import ehsa_ctrl
from ehsa_ctrl.report.figures import bode_figure, loop_figure, save
from ehsa_ctrl.scenario.metrics import step_metrics


def main(folder):
    # The identified linear model as a python-control state space: (7) plus position.
    linear = ehsa_ctrl.load_plant("ehsa", model="linear")
    model = ehsa_ctrl.three_state(linear)
    print(ehsa_ctrl.analyse(model))
    print("slowest pole by python-control:", np.round(max(model.poles()[np.abs(model.poles()) > 1].real), 3), "rad/s")

    # A controller designed on it, and the margins of its loop.
    pid = ehsa_ctrl.load_controller("pid_position", model)
    loop = ehsa_ctrl.analyse_loop(model, pid)
    print(pid)
    print(loop)

    # The same controller on both plants, 10 mm against a spring.
    reference = np.zeros((1000, 3))
    reference[25:, 0] = 0.010
    for name in ("linear", "nonlinear"):
        plant = ehsa_ctrl.load_plant("ehsa", model=name, settings={"load.stiffness": "50 kN/m"})
        run = ehsa_ctrl.run_closed_loop(plant, pid, reference).trajectory
        found = step_metrics(run.time[25:], run["x"][25:], 0.0, 0.010)
        print(
            f"{name:<10} rise {1e3 * found['RiseTime']:5.0f} ms, overshoot {100 * found['Overshoot']:5.2f} %, "
            f"settled after {1e3 * found['SettlingTime']:5.0f} ms, "
            f"standing error {1e6 * found['SteadyStateError']:5.1f} um"
        )
        save(run.plot(), folder / f"step_{name}")
    save(bode_figure(ehsa_ctrl.analyse(model)), folder / "bode")
    save(loop_figure(loop), folder / "loop")

    # python-control's own functions work on the nonlinear plant too, with smoothed friction.
    plant = ehsa_ctrl.load_plant("ehsa")
    point = control.linearize(
        ehsa_ctrl.to_iosystem(plant), ehsa_ctrl.simulate(plant, np.full(500, 1.5)).states[-1], [1.5, 0.0]
    )
    print("sliding at 1.5 A, slowest poles:", np.round(np.sort(np.abs(point.poles()))[:3], 2), "rad/s")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/design")))
