"""Open-loop analysis of a linear model: poles, zeros, damping, DC gains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.result import Result, as_dict
from .sampled import scaled_matrices

if TYPE_CHECKING:
    import control
    import pandas

#: Outputs to analyse -> unit of the output, and -> key in results.
OUTPUTS = {"omega": "rad/s", "dP": "Pa", "v": "m/s", "x": "m", "theta": "rad"}
KEYS = {"omega": "speed", "dP": "dP", "v": "rod_speed", "x": "position", "theta": "angle"}


@dataclass(frozen=True, repr=False)
class Analysis(Result):
    """Properties of a linear model from its first input, the drive.

    Attributes
    ----------
    system: the model.
    poles, natural_frequencies, damping: (n,) [rad/s, rad/s, 1], sorted by frequency.
    zeros: output -> zeros from the current, rad/s.
    dc_gains: output -> steady value per unit of the drive, inf for an integrator.
    drive_unit: SI unit of the drive.
    """

    system: control.StateSpace
    poles: np.ndarray
    natural_frequencies: np.ndarray
    damping: np.ndarray
    zeros: dict[str, np.ndarray]
    dc_gains: dict[str, float]
    drive_unit: str = "A"

    @property
    def drive(self) -> str:
        """Name of the drive."""
        return str(self.system.input_labels[0])

    def to_dict(self) -> dict[str, Any]:
        """Content of analysis.json, SI units."""
        return as_dict(
            self, "poles natural_frequencies damping", states=self.system.state_labels,
            zeros={KEYS[output]: zeros for output, zeros in self.zeros.items()},
            dc_gain={KEYS[output]: gain for output, gain in self.dc_gains.items()},
            drive={"input": self.drive, "unit": self.drive_unit},
        )  # fmt: skip

    def __str__(self) -> str:
        lines = [f"{self.system.name}: states {', '.join(self.system.state_labels)}", "poles"]
        for pole, frequency, damping in zip(self.poles, self.natural_frequencies, self.damping, strict=True):
            place = f"{pole.real:.4g}" + (f" {pole.imag:+.4g}i" if pole.imag else "")
            detail = f"{frequency / (2 * np.pi):8.3g} Hz, damping {damping:.3g}" if frequency else "integrator"
            lines.append(f"  {place:<20} rad/s   {detail}")
        lines.append("from the current" if self.drive == "current" else f"from {self.drive}")
        for output, gain in self.dc_gains.items():
            zeros = ", ".join(f"{z.real:.4g}" + (f"{z.imag:+.4g}i" if z.imag else "") for z in self.zeros[output])
            size = f"{gain:.5g} {OUTPUTS[output]}/{self.drive_unit}" if np.isfinite(gain) else "integrates"
            lines.append(f"  {output:<6} DC gain {size:<20} zeros {zeros or 'none'}")
        return "\n".join(lines)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per pole: real and imaginary part and natural frequency (rad/s), damping (nan for an integrator)."""
        import pandas

        parts = {"real": self.poles.real, "imaginary": self.poles.imag}
        rest = {"natural_frequency": self.natural_frequencies, "damping": self.damping}
        return pandas.DataFrame({**parts, **rest}).rename_axis("pole")


def analyse(system: control.StateSpace, *, drive_unit: str = "A") -> Analysis:
    """Poles, zeros and DC gains of a linear model, by python-control.

    system: the drive is the first input, in drive_unit; outputs are named omega, dP, v, x, theta.
    """
    poles = np.sort_complex(system.poles())
    poles = poles[np.argsort(np.abs(poles), kind="stable")]
    frequency = np.where(np.abs(poles) < 1e-9, 0.0, np.abs(poles))
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = np.where(frequency > 0, -poles.real / frequency, np.nan)
    fastest = max(float(np.max(frequency)), 1.0)
    zeros, gains = {}, {}
    for output in OUTPUTS:
        if output not in system.output_labels:
            continue
        part = system if output == "x" else _without_free_position(system)
        channel = part[part.output_labels.index(output), 0]
        # A strictly proper system has zeros at infinity, which rounding makes large numbers.
        zeros[output] = np.array([zero for zero in _balanced(channel).zeros() if abs(zero) < 1e3 * fastest])
        gains[output] = float(np.real(channel.dcgain()))
    return Analysis(system, poles, frequency, damping, zeros, gains, drive_unit)


def _without_free_position(system: control.StateSpace) -> control.StateSpace:
    """Remove the position if nothing depends on it: it would add a pole and a zero at 0 to every channel."""
    import control

    if "x" not in system.state_labels or np.any(system.A[:, system.state_labels.index("x")]):
        return system
    x, y = system.state_labels.index("x"), system.output_labels.index("x")
    a = np.delete(np.delete(system.A, x, 0), x, 1)
    b, c = np.delete(system.B, x, 0), np.delete(np.delete(system.C, x, 1), y, 0)
    outputs = [name for name in system.output_labels if name != "x"]
    return control.ss(a, b, c, np.delete(system.D, y, 0), outputs=outputs)


def _balanced(system: control.StateSpace) -> control.StateSpace:
    """The system in balanced states: speeds in rad/s and pressures in Pa differ by ten decades."""
    import control
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(system.A, permute=False, separate=True)
    return control.ss(*scaled_matrices(system, scale), system.D)
