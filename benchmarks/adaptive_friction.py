"""Friction fed forward with adaptation and without: wrong numbers, warming oil, and every shipped scenario.

    python benchmarks/adaptive_friction.py [CONTROLLER ...] [--seeds 20] [--minutes 20]

Three tables, those of docs/evidence.md: the RMS error [mm] with friction numbers that are 40 % too small and too large;
the RMS error in the first and last minute of a cycle on a plant whose viscous friction halves while it warms up
(effect viscosity_warmup, time constant a third of the run); and the largest and smallest ratio of the RMS errors with
and without adaptation over all shipped scenarios that a position controller can run, for numbers too small, right and
too large.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import ehsa_ctrl as e
from ehsa_ctrl.core.files import read_toml
from ehsa_ctrl.core.unit import parse
from ehsa_ctrl.scenario.prepare import prepare

DEFAULT = ("pid_friction", "cascade_friction", "lqr_friction", "adrc_friction", "sliding_friction")
#: Scenarios with much motion, for the first table.
MOVING = ("slow_sine", "trapezoid_moves", "press_cycle", "load_cycle")
#: Current of the motion, with the nonlinear set of plants/ehsa.toml; some of the laws know part of it themselves.
MOTION = {"inertia": "0.721 A s2/m", "viscous": "5.87 A s/m", "load": "0.321 A/kN"}
#: Keys of [feedforward] that are friction, with their units.
FRICTION = {"viscous": "A s/m", "coulomb": "A", "static": "A"}
#: Drop of the viscous friction over the run, and the cycle that is repeated: amplitude [m] and frequency [Hz].
DROP, AMPLITUDE, FREQUENCY = 0.5, 0.05, 0.5


def definition(name: str, scale: float, *, adapts: bool) -> dict[str, Any]:
    """A shipped controller with friction numbers times `scale`, with adaptation or without."""
    content = read_toml(e.controllers[name])
    fed = dict(content["feedforward"])
    for key, unit in FRICTION.items():
        if key in fed:
            fed[key] = f"{scale * parse(fed[key], unit):.6g} {unit}"
    if adapts:
        fed["adaptation"] = {**MOTION, "viscous": f"{scale * parse(MOTION['viscous'], 'A s/m'):.6g} A s/m"}
    return {**content, "feedforward": fed}


def rms(scenario: str, name: str, scale: float, *, adapts: bool, seeds: int) -> float:
    """RMS error [m] of a scenario on the nonlinear plant, over several seeds of the sensor noise."""
    case = prepare(scenario, controller=definition(name, scale, adapts=adapts))
    squares = [np.mean(case.simulate(case.nonlinear, seed).error ** 2) for seed in range(seeds)]
    return float(np.sqrt(np.mean(squares)))


def warmed(name: str, minutes: float, *, adapts: bool) -> tuple[float, float, float]:
    """RMS error [m] in the first and the last minute of a warm-up, and the last factor of the viscous friction."""
    linear = e.three_state(e.load_plant("ehsa", model="linear"))
    law = e.load_controller(definition(name, 1.0, adapts=adapts), linear)
    plant = e.load_plant("ehsa").with_effects("viscosity_warmup", drop=DROP, tau_w=20.0 * minutes)
    time = law.sample_time * np.arange(round(60.0 * minutes / law.sample_time) + 1)
    w = 2.0 * np.pi * FREQUENCY
    motion = [np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)]
    loop = e.run_closed_loop(plant, law, AMPLITUDE * np.column_stack(motion), sensors=e.Sensors.of(plant, seed=0))
    minute = round(60.0 / law.sample_time)
    first, last = (float(np.sqrt(np.mean(loop.error[part] ** 2))) for part in (slice(0, minute), slice(-minute, None)))
    return first, last, 1.0 + float(loop["viscous_factor"][-1]) if adapts else 1.0


def runnable() -> list[str]:
    """Shipped scenarios of the EHSA without a force target, which a position controller can run."""
    found = {name: e.load_scenario(name).definition for name in e.scenarios}
    return [name for name, one in found.items() if one.plant == "ehsa" and one.reference.force is None]


def table(heads: list[str], rows: list[list[str]]) -> None:
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    print()


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("controllers", nargs="*", default=list(DEFAULT))
    parser.add_argument(
        "--seeds", type=int, default=20, help="of the sensor noise; a rod that stops is scattered by it"
    )
    parser.add_argument("--minutes", type=float, default=20.0, help="length of the warm-up")
    asked = parser.parse_args()
    rows = []
    for name in asked.controllers:
        for scale in (0.6, 1.4):
            pairs = [
                [rms(one, name, scale, adapts=adapts, seeds=asked.seeds) for adapts in (False, True)] for one in MOVING
            ]
            rows.append([name, f"{100 * (scale - 1):+.0f} %", *(f"{1e3 * a:.3g} → {1e3 * b:.3g}" for a, b in pairs)])
    table(["RMS error (mm)", "friction numbers", *MOVING], rows)
    rows = []
    for name in asked.controllers:
        fixed, adapted = (warmed(name, asked.minutes, adapts=adapts) for adapts in (False, True))
        cells = [f"{1e3 * a:.3g} → {1e3 * b:.3g}" for a, b in zip(fixed[:2], adapted[:2], strict=True)]
        rows.append([name, *cells, f"{adapted[2]:.2f}"])
    table(["warm-up, RMS error (mm)", "first minute", "last minute", "factor of viscous friction"], rows)
    rows = []
    for name in asked.controllers:
        cells = []
        for scale in (0.6, 1.0, 1.4):
            ratios = {}
            for one in runnable():
                without, with_it = (rms(one, name, scale, adapts=adapts, seeds=asked.seeds) for adapts in (False, True))
                ratios[one] = with_it / without
            worst, best = max(ratios, key=lambda one: ratios[one]), min(ratios, key=lambda one: ratios[one])
            cells.append(f"{ratios[worst]:.3f} ({worst}), {ratios[best]:.3f} ({best})")
        rows.append([name, *cells])
    table(["RMS error with over without, largest and smallest", "-40 %", "right", "+40 %"], rows)


if __name__ == "__main__":
    main()
