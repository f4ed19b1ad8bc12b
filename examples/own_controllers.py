"""Controllers of your own: a compensator of python-control, a function, an object with state, a changed definition.

python examples/own_controllers.py [FOLDER]

All of them run in the scenarios beside the shipped ones. The figure goes to FOLDER, results/own by default.
"""

import sys
from pathlib import Path

import control

import ehsa_ctrl as e

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "results/own")
folder.mkdir(parents=True, exist_ok=True)

# %% Ten lines: design on the linearised plant, compare with a law of your own in a scenario
model = e.linearise(e.load_plant("ehsa"))
lead = control.tf([12.0, 300.0], [0.004, 1.0], name="lead")  # position error [m] to current [A]


def damped(t, y, r):
    return 2000.0 * (r.position - y.position) - 0.03 * y.speed


stiff = e.load_controller("lqr_position", model, weights={"position": 0.3e-3}, label="lqr_stiff")
table = e.run("steps_spring", controller=["pid_friction", stiff, lead, damped])
print(stiff, table, sep="\n\n")


# %% An object keeps its state between samples; each run gets a copy of it
class Integrating:
    """The damped law with an integral of the error, stopped near the target: without that it would hunt."""

    integral = 0.0

    def step(self, t, y, r):
        error = r.position - y.position
        if abs(error) > 50e-6:
            self.integral += 0.004 * error
        return damped(t, y, r) + 12000.0 * self.integral


moves = e.load_scenario(
    {"plant": "ehsa", "duration": 4.0, "load": {"stiffness": 50e3}, "limits": {"SteadyStateError": {"max": 1e-4}}},
    reference={"kind": "moves", "times": [0.1, 2.0], "positions": [0.010, -0.005], "durations": [0.6, 0.6]},
    label="two_moves",
)
integrating = e.load_controller(Integrating(), current_limit=6.0)
result = e.run(moves, controller=integrating)
loop = result.nonlinear
print(f"\n{result}\nlargest current {abs(loop['current']).max():.2f} A, final error {1e6 * loop['error'][-1]:.0f} um")
e.figures.save(result.plot(), folder / "two_moves")

assert table["lqr_stiff"].passed and not table["damped"].passed
