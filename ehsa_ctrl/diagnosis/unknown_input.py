"""Unknown inputs: what each balance of a believed plant lacks to fit a log, and what it does when it is put in.

A balance is a sum that vanishes in the true plant. Evaluated with measured signals it leaves a torque, two flows and
a force that the believed plant does not know of: the unknown inputs of the discrepancy literature (put into the
equations, not onto the outputs). Over one sample the rate of a state is its difference, so that noise is not
differentiated for good: put back into a simulation, it comes out as the noise that it was.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from ..core.log import Log
from ..identification.drives import undo_sensor
from ..plant.arrays import array_evaluator, needs
from ..plant.plant import Plant
from ..simulation.compiled import engine
from ..simulation.engine import initial_carry, initial_modes, run_open_loop, simulate_batch

#: Unknown inputs by balance; a torque and flows that help, a force that resists extension.
INPUTS = ("torque", "flow_1", "flow_2", "force")
#: Their units.
UNITS = {"torque": "N m", "flow_1": "m3/s", "flow_2": "m3/s", "force": "N"}
#: Residual of each, the last in the system's balances, its sign, the contact that has to slide for it to be told.
_RESIDUALS = {
    "torque": (("torque__torque",), -1.0, "shaft"),
    "flow_1": (("flow__flow_1",), -1.0, None),
    "flow_2": (("flow__flow_2",), -1.0, None),
    "force": (
        ("force__carriage_force", "force, nominal load__nominal_load_force", "force__take_off_force"),
        1.0,
        "rod",
    ),
    "load": (("load__load_force",), 1.0, None),
}
#: Flows come in steps of at most this length [s]: what half a hydraulic period brings at once opens valves.
KICK = 5e-3
#: Samples of the cubics that give a slope and a direction, and how far from zero a direction is sure.
SLOPE, DIRECTION, SURE = 7, 11, 4.0


@dataclass(frozen=True)
class Signals:
    """A log as the balances see it: sensors undone, speeds and rates as slopes of short cubics.

    values: name -> (N,) states, `..._rate` of each, directions, current. slides: contact -> (N,) bool.
    """

    values: Mapping[str, np.ndarray]
    slides: Mapping[str, np.ndarray]
    sample_time: float

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]


def signals_of(
    plant: Plant,
    log: Log,
    current: np.ndarray,
    noise: Mapping[str, float],
    start: np.ndarray | None = None,
    outside: np.ndarray | None = None,
) -> Signals:
    """States, rates and directions that the log tells, driven by `current` (N,), which in a system other than the EHSA
    is its first input, and by `outside` (N,), its second one, zero by default; what the log does not tell is absent.

    States that an effect or a friction law of the believed plant adds have no sensor: a free run from `start` gives
    them.
    """
    system, dt = plant.structure.system, log.sample_time
    first_input, *others = system.inputs
    acting = np.zeros(len(log)) if outside is None else outside
    values = {first_input: current, **dict.fromkeys(others, acting), "time": log.time}
    states = plant.structure.equations.states
    inner = [state.name for state in states if state not in system.states]
    if inner:
        first = None if start is None else start[None, :]
        batch = simulate_batch(
            plant, plant.vector[None, :], current, force=outside, hold=system.hold, start=first, sample_time=dt, jobs=1
        )
        values |= {name: batch.states[0, :, plant.structure.equations.index(name)] for name in inner}
    sds = {}
    for channel, state in system.outputs.items():
        if channel in log.channels:
            values[state] = undo_sensor(plant, log, channel)
            values[f"{state}_rate"] = _slope(values[state], dt, 1)
            sds[state] = noise.get(channel, 0.0)
    values |= {f"{c}_measured": undo_sensor(plant, log, c) for c in system.measured if c in log.channels}
    if "x" in values:
        values["v"], values["v_rate"] = values["x_rate"], _slope(values["x"], dt, 2)
    elif system.prescribed:
        values["x"] = values.get("position_measured", np.cumsum(values["v"]) * dt)
        values["v_rate"] = _slope(values["v"], dt, 1)
        sds["v"] = noise.get(system.drives["v"], 0.0)
    slides = {}
    for contact in system.all_contacts:
        if contact.velocity not in values:
            continue
        if contact.velocity in sds:
            seen, sd = savgol_filter(values[contact.velocity], DIRECTION, 3), 0.45 * sds[contact.velocity]
        else:
            seen, sd = savgol_filter(values["x"], DIRECTION, 3, deriv=1, delta=dt), 0.3 * sds["x"] / dt
        values[contact.direction] = np.sign(seen)
        slides[contact.name] = np.abs(seen) > SURE * sd
    return Signals(values, slides, dt)


def _slope(values: np.ndarray, dt: float, order: int) -> np.ndarray:
    return np.asarray(savgol_filter(values, SLOPE, 3, deriv=order, delta=dt))


@dataclass(frozen=True)
class Unknown:
    """Unknown inputs of a plant on a log.

    values: balance -> (N - 1,) mean over each sample, NaN where a contact sticks or its direction is not sure.
    load: (N - 1,) what the load cell shows beyond the believed load, None without one: the part of the force that is
    the load's.
    softness: flow -> (N - 1,) V / beta [m3/Pa], what turns it into a rate of pressure.
    """

    values: Mapping[str, np.ndarray]
    softness: Mapping[str, np.ndarray]
    load: np.ndarray | None = None


def unknown_inputs(plant: Plant, signals: Signals) -> Unknown:
    """Evaluate the balances sample by sample; those that need what was not measured are absent."""
    equations, dt, measured = plant.structure.equations, signals.sample_time, signals.values
    wanted = {}
    for name, (residuals, _, _) in _RESIDUALS.items():
        for residual in [one for one in residuals if any(one in names for names in equations.residuals)]:
            asked = needs(equations, residual) - set(plant.parameters)
            if all(one.removesuffix("_rate") in measured for one in asked):
                wanted[name] = residual
    drive = plant.structure.system.inputs[0]
    chambers = ("V_1", "V_2") if plant.structure.chambers is not None and wanted else ()
    extra = [one for one in chambers if needs(equations, one) - set(plant.parameters) <= set(measured)]
    ends = []
    rates = {f"{s.name}_rate": np.diff(measured[s.name]) / dt for s in equations.states if s.name in measured}
    for part in (slice(None, -1), slice(1, None)):
        known = {name: values[part] for name, values in measured.items()}
        if plant.structure.system.hold == "zero_order":
            known[drive] = measured[drive][:-1]
        known |= rates
        ends.append(array_evaluator(equations, (*wanted.values(), *extra))({**plant.values, **known}))
    size = measured["time"].size - 1
    values = {}
    for name, residual in wanted.items():
        _, sign, contact = _RESIDUALS[name]
        value = sign * 0.5 * (ends[0][residual] + ends[1][residual]) * np.ones(size)
        if contact is not None:
            at = next(one for one in plant.structure.system.all_contacts if one.name == contact)
            if plant.structure.law(at).sticks:
                sure, direction = signals.slides[contact], measured[at.direction]
                value[~(sure[:-1] & sure[1:] & (direction[:-1] == direction[1:]))] = np.nan
        values[name] = value
    softness = {
        f"flow_{name[-1]}": 0.5 * (ends[0][name] + ends[1][name]) / plant["beta"] * np.ones(size) for name in extra
    }
    load = values.pop("load", None)
    return Unknown(values, softness, load)


def filled(values: np.ndarray) -> np.ndarray:
    """NaN bridged by straight lines, the ends held; zero where nothing is known."""
    known = np.isfinite(values)
    index = np.arange(values.size)
    return np.interp(index, index[known], values[known]) if known.any() else np.zeros_like(values)


def smooth(values: np.ndarray, samples: int) -> np.ndarray:
    """Means (N,) over a bump of so many samples, NaN left out of them; what is NaN stays so."""
    bump = np.sin(np.pi * (np.arange(samples) + 0.5) / samples) ** 2
    known = np.isfinite(values)
    weight = np.convolve(known.astype(float), bump, "same")
    total = np.convolve(np.where(known, values, 0.0), bump, "same")
    return np.where(known, total / np.where(weight > 0.0, weight, 1.0), np.nan)


Injection = Mapping[str, np.ndarray]


def run_with(
    plant: Plant,
    current: np.ndarray,
    start: np.ndarray,
    sample_time: float,
    injections: Sequence[Injection],
    softness: Mapping[str, np.ndarray],
    tolerance: float = 1e-5,
    outside: np.ndarray | None = None,
) -> list[dict[str, np.ndarray]]:
    """Simulate the plant with inputs put in: channel -> (N,) of each injection; nan from where a run stopped.

    An injection is balance -> (N - 1,) mean over each sample. A torque acts as a current, a force as F_D, from the
    middle of a sample on where inputs are joined by lines; flows act as half of what they bring in a step at each end
    of it, the engine knowing of none; a sample is a step, or several of at most KICK. outside: (N,) of the second
    input, which a force comes on top of; zero by default.
    """
    groups: dict[tuple[int, int], list[int]] = {}
    for i, one in enumerate(injections):
        groups.setdefault((id(one.get("torque")), id(one.get("force"))), []).append(i)
    equations, outputs = plant.structure.equations, plant.structure.system.outputs
    states = np.full((len(injections), current.size, start.size), np.nan)
    for members in groups.values():
        one = injections[members[0]]
        drive, force = current.copy(), np.zeros(current.size) if outside is None else outside.copy()
        if "torque" in one:
            drive[:-1] += one["torque"] / plant["K_T"]
        if "force" in one:
            force[:-1] += one["force"]
        wet = [i for i in members if "flow_1" in injections[i] or "flow_2" in injections[i]]
        dry = [i for i in members if i not in wet]
        if dry:
            batch = simulate_batch(
                plant, plant.vector[None, :], drive, force=force, hold=plant.structure.system.hold,
                start=start[None, :], sample_time=sample_time, tolerance=tolerance, jobs=1,
            )  # fmt: skip
            states[dry] = batch.states[0]
        if wet:
            halves = np.zeros((current.size, len(wet), start.size))
            for column, i in enumerate(wet):
                for chamber in "12":
                    if f"flow_{chamber}" in injections[i]:
                        half = 0.5 * sample_time * injections[i][f"flow_{chamber}"] / softness[f"flow_{chamber}"]
                        halves[:-1, column, equations.index(f"P_{chamber}")] = half
            states[wet] = _kicked(plant, drive, force, start, sample_time, halves, tolerance)
    return [{channel: run[:, equations.index(s)] for channel, s in outputs.items()} for run in states]


def _kicked(
    plant: Plant,
    current: np.ndarray,
    force: np.ndarray,
    start: np.ndarray,
    dt: float,
    halves: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Runs (runs, N, n) whose states are moved by `halves` (N, runs, n) in the halves of each sample."""
    kernel, lines = engine(plant.structure), plant.structure.system.hold == "first_order"
    samples, runs, n = halves.shape
    steps = max(int(np.ceil(dt / KICK - 1e-9)), 1)
    fine = np.arange((samples - 1) * steps + 1) / steps
    driven, pushed = (np.interp(fine if lines else fine // 1, np.arange(samples), u) for u in (current, force))
    halves = halves / steps
    rows, y = np.tile(plant.vector, (runs, 1)), np.tile(start, (runs, 1))
    modes, carry = initial_modes(plant, y), initial_carry(plant, runs, dt / steps)
    out = np.full((samples, runs, n), np.nan)
    states, cells = np.empty((runs, 2, n)), np.empty((runs, 2))
    chosen, extremes = np.zeros((runs, 2, modes.shape[1]), dtype=np.int8), np.stack([y, y], axis=1)
    status = np.zeros(runs, dtype=np.int64)
    out[0] = y
    kicks = halves.copy()
    kicks[1:] += halves[:-1]
    for k in range(samples - 1):
        for step in range(steps):
            y += 2.0 * halves[k] if step else kicks[k]
            # What the engine remembers of the rates at the step's end does not hold after a kick.
            carry[:, 1] = np.nan
            at = slice(k * steps + step, k * steps + step + 2)
            run_open_loop(
                kernel, rows, y, modes, carry, driven[at], pushed[at], lines, dt / steps, tolerance, states, chosen,
                cells, extremes, status=status,
            )  # fmt: skip
        out[k + 1] = y
        if not k % 64 and status.any():
            break
    out[1:] += halves[:-1]
    out[:, status != 0] = np.nan
    return out.swapaxes(0, 1)
