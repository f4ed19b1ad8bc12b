"""A PID whose gains follow a measured variable along a table.

Between the rows of the table gains are interpolated, beyond its ends they stay. A change of gains makes no step in the
current: the integral takes over what the proportional part loses or gains, the derivative's filter goes on from where
it is (gain scheduling as in K. J. Astrom, B. Wittenmark, "Adaptive Control", 2nd ed. 1995, chapter 9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp
from typing import TYPE_CHECKING, Any

import numpy as np

from .pid import Pid, pid_law
from .pid_forms import Gains

if TYPE_CHECKING:
    import control

#: What can be scheduled over: word -> (number in the settings, SI unit, channels that it is read from).
VARIABLES: dict[str, tuple[int, str, tuple[str, ...]]] = {
    "position": (0, "m", ("position",)),
    "level": (1, "Pa", ("p1", "p2")),
    "load": (2, "N", ("force",)),
}


def scheduled_law(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample.

    settings: variable (0 position, 1 pressure level, 2 force), share that its filter keeps, rows of the table; b, c,
    current_limit, 1 for conditional integration, sample time; then rows of variable, k_p, k_i, k_d, T_f, rate of
    back-calculation. memory: the PID's (5), the variable, k_p of the last sample; the PID's settings (10).
    """
    which, kept, rows = settings[0], settings[1], int(settings[2])
    if which == 0.0:
        value = measured[3]
    elif which == 1.0:
        value = 0.5 * (measured[1] + measured[2])
    else:
        value = measured[4]
    started = memory[3] != 0.0
    memory[5] = kept * memory[5] + (1.0 - kept) * value if started else value
    k = 0
    while k < rows - 2 and memory[5] > settings[8 + 6 * (k + 1)]:
        k += 1
    low = 8 + 6 * k
    share = (memory[5] - settings[low]) / (settings[low + 6] - settings[low])
    share = min(max(share, 0.0), 1.0)
    for j in range(4):
        memory[7 + j] = (1.0 - share) * settings[low + 1 + j] + share * settings[low + 7 + j]
    memory[11], memory[12], memory[13] = settings[3], settings[4], settings[5]
    memory[14] = (1.0 - share) * settings[low + 5] + share * settings[low + 11]
    memory[15], memory[16] = settings[6], settings[7]
    if started and memory[8] != 0.0:
        memory[0] += (memory[6] - memory[7]) * (settings[3] * reference[0] - measured[3])
    memory[6] = memory[7]
    return pid_law(reference, measured, memory[:5], memory[7:17], extra, hold)


@dataclass(frozen=True)
class ScheduledPid:
    """A scheduled position PID, a design.law.Law.

    Attributes
    ----------
    variable: a word of VARIABLES. filter_time: of the variable [s].
    points: rising values of the variable (n,), n >= 2. pids: the law at each.
    nominal: value for which `linear` speaks.
    """

    variable: str
    filter_time: float
    points: tuple[float, ...]
    pids: tuple[Pid, ...]
    nominal: float
    function = staticmethod(scheduled_law)
    uses: tuple[Callable[..., Any], ...] = (pid_law,)
    compiles = True
    traces = {"integral": 0, "scheduling": 5, "k_p": 6}

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(("position", *VARIABLES[self.variable][2])))

    def settings(self) -> np.ndarray:
        first = self.pids[0]
        kept = exp(-first.sample_time / self.filter_time) if self.filter_time > 0 else 0.0
        common = [float(VARIABLES[self.variable][0]), kept, float(len(self.points))]
        common += [first.b, first.c, first.current_limit, float(first.conditional), first.sample_time]
        rows = [
            [value, pid.gains.k_p, pid.gains.k_i, pid.gains.k_d, pid.gains.T_f, 1.0 / pid.T_t]
            for value, pid in zip(self.points, self.pids, strict=True)
        ]
        return np.concatenate([common, *rows])

    def initial_memory(self) -> np.ndarray:
        return np.zeros(17)

    def at(self, value: float) -> Pid:
        """The fixed PID that it is while the variable has this value."""
        columns = np.array([[p.gains.k_p, p.gains.k_i, p.gains.k_d, p.gains.T_f, 1.0 / p.T_t] for p in self.pids])
        k_p, k_i, k_d, T_f, back = (float(np.interp(value, self.points, column)) for column in columns.T)
        first = self.pids[0]
        T_t = 1.0 / back if back > 0 else float("inf")
        return Pid(
            Gains(k_p, k_i, k_d, T_f), first.b, first.c, first.current_limit, T_t, first.conditional, first.sample_time
        )

    def linear(self) -> control.StateSpace:
        """The fixed PID at `nominal`."""
        return self.at(self.nominal).linear()

    def __str__(self) -> str:
        unit = VARIABLES[self.variable][1]
        rows = "; ".join(f"{value:g} {unit}: {pid.gains}" for value, pid in zip(self.points, self.pids, strict=True))
        return f"PID over {self.variable}, {rows}"
