"""What a law may remember: the running time, an angle, a lag, a hysteresis, a resonance.

A memory is one or two states of an effect. The rates of two are linear in them; that of one may have another slope
below one of KINKS. Their course along a log is exact for signals that are held over each sample. What only
adds up, as an angle, takes them as lines between samples.

Sources: P. R. Dahl, "A solid friction model", The Aerospace Corporation, TOR-0158(3107-18)-1, 1968 (hysteresis over the
travelled distance).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from ...core.compiled import cached_njit
from ...core.expression import Expression
from ...core.linear_recursion import constant_recursion

#: Time constants that are tried: for what follows within a motion [s], and for what takes a log, as shares of its
#: length. Engineering judgement, as are the other grids.
LAGS, SLOW_SHARES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0), (0.06, 0.15, 0.4, 1.0)
#: Time constants of an acceleration [s], and what it is called in results.
QUICK, ACCELERATION = (0.01, 0.03), "acceleration"
#: Ratio of the time constant of a late direction to that with which the other direction decays: 1000 takes it away in
#: 0.7 % of the time constant. On the bench, where a reversal does so at once, 50 left up to eight times the gap.
#: Engineering judgement.
FORGETS = 1000.0
#: Distances of a hysteresis, as shares of the range of the position.
SLIPS = (0.005, 0.02, 0.08)
#: Natural frequencies [rad/s] and damping ratios of a resonance; at the larger one neighbouring peaks overlap.
RESONANCES, DAMPINGS = (30.0, 42.0, 60.0, 85.0, 120.0, 170.0, 240.0, 340.0), (0.1, 0.3)
#: Waves over the shaft angle: periods per turn.
ORDERS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0)

#: Values of a state at which the slope of its rate may change.
KINKS = (0.0, 1.0, -1.0)

#: Local name of a state in terms and rates; a second one has the rate of the first.
STATE, RATE = "memory", "memory_rate"
#: Local name of the number of waves in a turn.
ORDER = "order"
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

        kink = _kink(*self.rates.items()) if len(names) == 1 else 0.0
        rest = at(dict.fromkeys(names, kink))

        def slopes(sign: float) -> np.ndarray:
            """(N, n, n) of the rates by the states on this side of the kink."""
            ends = [at({**dict.fromkeys(names, kink), name: kink + sign}) for name in names]
            return sign * np.stack([end - rest for end in ends], axis=2)

        above = slopes(1.0)
        below = slopes(-1.0) if len(names) == 1 else above
        out = np.zeros((size, len(names)))
        ends = [*begins[1:], size]
        for first, end in zip(begins, ends, strict=True):
            part = slice(first, end)
            if not above.any():
                # Held over a sample of 4 ms, 300 rad/s would put the angle 0.6 rad off.
                rest[part] = 0.5 * (rest[part] + np.vstack([rest[part][1:], rest[part][-1:]]))
            if len(names) == 1:
                slopes_of_one = below[part, 0, 0], above[part, 0, 0]
                course, means = _of_one(*slopes_of_one, rest[part, 0], -kink, sample_time)
                out[part, 0] = kink + (means if mean else course)
            else:
                out[part] = _of_several(above[part], rest[part], sample_time, mean=mean)
        return dict(zip(names, out.T, strict=True))


@lru_cache(maxsize=1024)
def _kink(row: tuple[str, str]) -> float:
    """The one of KINKS at which the slope of a rate changes; zero for a straight one. row: name of the state, rate."""
    name, rate = row[0], Expression.parse(row[1])
    others = dict.fromkeys(rate.names, 0.5)

    def bends(at: float) -> bool:
        left, middle, right = np.zeros(3) + rate.values({**others, name: at + np.array([-1.0, 0.0, 1.0])})
        return not np.isclose(right - middle, middle - left)

    return next((at for at in KINKS if bends(at)), 0.0)


@cached_njit(nogil=True)
def _of_one(
    below: np.ndarray, above: np.ndarray, rest: np.ndarray, y: float, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Course (N,) from y of dy/dt = rest + slope y, held over a sample, and its mean over each sample.

    below, above: (N,) slope where y is negative and where it is not.
    """
    course, means = np.zeros(rest.size), np.zeros(rest.size)
    for k in range(rest.size):
        course[k], left, total = y, dt, 0.0
        # A rate that is linear on either side of zero crosses it once at most.
        for _ in range(2):
            slope = below[k] if y < 0.0 or (y == 0.0 and rest[k] < 0.0) else above[k]
            flat = abs(slope) * left < 1e-9
            end = y + rest[k] * left if flat else y * np.exp(slope * left) + rest[k] * np.expm1(slope * left) / slope
            time = left
            if y * end < 0.0:
                time = -y / rest[k] if flat else -np.log1p(slope * y / rest[k]) / slope
                time, end = min(time, left), 0.0
            total += (end - y - rest[k] * time) / slope if abs(slope) * time > 1e-6 else 0.5 * (y + end) * time
            y, left = end, left - time
            if left <= 0.0:
                break
        means[k] = total / dt
    return course, means


def _of_several(slopes: np.ndarray, rest: np.ndarray, dt: float, *, mean: bool) -> np.ndarray:
    """Course (N, n) from zero of dy/dt = slopes y + rest, or its mean over each sample.

    slopes (N, n, n), the same in each; rest (N, n), held over a sample.
    """
    n = rest.shape[1]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:] = slopes[0] * dt, np.eye(n) * dt
    whole = expm(block)
    course = constant_recursion(np.ascontiguousarray(whole[:n, :n]), rest @ whole[:n, n:].T)
    if not mean:
        return course
    ends = np.vstack([course[1:], course[-1:]])
    if np.linalg.cond(slopes[0]) < 1e12:
        return np.asarray(((ends - course) / dt - rest) @ np.linalg.inv(slopes[0]).T)
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


def lag(of: str, unit: str, size: float) -> Memory:
    """What follows a variable with the time constant tau."""
    return Memory({STATE: f"({of} - {STATE}) / tau"}, {STATE: unit}, {STATE: max(size, 1e-300)})


def late_direction(direction: str, *, forgets: bool, begins: float = 0.0) -> tuple[str, Memory]:
    """What dry friction lacks of its level while its direction is late: the term, and the state that follows the
    direction of the contact, which is zero at rest, with the time constant tau of motion.

    forgets: it begins near zero after each reversal, whatever was before: the rest of the other direction decays about
    FORGETS times as fast. begins: its value at the start, from which the state counts: the direction of the first
    motion if the contact has settled before the log, or zero if it has just reversed.
    """
    now, late = f"({STATE}{_plus(begins)})" if begins else STATE, f"({direction} - {STATE}{_plus(-begins)}"
    away = f" + {FORGETS:g} * {direction} * max(-{direction} * {now}, 0)" if forgets else ""
    memory = Memory({STATE: f"{late}{away}) / tau * abs({direction})"}, {STATE: "1"}, {STATE: 1.0})
    return f"{direction} * (1 - abs({STATE}{_plus(begins)}))" if forgets else f"{late})", memory


def _plus(number: float) -> str:
    """A number that is added to what comes before; nothing for zero."""
    return f" {'-' if number < 0.0 else '+'} {abs(number):g}" if number else ""


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
            shapes, units = {ORDER: order, "at": phase}, {ORDER: "1", "at": "1"}
            yield MemoryTerm(f"sin({ORDER} * {STATE} + at)", turn(speed), shapes, units, ("angle",))


def following(
    text: str, of: str, unit: str, size: float, taus: Sequence[float], on: tuple[str, ...]
) -> Iterator[MemoryTerm]:
    """Terms with the lag of a variable. text: of the term, in the state and the variable."""
    for tau in taus:
        yield MemoryTerm(text, lag(of, unit, size), {"tau": tau}, {"tau": "s"}, on)
