"""From a linear model to controllers that are checked on the plant with friction, as a design script.

python examples/control_design.py [FOLDER]

The same steps as notebooks/from_model_to_controller.py without the lecture: margins, hunting and its bounds, cures
against friction, limits, other plants, scenarios.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small here: threads would only wait for each other

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import ehsa_ctrl
from ehsa_ctrl.design.review import Known
from ehsa_ctrl.plant.motion_current import motion_current
from ehsa_ctrl.report.figures import bode_figure, loop_figure, nyquist_figure, robustness_figure, save
from ehsa_ctrl.scenario.hunting import hunting
from ehsa_ctrl.simulation.sensors import Sensors

NAMES = ("pid_position", "pid_tuned", "cascade_position", "lqr_position", "mpc_position")
CURED = ("pid_friction", "cascade_friction", "lqr_friction")
#: Controllers of which figures are kept.
DRAWN = ("pid_position", "lqr_position", "lqr_friction")


def jump(distance, duration, sample_time):
    """A reference (N, 3) that jumps after 0.2 s."""
    reference = np.zeros((round(duration / sample_time), 3))
    reference[round(0.2 / sample_time) :, 0] = distance
    return reference


def slips(run, since):
    """How often the rod breaks away after a time [s], and its hunting [m] peak to peak."""
    late = run.trajectory.time > since
    found = hunting(run.trajectory.time[late], run.trajectory["x"][late])
    return int(found["Slips"]), found["HuntingAmplitude"]


def main(folder):
    linear = ehsa_ctrl.load_plant("ehsa", model="linear")
    rig = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    model = ehsa_ctrl.three_state(linear)
    noise = {channel: rig.sensors[channel].sd for channel in ("speed", "p1", "p2", "position", "force")}
    analysis = ehsa_ctrl.analyse(model)
    print(analysis)
    save(bode_figure(analysis), folder / "bode")

    print("\nDesigned on the linear model: margins of the sampled loop")
    controllers = {name: ehsa_ctrl.load_controller(name, model) for name in (*NAMES, *CURED)}
    for name in NAMES:
        loop = ehsa_ctrl.analyse_loop(model, controllers[name], noise=noise)
        print(loop)
        assert loop.stable and loop.Ms < 1.5
        if name in DRAWN:
            save(loop_figure(loop), folder / f"loop_{name}")
            save(nyquist_figure(loop), folder / f"nyquist_{name}")

    print("\nHeld for half a minute against the spring: who hunts")
    quantum = ehsa_ctrl.slip_quantum(rig)
    print(f"smallest slip {1e6 * quantum:.0f} um")
    for name in ("pid_tuned", "lqr_position", *CURED):
        controller = controllers[name]
        reference = jump(0.010, 30.0, controller.sample_time)
        run = ehsa_ctrl.run_closed_loop(rig, controller, reference, sensors=Sensors.of(rig, seed=0))
        count, amplitude = slips(run, since=3.0)
        error = 1e6 * abs(run.error[-1])
        print(f"{name:<18} {count:3d} slips, hunting {1e6 * amplitude:3.0f} um, error at the end {error:3.0f} um")
        assert (count == 0) == (name in CURED)
        if name in DRAWN:
            save(run.plot(), folder / f"held_{name}")

    print("\nThe scenario steps_spring on the plant with friction")
    for name in (*NAMES, *CURED):
        result = ehsa_ctrl.run("steps_spring", controller=name)
        settling, ratio, error = (result.metrics[m][1] for m in ("SettlingTime", "SettlingRatio", "SteadyStateError"))
        print(
            f"{name:<18} settles in {1e3 * settling:5.0f} ms, {ratio:4.1f} times the shortest possible, stands "
            f"{1e6 * error:3.0f} um off: {result.verdict} {'; '.join(result.failures)}"
        )
        if name in DRAWN:
            save(result.plot(), folder / f"steps_spring_{name}")

    print("\n60 mm at once, without a planned motion: who keeps the pump's speed limit")
    bare = ehsa_ctrl.load_plant("ehsa")
    for name in ("lqr_position", "mpc_position"):
        run = ehsa_ctrl.run_closed_loop(bare, replace(controllers[name], trajectory=None), jump(0.060, 1.2, 0.004))
        share = run.trajectory["omega"].max() / bare.limits["pump_speed"].value
        print(f"{name:<18} {100 * share:.0f} % of it")
        assert (share < 1.0) == (name == "mpc_position")

    print("\nTwenty plants that are not quite this one")
    models = ehsa_ctrl.drawn_models(
        linear,
        ehsa_ctrl.draw(linear, 16, seed=0, unknown=0.1, assumed=True),
        ehsa_ctrl.conditions(stiffnesses=[0.0, 50e3], masses=[0.0, 100.0]),
    )
    needed = motion_current(bare)
    known = Known(static=needed["static"], coulomb=needed["coulomb"], slip=quantum, reach=0.1, noise=noise)
    for name in ("pid_tuned", "lqr_friction"):
        robust = ehsa_ctrl.robust_margins(models, controllers[name], points=120)
        assert robust.stable
        print(ehsa_ctrl.review(model, controllers[name], known=known, robust=robust))
        save(robustness_figure(robust), folder / f"robustness_{name}")

    print("\nHow likely a spread of plants passes")
    for name in ("pid_position", "lqr_friction"):
        campaign = ehsa_ctrl.monte_carlo("spread_steps", runs=60, controller=name)
        print(campaign)
        save(campaign.plot(), folder / f"montecarlo_{name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "results/control_design")))
