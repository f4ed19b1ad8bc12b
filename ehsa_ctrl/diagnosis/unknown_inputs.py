"""Unknown inputs: the residuals of the nominal plant's balances on a log.

A balance is a sum that is zero in the true plant. Evaluated with measured signals, it leaves a torque, two flows and a
force that the nominal plant lacks. These unknown inputs enter the equations, not the outputs. The rate of a state over
a sample is the difference quotient: fed back into a simulation, it integrates to the measured signal with its noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from ..core.log import Log
from ..identification.logged_inputs import undo_sensor
from ..plant.arrays import array_evaluator, needs
from ..plant.plant import Plant
from ..plant.system import Balance, System
from ..simulation.engine import simulate_batch

#: Unknown inputs and their units. A positive torque or flow drives the motion, a positive force resists extension.
UNITS = {"torque": "N m", "flow_1": "m3/s", "flow_2": "m3/s", "force": "N"}
#: Samples of the local cubic fits (Savitzky-Golay) for rates and for the direction of motion. Engineering judgement:
#: 28 and 44 ms at 250 Hz.
SLOPE, DIRECTION = 7, 11
#: A contact slides with certainty if its speed exceeds this many standard deviations of the noise.
CERTAIN = 4.0
#: Noise gain of the direction's fit, for the value (exactly 0.46) and for the slope times the sample time (0.25).
VALUE_NOISE, SLOPE_NOISE = 0.45, 0.3


@dataclass(frozen=True)
class BalanceSignals:
    """The signals that the balances need, from a log with its sensor models inverted.

    values: name -> (N,) states, their rates `NAME_rate`, directions of motion, inputs. slides: contact -> (N,) whether
    it slides with certainty.
    """

    values: Mapping[str, np.ndarray]
    slides: Mapping[str, np.ndarray]
    sample_time: float

    def __contains__(self, name: str) -> bool:
        return name in self.values

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]


def balance_signals(
    plant: Plant,
    log: Log,
    current: np.ndarray,
    noise: Mapping[str, float],
    start: np.ndarray | None = None,
    second_input: np.ndarray | None = None,
) -> BalanceSignals:
    """States, rates and directions of motion from a log; those that it does not show are absent.

    current, second_input: (N,) inputs of the system; the second is zero by default. noise: channel -> standard
    deviation. start: (n,) initial state of a free run, which gives the states of effects and friction laws, because
    these have no sensor.
    """
    system, dt = plant.structure.system, log.sample_time
    first_input, *others = system.inputs
    acting = np.zeros(len(log)) if second_input is None else second_input
    values = {first_input: current, **dict.fromkeys(others, acting), "time": log.time}
    states = plant.structure.equations.states
    inner = [state.name for state in states if state not in system.states]
    if inner:
        first = None if start is None else start[None, :]
        batch = simulate_batch(
            plant,
            plant.vector[None, :],
            current,
            force=second_input,
            hold=system.hold,
            start=first,
            sample_time=dt,
            jobs=1,
        )
        values |= {name: batch.states[0, :, plant.structure.equations.index(name)] for name in inner}
    sds = {}
    for channel, state in system.outputs.items():
        if channel in log.channels:
            values[state] = undo_sensor(plant, log, channel)
            values[f"{state}_rate"] = _slope(values[state], dt, 1)
            sds[state] = noise.get(channel, 0.0)
    values |= {f"{c}_measured": undo_sensor(plant, log, c) for c in system.measured if c in log.channels}
    slides = {}
    for contact in system.all_contacts:
        speed, position = contact.velocity, contact.position
        if position in values:
            values[speed], values[f"{speed}_rate"] = values[f"{position}_rate"], _slope(values[position], dt, 2)
        elif contact in system.prescribed:
            if position:
                values[position] = values.get(f"{contact.position_channel}_measured", np.cumsum(values[speed]) * dt)
            values[f"{speed}_rate"] = _slope(values[speed], dt, 1)
            sds[speed] = noise.get(system.drives[speed], 0.0)
        if speed not in values:
            continue
        if speed in sds:
            smoothed, sd = savgol_filter(values[speed], DIRECTION, 3), VALUE_NOISE * sds[speed]
        else:
            smoothed = savgol_filter(values[position], DIRECTION, 3, deriv=1, delta=dt)
            sd = SLOPE_NOISE * sds[position] / dt
        values[contact.direction] = np.sign(smoothed)
        slides[contact.name] = np.abs(smoothed) > CERTAIN * sd
    return BalanceSignals(values, slides, dt)


def _slope(values: np.ndarray, dt: float, order: int) -> np.ndarray:
    return np.asarray(savgol_filter(values, SLOPE, 3, deriv=order, delta=dt))


@dataclass(frozen=True)
class UnknownInputs:
    """Unknown inputs of a plant on a log.

    values: unknown input -> (N - 1,) mean over each sample; NaN where a contact sticks or its direction is uncertain.
    load: (N - 1,) measured minus nominal load force [N], None without a load cell: the part of the unknown force that
    is due to the load. capacity: unknown input -> (N - 1,) divisor by which it enters a simulation, see `Entry`: V /
    beta [m3/Pa] for a flow, K_T [N m/A] for a torque; absent for 1.
    """

    values: Mapping[str, np.ndarray]
    capacity: Mapping[str, np.ndarray]
    load: np.ndarray | None = None


def unknown_inputs(plant: Plant, signals: BalanceSignals) -> UnknownInputs:
    """Evaluate the residuals of the balances; those that need a signal that was not measured are absent."""
    equations, system = plant.structure.equations, plant.structure.system
    dt, measured = signals.sample_time, signals.values
    wanted: dict[str, tuple[str, Balance]] = {}
    for balance, residuals in zip(system.balances, equations.residuals, strict=True):
        for name, residual in zip(balance.unknown_inputs, residuals, strict=True):
            asked = needs(equations, residual) - set(plant.parameters)
            # With a load cell there are two force balances; the last one, with the nominal load, counts.
            if name in (*UNITS, "load") and all(one.removesuffix("_rate") in measured for one in asked):
                wanted[name] = residual, balance
    drive = system.inputs[0]
    entries = {name: entry for name, entry in system.entries.items() if name in wanted and entry.capacity}
    extra = [entry.capacity[0] for entry in entries.values() if entry.capacity[0] not in plant.parameters]
    ends = []
    rates = {f"{s.name}_rate": np.diff(measured[s.name]) / dt for s in equations.states if s.name in measured}
    for part in (slice(None, -1), slice(1, None)):
        known = {name: values[part] for name, values in measured.items()}
        if system.hold == "zero_order":
            known[drive] = measured[drive][:-1]
        known |= rates
        ends.append(
            array_evaluator(equations, (*(residual for residual, _ in wanted.values()), *extra))(
                {**plant.values, **known}
            )
        )
    size = measured["time"].size - 1
    values = {}
    for name, (residual, balance) in wanted.items():
        sign = 1.0 if name in ("force", "load") else -1.0
        value = sign * 0.5 * (ends[0][residual] + ends[1][residual]) * np.ones(size)
        for contact in (one for one in system.all_contacts if one.name in balance.contacts):
            if plant.structure.law(contact).sticks:
                sure, direction = signals.slides[contact.name], measured[contact.direction]
                value[~(sure[:-1] & sure[1:] & (direction[:-1] == direction[1:]))] = np.nan
        values[name] = value
    capacity = {}
    for name, entry in entries.items():
        first, *rest = entry.capacity
        level = plant[first] if first in plant.parameters else 0.5 * (ends[0][first] + ends[1][first])
        capacity[name] = (level / plant[rest[0]] if rest else level) * np.ones(size)
    load = values.pop("load", None)
    return UnknownInputs(values, capacity, load)


def declared_unknown_inputs(system: System) -> tuple[str, ...]:
    """The unknown inputs of a system's balances, in the order of UNITS."""
    declared = {name for balance in system.balances for name in balance.unknown_inputs}
    return tuple(name for name in UNITS if name in declared)


def fill_nan(values: np.ndarray) -> np.ndarray:
    """Replace NaN in (N,) by linear interpolation, constant at the ends; all zero if every value is NaN."""
    known = np.isfinite(values)
    index = np.arange(values.size)
    return np.interp(index, index[known], values[known]) if known.any() else np.zeros_like(values)


def smooth(values: np.ndarray, samples: int) -> np.ndarray:
    """Moving average (N,) with a squared-sine window of `samples`; NaN is left out and stays NaN."""
    window = np.sin(np.pi * (np.arange(samples) + 0.5) / samples) ** 2
    known = np.isfinite(values)
    weight = np.convolve(known.astype(float), window, "same")
    total = np.convolve(np.where(known, values, 0.0), window, "same")
    return np.where(known, total / np.where(weight > 0.0, weight, 1.0), np.nan)
