"""The three forms in which a PID is written, and the sampled law that they all become.

    parallel   C = k_p + k_i / s + k_d s / (1 + T_f s)
    standard   C = K (1 + 1 / (T_i s) + T_d s / (1 + T_f s))
    series     C = K (1 + 1 / (T_i s)) (1 + T_d s / (1 + T_f s))

The parallel form can say everything. The series form can only have real zeros, without a filter T_i >= 4 T_d in the
standard form (K. J. Astrom, T. Hagglund, "Advanced PID Control", ISA 2006, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import Any

from ...core.errors import InputError


@dataclass(frozen=True)
class Gains:
    """Parallel form: k_p [A/m], k_i [A/(m s)], k_d [A s/m], filter time constant T_f [s]."""

    k_p: float
    k_i: float = 0.0
    k_d: float = 0.0
    T_f: float = 0.0

    def __str__(self) -> str:
        return (
            f"k_p = {self.k_p:.4g} A/m, k_i = {self.k_i:.4g} A/(m s), k_d = {self.k_d:.4g} A s/m, "
            f"T_f = {self.T_f:.3g} s"
        )

    def response(self, z: Any, sample_time: float) -> Any:
        """Response C(z) of the sampled law at the points z of the unit circle.

        The integral takes forward, the derivative backward differences: the filter stays stable and well damped for
        any ratio of T_f and sample time.
        """
        integral = self.k_i * sample_time / (z - 1.0) if self.k_i else 0.0 * z
        slope = self.k_d * (z - 1.0) / ((self.T_f + sample_time) * z - self.T_f) if self.k_d else 0.0
        return self.k_p + integral + slope

    def standard(self) -> Standard:
        """The same law in the standard form. Raises InputError for k_p = 0, which that form can't write."""
        if self.k_p == 0.0:
            raise InputError("k_p = 0 can't be written in the standard form, whose terms all are shares of K")
        return Standard(self.k_p, self.k_p / self.k_i if self.k_i else inf, self.k_d / self.k_p, self.T_f)

    def series(self) -> Series:
        """The same law in the series form. Raises InputError where it has no such form: complex zeros."""
        if self.k_i == 0.0:
            if self.k_p == 0.0:
                raise InputError("k_p = k_i = 0 can't be written in the series form, whose terms all are shares of K")
            return Series(self.k_p, inf, self.k_d / self.k_p, self.T_f)
        # s (1 + T_f s) C = k_i (1 + sum s + product s^2) = k_i (1 + T_i s) (1 + (T_f + T_d) s)
        total = (self.k_p + self.k_i * self.T_f) / self.k_i
        product = (self.k_p * self.T_f + self.k_d) / self.k_i
        root = total * total - 4.0 * product
        # A double zero may fall on either side of it by rounding.
        if root < -1e-12 * total * total:
            raise InputError(
                f"{self}: its zeros are complex, which the series form can't write; "
                f"k_d must be at most {self.k_i * total * total / 4.0 - self.k_p * self.T_f:.4g} A s/m with these gains"
            )
        T_i = (total + sqrt(max(root, 0.0))) / 2.0
        if T_i <= 0.0:
            raise InputError(f"{self}: k_p is not positive, which the series form with positive times can't write")
        return Series(self.k_i * T_i, T_i, product / T_i - self.T_f, self.T_f)


@dataclass(frozen=True)
class Standard:
    """Standard form: K [A/m], T_i [s] (inf: no integral action), T_d [s], T_f [s]."""

    K: float
    T_i: float = inf
    T_d: float = 0.0
    T_f: float = 0.0

    def parallel(self) -> Gains:
        _check_times(self.T_i, self.T_d, self.T_f)
        return Gains(self.K, self.K / self.T_i, self.K * self.T_d, self.T_f)


@dataclass(frozen=True)
class Series:
    """Series form: K [A/m], T_i [s] (inf: no integral action), T_d [s], T_f [s]."""

    K: float
    T_i: float = inf
    T_d: float = 0.0
    T_f: float = 0.0

    def parallel(self) -> Gains:
        _check_times(self.T_i, self.T_d, self.T_f)
        share = 1.0 / self.T_i
        return Gains(
            self.K * (1.0 + self.T_d * share), self.K * share, self.K * self.T_d * (1.0 - self.T_f * share), self.T_f
        )


def _check_times(T_i: float, T_d: float, T_f: float) -> None:
    if not T_i > 0.0:
        raise InputError(f"T_i = {T_i:g} s; expected more than 0 s, or left out for no integral action")
    if not (isfinite(T_d) and isfinite(T_f)):
        raise InputError(f"T_d = {T_d:g} s, T_f = {T_f:g} s; expected finite times")
