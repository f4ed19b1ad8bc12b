"""Controllers under friction: steps of 1, 5 and 20 mm and a sine against a spring of 50 kN/m.

    python benchmarks/friction.py [CONTROLLER ...] [--seeds 5] [--draws 100]

For each controller: ratio of the settling time to the shortest one that the current limit allows, overshoot,
steady-state error and slips in a hold of five seconds, each the worst over noise seeds and both directions; error in a
sine of 1 Hz and 10 mm with friction feed-forward and, with the same gains, without; margins over draws within two
standard deviations (5 % each) of the linear set. Prints the table of docs/evidence.md and writes friction.json.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from step_and_sine import sine_error, step_and_back

import ehsa_ctrl as e
from ehsa_ctrl.design.analysis.robustness import robust_margins
from ehsa_ctrl.design.controller import SampledController
from ehsa_ctrl.plant.draws import draw
from ehsa_ctrl.scenario.response import hunting
from ehsa_ctrl.simulation.slip_quantum import slip_quantum

HOLD = 5.0
#: Relative standard deviation of the values of Table 2.
UNKNOWN = 0.05
SIZES = (0.001, 0.005, 0.02)
DEFAULT = ("pid_position", "pid_friction", "cascade_position", "cascade_friction", "lqr_friction", "mpc_friction")


@dataclass(frozen=True)
class Step:
    """The worse of a step and the step back."""

    settling: float
    ratio: float
    overshoot: float
    standing: float
    slips: float


def plant() -> e.Plant:
    return e.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})


def controller(name: str) -> SampledController:
    return e.load_controller(name, e.three_state(e.load_plant("ehsa", model="linear")))


def step(name: str, size: float, seed: int) -> Step:
    """A step to `size` and back, held for WAIT + HOLD each."""
    found = [
        Step(
            leg.metrics["SettlingTime"],
            leg.ratio,
            leg.metrics["Overshoot"],
            leg.standing,
            hunting(leg.time, leg.x)["Slips"],
        )
        for leg in step_and_back(controller(name), plant(), size, seed=seed, hold=HOLD)
    ]
    # np.max propagates nan: a step that never settles is the worst.
    return Step(*(float(np.max([getattr(one, key) for one in found])) for key in Step.__dataclass_fields__))


def sine(name: str, *, compensated: bool, seed: int = 0) -> float:
    """RMS error [m] from the second period on in a sine of 1 Hz and 10 mm."""
    law, real = controller(name), plant()
    if not compensated and law.feedforward is not None:
        law = replace(law, feedforward=law.feedforward.model_copy(update={"coulomb": 0.0, "static": None}))
    return sine_error(law, real, seed=seed)


def margins(name: str, draws: int) -> tuple[float, float]:
    """Largest Ms and least disk margin over draws of the linear set."""
    linear = e.load_plant("ehsa", model="linear")
    drawn = {"nominal": linear} | {
        f"draw {k}": one for k, one in enumerate(draw(linear, draws, seed=0, within=2.0, unknown=UNKNOWN))
    }
    worst = robust_margins({label: e.three_state(one) for label, one in drawn.items()}, controller(name))
    return worst.Ms, worst.disk_margin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("controllers", nargs="*", default=list(DEFAULT))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--draws", type=int, default=100)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("friction.json"))
    asked = parser.parse_args()
    print(f"slip quantum {1e6 * slip_quantum(plant()):.0f} um; worst of {asked.seeds} seeds, both directions\n")
    heads = " | ".join(f"{1e3 * size:g} mm" for size in SIZES)
    print(f"| | {heads} | sine, without | Ms, disk margin |")
    print("|---|" + "---|" * (len(SIZES) + 2))
    everything = {}
    for name in asked.controllers:
        row, kept = [], {}
        for size in SIZES:
            steps = Parallel(n_jobs=asked.jobs)(delayed(step)(name, size, seed) for seed in range(asked.seeds))
            worst = {key: float(np.max([getattr(one, key) for one in steps])) for key in Step.__dataclass_fields__}
            kept[f"{1e3 * size:g} mm"] = worst
            row.append(
                f"{worst['ratio']:.2f}x, {100 * worst['overshoot']:.1f} %, {1e6 * worst['standing']:.0f} um, "
                f"{worst['slips']:.0f}"
            )
        with_it, without = sine(name, compensated=True), sine(name, compensated=False)
        Ms, disk = margins(name, asked.draws)
        kept |= {"sine": with_it, "sine_without": without, "Ms": Ms, "disk_margin": disk}
        everything[name] = kept
        print(f"| {name} | {' | '.join(row)} | {1e3 * with_it:.3f}, {1e3 * without:.3f} mm | {Ms:.2f}, {disk:.2f} |")
        asked.out.write_text(json.dumps(everything, indent=1) + "\n")


if __name__ == "__main__":
    main()
