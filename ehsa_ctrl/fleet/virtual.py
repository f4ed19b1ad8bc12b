"""A virtual fleet: rigs whose parameters differ, logs of several days, and some rigs that change on one of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.files import read_json, write_text
from ..core.log import Log
from ..core.parallel import as_completed, worker_count
from ..plant.plant import Plant
from ..simulation.bench import record
from ..simulation.excitation import excitation

#: Spread of the nominal parameters between rigs, relative standard deviations: least and most.
SPREAD = (0.03, 0.05)
#: Days between the logs of a rig, and the day of the first.
INTERVAL, FIRST_DAY = 7, datetime(2026, 1, 5, tzinfo=UTC)
#: Excitations of the logs with the range of their amplitudes [A].
INPUTS = {"multisine": (3.0, 4.5), "noise": (3.5, 5.0)}
#: Folder of the logs and file of the truth beside it.
LOGS, TRUTH = "logs", "truth.json"
#: Smallest and largest duration of a log [s].
DURATION = (8.0, 9.0)


@dataclass(frozen=True)
class VirtualChange:
    """A change of a rig: what a diagnosis names it, and what it does to the plant.

    factors: parameter -> factor on its value. effect, values: an effect of the catalogue with its parameters.
    sensor: (channel, setting, value).
    """

    cause: str
    factors: Mapping[str, float] = field(default_factory=dict)
    effect: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    sensor: tuple[str, str, float] | None = None

    def applied(self, plant: Plant) -> Plant:
        """The plant after the change."""
        plant = plant.set(**{name: factor * plant[name] for name, factor in self.factors.items()})
        if self.effect:
            plant = plant.with_effects(self.effect, **self.values)
        elif self.values:
            plant = plant.set(**self.values)
        if self.sensor is not None:
            channel, setting, value = self.sensor
            new: dict[str, Any] = {setting: value}
            plant = replace(plant, sensors={**plant.sensors, channel: replace(plant.sensors[channel], **new)})
        return plant


#: What may change, with sizes that a diagnosis of one log finds too.
CHANGES = (
    VirtualChange("internal_leakage", {"K_L": 10.0}),
    VirtualChange("torque_constant", {"K_T": 0.92}),
    VirtualChange("motor_friction", {"A_FM": 1.4, "C_FM": 1.4}),
    VirtualChange("rod_friction", {"A_FR": 2.0, "C_FR": 2.0}),
    VirtualChange("motor_viscous_friction", {"B_FM": 1.5}),
    VirtualChange("rod_viscous_friction", {"B_FR": 1.5}),
    VirtualChange("rotor_inertia", {"J_M": 1.15}),
    VirtualChange("entrained_air", effect="entrained_air", values={"air_fraction": 0.02}),
    VirtualChange("external_leakage", effect="external_leakage", values={"K_e": 2e-13}),
    VirtualChange("current_offset", effect="current_offset", values={"I_0": 0.1}),
    VirtualChange("drive_delay", effect="drive_delay", values={"T_d": 4e-3}),
    VirtualChange("drive_lag", effect="drive_lag", values={"tau_I": 4e-3}),
    VirtualChange("torque_saturation", effect="torque_saturation", values={"k_sat": 0.1}),
    VirtualChange("asymmetric_friction", effect="asymmetric_friction", values={"a_FR": 0.4}),
    VirtualChange("pump_displacement", {"D": 0.96}),
    VirtualChange("load_spring", values={"K_S": 2e4}),
    VirtualChange("sensor_scale (speed)", sensor=("speed", "scale", 1.04)),
    VirtualChange("sensor_scale (p1)", sensor=("p1", "scale", 1.08)),
    VirtualChange("sensor_bias (p2)", sensor=("p2", "bias", 1.5e5)),
    VirtualChange("sensor_delay (position)", sensor=("position", "delay", 8e-3)),
    VirtualChange("sensor_filter (p1)", sensor=("p1", "filter", 8e-3)),
)


@dataclass(frozen=True)
class VirtualRig:
    """A rig of a virtual fleet.

    plant: as delivered. change: None for a rig that does not change. first: number of the first log after the change.
    """

    name: str
    plant: Plant
    number: int
    change: VirtualChange | None = None
    first: int = 0

    def day(self, log: int) -> datetime:
        """Day of a log."""
        return FIRST_DAY + timedelta(days=INTERVAL * log + self.number % INTERVAL)


def virtual_rigs(plant: Plant, rigs: int, logs: int, changed: int, seed: int) -> list[VirtualRig]:
    """Rigs with parameters drawn around the nominal plant, of which `changed` change between two of their logs.

    Each cause comes once before one comes twice.

    Raises InputError for numbers that make no fleet.
    """
    if rigs < 2 or logs < 2 or not 0 <= changed <= rigs or seed < 0:
        raise InputError(
            f"a virtual fleet of {rigs} rigs with {logs} logs each, {changed} of them changed, seed {seed}: expected "
            "at least two rigs and two logs, no more changed rigs than rigs, and a seed of 0 or more"
        )
    kinds = [k for k in plant.structure.equations.parameters if k.prior is not None and k.searched and plant[k.name]]
    random = np.random.default_rng([seed, 1])
    spread = dict(zip((k.name for k in kinds), random.uniform(*SPREAD, len(kinds)).tolist(), strict=True))
    which = set(random.choice(rigs, changed, replace=False).tolist())
    order = [int(i) for _ in range(changed // len(CHANGES) + 1) for i in random.permutation(len(CHANGES))]
    digits = len(str(rigs))
    found = []
    for number in range(rigs):
        own = {
            name: plant[name] * (1.0 + sd * float(np.clip(random.standard_normal(), -3.0, 3.0)))
            for name, sd in spread.items()
        }
        change, first = None, 0
        if number in which:
            change, first = CHANGES[order.pop()], int(random.integers(1, logs))
        found.append(VirtualRig(f"rig_{number + 1:0{digits}d}", plant.set(**own), number, change, first))
    return found


def virtual_log(rig: VirtualRig, log: int, seed: int) -> Log:
    """Log number `log` of a rig: sensor noise, excitation, amplitude and duration are its own."""
    random = np.random.default_rng([seed, 2, rig.number, log])
    name = str(random.choice(sorted(INPUTS)))
    amplitude, duration = float(random.uniform(*INPUTS[name])), float(random.uniform(*DURATION))
    plant = rig.plant
    if rig.change is not None and log >= rig.first:
        plant = rig.change.applied(plant)
    own = int(random.integers(2**31))
    time, current = excitation(name, amplitude=amplitude, duration=duration, sample_time=plant.sample_time, seed=own)
    found, _ = record(plant, time, current, seed=own, centre=True)
    return found


def write_virtual_fleet(
    plant: Plant,
    folder: str | Path,
    *,
    rigs: int = 200,
    logs: int = 5,
    changed: int = 12,
    seed: int = 0,
    jobs: int | None = None,
    watch: Callable[[str, int, int], None] | None = None,
) -> dict[str, dict[str, str]]:
    """Write the logs of a virtual fleet to FOLDER/logs/RIG/DATE.parquet, and its truth to FOLDER/truth.json.

    Logs that exist are kept, so that an interrupted call continues.

    Returns rig -> {"cause", "since"} of the changed rigs.

    Raises InputError as `virtual_rigs`, for a folder with another virtual fleet, and if it can't be written.
    """
    folder = Path(folder)
    settings = {"plant": plant.name, "rigs": rigs, "logs": logs, "changed": changed, "seed": seed}
    fleet = virtual_rigs(plant, rigs, logs, changed, seed)
    truth = {
        rig.name: {"cause": rig.change.cause, "since": rig.day(rig.first).isoformat()}
        for rig in fleet if rig.change is not None
    }  # fmt: skip
    if (folder / TRUTH).exists():
        known = read_json(folder / TRUTH)
        if not isinstance(known, dict) or known.get("settings") != settings:
            raise InputError(f"{folder / TRUTH}: is the truth of another virtual fleet; give another folder")
    else:
        write_text(folder / TRUTH, json.dumps({"settings": settings, "changed": truth}, indent=1) + "\n")
    todo = []
    for rig in fleet:
        for number in range(logs):
            path = folder / LOGS / rig.name / f"{rig.day(number):%Y-%m-%d}.parquet"
            if not path.exists():
                todo.append((rig, number, path))
    done, total = rigs * logs - len(todo), rigs * logs
    count = min(worker_count(jobs), max(len(todo), 1))
    with closing(as_completed(partial(_write, seed), todo, count=count)) as results:
        for _ in results:
            done += 1
            if watch is not None:
                watch("simulated logs", done, total)
    return truth


def _write(seed: int, job: tuple[VirtualRig, int, Path]) -> None:
    rig, number, path = job
    virtual_log(rig, number, seed).write(path)
