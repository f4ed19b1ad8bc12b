"""What a law may remember: the running time, an angle, a lag, a hysteresis, a resonance.

A memory is one or two states of an effect. Their rates are linear in the states, so that their course along a log is
exact for signals that are held over each sample. What only adds up, as an angle, takes them as lines between samples.

Sources: P. R. Dahl, "A solid friction model", The Aerospace Corporation, TOR-0158(3107-18)-1, 1968 (hysteresis over the
travelled distance).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import expm

from ...core.expression import Expression
from ...core.linear_recursion import linear_recursion

#: Time constants that are tried: for what follows within a motion [s], and for what takes a log, as shares of its
#: length. Engineering judgement, as are the other grids.
LAGS, SLOW_SHARES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0), (0.06, 0.15, 0.4, 1.0)
#: Time constants of an acceleration [s], and what it is called in results.
QUICK, ACCELERATION = (0.01, 0.03), "acceleration"
#: Distances of a hysteresis, as shares of the range of the position.
SLIPS = (0.005, 0.02, 0.08)
#: Natural frequencies [rad/s] and damping ratio of a resonance.
RESONANCES, DAMPING = (30.0, 100.0, 300.0), 0.2
#: Waves over the shaft angle: periods per turn.
ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0)

#: Local name of a state in terms and rates; a second one has the rate of the first.
STATE, RATE = "memory", "memory_rate"
#: What goes towards an end value with the running time; long before its time constant tau it is STATE / tau.
TOWARDS_END = f"(1 - exp(-{STATE} / tau))"


@dataclass(frozen=True)
class Memory:
    """The states of a term. rates: local name of a state -> expression of its rate. units, scales: of the states."""

    rates: Mapping[str, str]
    units: Mapping[str, str]
    scales: Mapping[str, float] = field(hash=False)

    def course(
        self,
        known: Mapping[str, np.ndarray],
        shapes: Mapping[str, float],
        sample_time: float,
        begins: Sequence[int],
        *,
        mean: bool = False,
    ) -> dict[str, np.ndarray]:
        """State -> (N - 1,) along the logs, from zero at the sample where each begins.

        known: name in the equations -> (N - 1,). shapes: values of the term's shapes. mean: over each sample, as an
        unknown input is, instead of the value at its begin: a fast lag is over within a sample or two.
        """
        names = list(self.rates)
        size = next(iter(known.values())).size
        rates = [Expression.parse(text) for text in self.rates.values()]

        def at(states: Mapping[str, float]) -> np.ndarray:
            values = [rate.values({**known, **shapes, **states}) * np.ones(size) for rate in rates]
            return np.column_stack(values)

        rest = at(dict.fromkeys(names, 0.0))
        slopes = np.stack([at({**dict.fromkeys(names, 0.0), name: 1.0}) - rest for name in names], axis=2)
        out = np.zeros((size, len(names)))
        ends = [*begins[1:], size]
        for first, end in zip(begins, ends, strict=True):
            part = slice(first, end)
            if not slopes.any():
                # Held over a sample of 4 ms, 300 rad/s would put the angle 0.6 rad off.
                rest[part] = 0.5 * (rest[part] + np.vstack([rest[part][1:], rest[part][-1:]]))
            course = _linear(slopes[part], rest[part], sample_time)
            out[part] = _means(course, slopes[part], rest[part], sample_time) if mean else course
        return dict(zip(names, out.T, strict=True))


def _linear(slopes: np.ndarray, rest: np.ndarray, dt: float) -> np.ndarray:
    """Course (N, n) from zero of dy/dt = slopes y + rest, with slopes (N, n, n) and rest (N, n) held over a sample."""
    n = rest.shape[1]
    if n == 1:
        a, b = slopes[:, 0, 0] * dt, rest[:, 0] * dt
        gain = np.where(np.abs(a) < 1e-9, 1.0, np.expm1(a) / np.where(a == 0.0, 1.0, a))
        keep, add = np.exp(a)[:, None, None], (gain * b)[:, None]
    else:
        block = np.zeros((2 * n, 2 * n))
        block[:n, :n], block[:n, n:] = slopes[0] * dt, np.eye(n) * dt
        whole = expm(block)
        keep, add = np.repeat(whole[None, :n, :n], len(rest), axis=0), rest @ whole[:n, n:].T
    course = linear_recursion(keep[:-1], add[:-1, :, None], np.zeros((n, 0)))[:, :, 0]
    # A log without samples has no first state either.
    return np.asarray(course[: len(rest)])


def _means(course: np.ndarray, slopes: np.ndarray, rest: np.ndarray, dt: float) -> np.ndarray:
    """Mean over each sample (N, n) of a course by `_linear`: dy/dt = slopes y + rest gives it from both ends."""
    ends = np.vstack([course[1:], course[-1:]])
    if course.shape[1] == 1:
        slope = slopes[:, :, 0]
        steep = np.abs(slope) * dt > 1e-6
        exact = ((ends - course) / dt - rest) / np.where(steep, slope, 1.0)
        return np.where(steep, exact, 0.5 * (course + ends))
    if np.linalg.cond(slopes[0]) < 1e12:
        return np.asarray(np.linalg.solve(slopes[0], ((ends - course) / dt - rest).T).T)
    return 0.5 * (course + ends)


@dataclass(frozen=True)
class MemoryTerm:
    """A term with a memory.

    text: in variables, the state and shapes. shapes, units: as of a term. on: what it depends on, for results.
    """

    text: str
    memory: Memory
    shapes: Mapping[str, float]
    units: Mapping[str, str]
    on: tuple[str, ...]


def clock() -> Memory:
    """The running time."""
    return Memory({STATE: "1"}, {STATE: "s"}, {STATE: 1.0})


def turn(speed: str) -> Memory:
    """The angle since the start."""
    return Memory({STATE: speed}, {STATE: "rad"}, {STATE: 1.0})


def lag(of: str, unit: str, size: float, *, while_moving: str = "") -> Memory:
    """What follows a variable with the time constant tau; it rests where `while_moving` is zero."""
    rate = f"({of} - {STATE}) / tau" + (f" * abs(sign({while_moving}))" if while_moving else "")
    return Memory({STATE: rate}, {STATE: unit}, {STATE: max(size, 1e-300)})


def slip(speed: str, unit: str, size: float) -> Memory:
    """Deflection that follows the motion up to a width, and reverses with it."""
    return Memory({STATE: f"{speed} - abs({speed}) * {STATE} / width"}, {STATE: unit}, {STATE: max(size, 1e-300)})


def resonance(of: str, unit: str, size: float) -> Memory:
    """What follows a variable with a natural frequency and a damping ratio."""
    rate = f"frequency**2 * ({of} - {STATE}) - 2 * damping * frequency * {RATE}"
    scales = {STATE: max(size, 1e-300), RATE: max(size, 1e-300) * RESONANCES[0]}
    return Memory({STATE: RATE, RATE: rate}, {STATE: unit, RATE: f"{unit}/s"}, scales)


def over_time(bases: Mapping[str, tuple[str, ...]], seconds: float) -> Iterator[MemoryTerm]:
    """Terms that change with the running time: in proportion, towards an end value, and from a moment on.

    bases: factor -> what it depends on.
    """
    for base, on in bases.items():
        times = f"{base} * " if base != "1" else ""
        yield MemoryTerm(f"{times}{STATE}", clock(), {}, {}, (*on, "time"))
        for share in SLOW_SHARES:
            shapes = {"tau": share * seconds}
            yield MemoryTerm(f"{times}{TOWARDS_END}", clock(), shapes, {"tau": "s"}, (*on, "time"))
        for share in np.linspace(0.1, 0.9, 17).tolist():
            shapes = {"at": share * seconds, "width": 0.01 * seconds}
            step = f"{times}0.5 * (1 + tanh(({STATE} - at) / width))"
            yield MemoryTerm(step, clock(), shapes, {"at": "s", "width": "s"}, (*on, "time"))


def over_angle(speed: str) -> Iterator[MemoryTerm]:
    """Waves over the angle since the start."""
    for order in ORDERS:
        for phase in (0.0, 0.5 * np.pi):
            shapes, units = {"order": order, "at": phase}, {"order": "1", "at": "1"}
            yield MemoryTerm(f"sin(order * {STATE} + at)", turn(speed), shapes, units, ("angle",))


def following(
    text: str, of: str, unit: str, size: float, taus: Sequence[float], on: tuple[str, ...]
) -> Iterator[MemoryTerm]:
    """Terms with the lag of a variable. text: of the term, in the state and the variable."""
    for tau in taus:
        yield MemoryTerm(text, lag(of, unit, size), {"tau": tau}, {"tau": "s"}, on)
