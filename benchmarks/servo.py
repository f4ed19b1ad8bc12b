"""Friction models of a servo, identified on published records and replayed in closed loop on others.

    python benchmarks/servo.py FOLDER

FOLDER holds records of the XL330 on its pendulum bench as CSV, named kpGAIN_TRAJECTORY.csv, with the columns that
plants/xl330_pendulum.toml maps. Each model is identified on the records of one gain and tested on the others, on three
trajectories of every gain and tested on the fourth, and on all. The number is the mean absolute
error of the angle over the records, mrad.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import ehsa_ctrl
from ehsa_ctrl import Log, Plant

#: Sampling rate of the records, about [Hz].
RATE = 200.0


@dataclass(frozen=True)
class FrictionModel:
    """A structure of the servo. start: values of what the nominal plant lacks; all are estimated."""

    name: str
    law: str
    effects: tuple[str, ...]
    start: dict[str, float]

    def of(self, plant: Plant) -> Plant:
        structure = replace(plant.structure, shaft_friction=self.law, effects=self.effects)
        own = {name: value for name, value in self.start.items() if name not in plant.parameters}
        known = {name: value for name, value in self.start.items() if name in plant.parameters}
        return plant.with_structure(structure, **own).set(**known)


LOAD, SUPPLY, STRIBECK, SATURATION = {"kappa": 0.2}, {"R_S": 0.8}, {"C_FM": 0.005, "tau_FM": 0.3}, {"k_sat": 0.3}
EFFECTS = ("load_dependent_friction",)
MODELS = (
    FrictionModel("Coulomb, viscous", "coulomb", (), {}),
    FrictionModel("Stribeck", "stribeck", (), STRIBECK),
    FrictionModel("supply", "coulomb", (), SUPPLY),
    FrictionModel("load", "coulomb", EFFECTS, LOAD),
    FrictionModel("load, supply", "coulomb", EFFECTS, LOAD | SUPPLY),
    FrictionModel("load, saturation", "coulomb", (*EFFECTS, "torque_saturation"), LOAD | SATURATION),
    FrictionModel("load, supply, Stribeck", "stribeck", EFFECTS, LOAD | SUPPLY | STRIBECK),
    FrictionModel("load, supply, saturation", "coulomb", (*EFFECTS, "torque_saturation"), LOAD | SUPPLY | SATURATION),
)


def read(folder: Path, plant: Plant) -> list[Log]:
    """The records, each with its gain as setting, resampled to RATE."""
    logs = []
    for path in sorted(folder.glob("kp*_*.csv")):
        log = ehsa_ctrl.read_plant_log(path, plant, uniform=False)
        log, _ = ehsa_ctrl.Preparation(resample=RATE).apply(log, plant)
        logs.append(replace(log, settings={"kp": float(path.stem.partition("_")[0][2:])}))
    return logs


def error(plant: Plant, logs: Sequence[Log]) -> float:
    """Mean absolute error of the angle, mean over logs [mrad]."""
    runs = [ehsa_ctrl.replay(plant, log) for log in logs]
    return 1e3 * float(np.mean([np.mean(np.abs(run.simulated["angle"] - run.log["angle"])) for run in runs]))


def fit(model: FrictionModel, plant: Plant, logs: Sequence[Log]) -> Plant:
    return ehsa_ctrl.identify(model.of(plant), list(logs), free=tuple(model.start), starts=4).plant


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    asked = parser.parse_args()
    plant = ehsa_ctrl.load_plant("xl330_pendulum")
    logs = read(asked.folder, plant)
    gains = sorted({log.settings["kp"] for log in logs})
    kinds = sorted({log.path.stem.partition("_")[2] for log in logs if log.path})
    heads = [f"kp {kp:g} to others" for kp in gains] + ["other trajectories", "all, on all"]
    single = ", ".join(f"{error(plant, [log]):.0f}" for log in logs)
    print(f"published values: {single}; mean {error(plant, logs):.1f}")
    print("| model | " + " | ".join(heads) + " |\n|" + "---|" * (len(heads) + 1))
    for model in MODELS:
        cells = []
        for kp in gains:
            fitted = fit(model, plant, [log for log in logs if log.settings["kp"] == kp])
            cells.append(error(fitted, [log for log in logs if log.settings["kp"] != kp]))
        folds = []
        for kind in kinds:
            test = [log for log in logs if log.path and log.path.stem.endswith(f"_{kind}")]
            folds.append(error(fit(model, plant, [log for log in logs if all(log is not one for one in test)]), test))
        best = fit(model, plant, logs)
        cells += [float(np.mean(folds)), error(best, logs)]
        print(f"| {model.name} | " + " | ".join(f"{cell:.1f}" for cell in cells) + " |", flush=True)
        values = {name: best[name] for name in (*plant.free, *model.start)}
        print("  " + ", ".join(f"{name} {value:.4g}" for name, value in values.items()), flush=True)


if __name__ == "__main__":
    main()
