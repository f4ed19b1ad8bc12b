"""All position controllers on one task: the same specification, the same tuning budget, the same stages around the law.

    python benchmarks/controllers.py [KIND ...] [--seeds 3] [--budget 400] [--out controllers.json]

Each kind is tuned by `tune_keys` for the least ITAE of a load step within the same bounds on Ms, Mt, disk margin and
noise gain, on the linear model with the nominal payload. Then, on the nonlinear plant with friction and spring:

- steps of 1, 5 and 20 mm there and back: settling time over the shortest one that the current limit allows, error while
  holding, RMS current; the worst of both directions and of all noise seeds;
- the same without friction feed-forward and deadband at rest;
- a sine of 1 Hz and 10 mm: RMS error, with the feed-forward and without;
- the step of 20 mm with friction, torque constant and payload each 20 % off, and with all eight combinations.

The friction feed-forward keeps its nominal numbers throughout. Prints the tables of docs/controllers.md, writes JSON.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from step_and_sine import sine_error, step_and_back

import ehsa_ctrl as e
from ehsa_ctrl.design.controller import SampledController
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.specification import ControllerDesign, design
from ehsa_ctrl.design.tuning.constraints import Tuning

HOLD = 3.0
SIZES = (0.001, 0.005, 0.02)
OFF = 0.2
PAYLOAD, SPRING = 50.0, 50e3
FRICTION = ("A_FM", "C_FM", "A_FR", "C_FR")
BOUNDS = {"Ms": 1.5, "Mt": 1.4, "disk_margin": 0.7, "noise_gain": "8000 A/m"}
#: Friction, as in controllers/lqr_friction.toml; with the rigid body where the law has no model of it.
FRICTION_CURRENT = {"coulomb": "0.941 A", "static": "1.076 A", "stribeck": "3.9 mm/s"}
RIGID_BODY = {"inertia": "0.737 A s2/m", "viscous": "5.87 A s/m"}
STAGES = {
    "trajectory": {"speed": "0.16 m/s", "acceleration": "4 m/s2", "duration": "160 ms"},
    "rest": {"band": "40 um", "release": "90 um", "patience": "30 ms"},
}
OBSERVER = {"leak": "2 rad/s"}
#: What a kind needs besides the tuned keys.
OWN: dict[str, dict[str, Any]] = {
    "pid": {"design": {"crossover": "35 rad/s", "phase_margin": "60 deg"}, "derivative_reference_weight": 1.0},
    "cascade": {
        "speed": {"crossover": "130 rad/s", "phase_margin": "65 deg"},
        "position": {"crossover": "30 rad/s", "speed_limit": "450 rad/s"},
    },
    "lqr": {"weights": {"position": "0.5 mm"}, "observer": OBSERVER},
    "mpc": {
        "weights": {"position": "0.5 mm"},
        "observer": OBSERVER,
        "limits": {"speed": "450 rad/s", "pressure": "150 bar", "stroke": "95 mm"},
    },
    "adrc": {"adrc": {"bandwidth": "30 rad/s"}},
    "sliding_mode": {"sliding_mode": {"bandwidth": "30 rad/s", "disturbance": "0.6 A"}},
}


@dataclass(frozen=True)
class Outcome:
    """The worst of a step there and back: SI units."""

    settling: float
    ratio: float
    overshoot: float
    standing: float
    current: float


def nonlinear(friction: float = 1.0, torque: float = 1.0, payload: float = 1.0) -> e.Plant:
    """The plant under the spring with factors on friction, torque constant and payload."""
    plant = e.load_plant("ehsa", settings={"load.stiffness": SPRING, "load.mass": PAYLOAD * payload})
    return plant.set(**{name: plant[name] * friction for name in FRICTION}, K_T=plant["K_T"] * torque)


def tuned(kind: str, budget: int) -> ControllerDesign:
    """The kind within BOUNDS; an MPC has the weights of the LQR, whose law it is where no limit is active."""
    model = e.three_state(e.load_plant("ehsa", model="linear", settings={"load.mass": PAYLOAD}))
    feedforward = FRICTION_CURRENT | (RIGID_BODY if kind in ("pid", "cascade") else {})
    content = {
        "schema": 1, "kind": kind, "title": kind, "sample_time": "4 ms", "current_limit": "6 A",
        "feedforward": feedforward, **STAGES, **OWN[kind],
    }  # fmt: skip
    if kind == "mpc":
        peer = tuned("lqr", budget).content
        content |= {"weights": peer["weights"], "observer": peer["observer"]}
        return design(kind, CONTROLLER_KINDS[kind], content, model)
    return design(kind, CONTROLLER_KINDS[kind], content, model, tuning=Tuning(**BOUNDS), budget=budget)


def step(law: SampledController, real: e.Plant, size: float, seed: int) -> Outcome:
    """A step to `size` and back, held for WAIT + HOLD each."""
    legs = step_and_back(law, real, size, seed=seed, hold=HOLD)
    return worst_of(
        [
            Outcome(leg.metrics["SettlingTime"], leg.ratio, leg.metrics["Overshoot"], leg.standing, leg.current)
            for leg in legs
        ]
    )


def without_friction(law: SampledController) -> SampledController:
    """The controller without friction feed-forward and deadband at rest."""
    assert law.feedforward is not None
    given = law.feedforward.model_copy(update={"coulomb": 0.0, "static": None})
    return replace(law, feedforward=given, rest=None)


def steps(law: SampledController, real: e.Plant, seeds: int) -> dict[str, dict[str, float]]:
    """Size of the step -> worst outcome over the noise seeds."""
    return {
        f"{1e3 * size:g} mm": asdict(worst_of([step(law, real, size, seed) for seed in range(seeds)])) for size in SIZES
    }


def worst_of(found: list[Outcome]) -> Outcome:
    # np.max propagates nan: a step that never settles is the worst.
    return Outcome(*(float(np.max([asdict(one)[key] for one in found])) for key in asdict(found[0])))


def deviations() -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Label -> factors: one number off, and all combinations of the three."""
    low, high = 1.0 - OFF, 1.0 + OFF
    single = {f"{name} x{f:g}": {name: f} for name in ("friction", "torque", "payload") for f in (low, high)}
    corners = {
        f"friction x{a:g}, torque x{b:g}, payload x{c:g}": {"friction": a, "torque": b, "payload": c}
        for a, b, c in product((low, high), repeat=3)
    }
    return single, corners


def measure(kind: str, seeds: int, budget: int) -> dict[str, Any]:
    """All figures of a kind, SI units."""
    made = tuned(kind, budget)
    law, real = made.controller, nonlinear()
    single, corners = ({k: asdict(step(law, nonlinear(**f), SIZES[-1], 0)) for k, f in d.items()} for d in deviations())
    keys = list(CONTROLLER_KINDS[kind].tunes)
    return {
        "keys": {key: _at(made.content, key) for key in keys if _at(made.content, key) is not None},
        "law": str(law.law),
        "loop": {name: made.loop.figure(name) for name in ("Ms", "Mt", "disk_margin", "delay_margin", "noise_gain")},
        "nominal": steps(law, real, seeds),
        "bare": steps(without_friction(law), real, seeds),
        "sine": sine_error(law, real),
        "sine_bare": sine_error(without_friction(law), real),
        "single": single,
        "corners": corners,
    }


def _at(content: Mapping[str, Any], key: str) -> Any:
    table, _, name = key.partition(".")
    return content.get(table, {}).get(name)


def _worst(cases: Mapping[str, Mapping[str, float]], key: str) -> tuple[float, str]:
    label = max(cases, key=lambda k: np.inf if np.isnan(cases[k][key]) else cases[k][key])
    return cases[label][key], label


def print_tables(everything: Mapping[str, Mapping[str, Any]]) -> None:
    heads = " | ".join(f"{1e3 * size:g} mm" for size in SIZES)
    for group, tracking in (("nominal", "sine"), ("bare", "sine_bare")):
        print("\nwith friction feed-forward and deadband" if group == "nominal" else "\nwithout them")
        print(f"\n| kind | {heads} | current | sine | Ms, disk margin, delay margin |")
        print("|---|" + "---|" * (len(SIZES) + 3))
        for kind, found in everything.items():
            cells = [f"{one['ratio']:.2f}x, {1e6 * one['standing']:.0f} um" for one in found[group].values()]
            loop, last = found["loop"], list(found[group].values())[-1]
            print(
                f"| `{kind}` | {' | '.join(cells)} | {last['current']:.2f} A | {1e6 * found[tracking]:.0f} um | "
                f"{loop['Ms']:.2f}, {loop['disk_margin']:.2f}, {1e3 * loop['delay_margin']:.1f} ms |"
            )
    print("\n| kind | one 20 % off: settling | error | all 20 % off: settling | at | error |")
    print("|---|---|---|---|---|---|")
    for kind, found in everything.items():
        one, both = _worst(found["single"], "ratio"), _worst(found["corners"], "ratio")
        standing = [1e6 * _worst(found[group], "standing")[0] for group in ("single", "corners")]
        print(
            f"| `{kind}` | {one[0]:.2f}x at {one[1]} | {standing[0]:.0f} um | {both[0]:.2f}x | {both[1]} | "
            f"{standing[1]:.0f} um |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", default=list(OWN))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--budget", type=int, default=400)
    parser.add_argument("--out", type=Path, default=Path("controllers.json"))
    asked = parser.parse_args()
    print(f"bounds {BOUNDS}; least ITAE of a load step; {asked.budget} evaluations each; {asked.seeds} noise seeds")
    print(f"spring {1e-3 * SPRING:g} kN/m, payload {PAYLOAD:g} kg; deviations of {100 * OFF:g} %")
    print(f"stages {STAGES}; feed-forward {FRICTION_CURRENT}, for pid and cascade also {RIGID_BODY}")
    everything: dict[str, Any] = {}
    for kind in asked.kinds:
        everything[kind] = measure(kind, asked.seeds, asked.budget)
        print(f"{kind}: {', '.join(f'{k} = {v}' for k, v in everything[kind]['keys'].items())}", flush=True)
        asked.out.write_text(json.dumps(everything, indent=1) + "\n")
    print_tables(everything)


if __name__ == "__main__":
    main()
