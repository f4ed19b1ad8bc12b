"""Subspace identification: impulse response by least squares, state space by the eigensystem realization algorithm.

Both are python-control's (`markov`, `eigensys_realization`; J.-N. Juang, R. S. Pappa, "An eigensystem realization
algorithm for modal parameter identification and model reduction", J. Guidance 8(5), 1985).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.errors import InputError
from ..core.result import Result, as_dict

if TYPE_CHECKING:
    import control

#: Samples of the impulse response: with 250 Hz 1.6 s, in which the slowest mode of the plant, at 9 rad/s, decays to
#: 1e-6.
SAMPLES = 400
#: Samples of the record per sample of the impulse response, at least; shortest impulse response. Engineering judgement.
RECORD, SHORTEST = 10, 60
#: Largest order that is chosen automatically.
LARGEST_ORDER = 12
#: A singular value counts from this multiple of the level of those beyond LARGEST_ORDER, and never below SMALLEST of
#: the largest one (engineering judgement).
ABOVE_NOISE, SMALLEST = 3.0, 1e-3
#: Share of the band up to the Nyquist frequency that the input must excite, and the density relative to the largest one
#: from which it does: elsewhere the impulse response is not determined (engineering judgement).
BAND, DENSITY = 0.95, 1e-3


@dataclass(frozen=True, repr=False)
class SubspaceModel(Result):
    """A linear model from data, without physics.

    Attributes
    ----------
    system: discrete, from the drive to the outputs, SI units.
    singular_values: (k,) of the Hankel matrix of the impulse response, outputs scaled to a standard deviation of 1.
    fit_percent: output -> fit of its simulation to the record that it was identified from.
    """

    system: control.StateSpace
    singular_values: np.ndarray
    fit_percent: dict[str, float]

    @property
    def order(self) -> int:
        return int(self.system.nstates)

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        matrices = {name: np.asarray(getattr(self.system, name)) for name in "ABCD"}
        poles = np.log(self.system.poles().astype(complex)) / float(self.system.dt)
        return as_dict(
            self, "order singular_values fit_percent", sample_time=float(self.system.dt), **matrices,
            outputs=list(self.system.output_labels), poles=[[float(p.real), float(p.imag)] for p in poles],
        )  # fmt: skip

    def __str__(self) -> str:
        values = self.singular_values / self.singular_values[0]
        fits = ", ".join(f"{name} {value:.1f} %" for name, value in self.fit_percent.items())
        listed = ", ".join(f"{value:.2g}" for value in values[: self.order + 3])
        return f"subspace model of order {self.order}: fit {fits}; singular values {listed} ..."


def identify_subspace(
    drive: np.ndarray, outputs: Mapping[str, np.ndarray], sample_time: float, *, order: int | None = None
) -> SubspaceModel:
    """Linear model from a drive (N,) to outputs (N,), without their means.

    order: of the model; by default the number of singular values above the noise; lowered until the model is stable.

    Raises InputError for too short a record, an input that does not excite the band up to the Nyquist frequency, a
    constant output, and an order below 1 or above what the data determine.
    """
    import control
    from scipy.signal import welch

    from .comparison import fit_percent

    length = min(SAMPLES, drive.size // RECORD)
    if length < SHORTEST:
        raise InputError(f"subspace identification: {drive.size} samples; expected at least {RECORD * SHORTEST}")
    blocks = 3 * length // 10
    frequency, density = welch(drive, fs=1.0 / sample_time, nperseg=min(drive.size // 4, 1024))
    excited = frequency[density > DENSITY * np.max(density)]
    if excited.size < BAND * frequency.size:
        raise InputError(
            f"subspace identification: the input excites {100 * excited.size / frequency.size:.0f} % of the band up to "
            f"{frequency[-1]:g} Hz; expected {100 * BAND:g} %: elsewhere the data determine nothing; drive the "
            "plant with a current of white spectrum, such as --excitation white"
        )
    u = drive - drive.mean()
    scales = {name: float(np.std(y)) for name, y in outputs.items()}
    if not all(scales.values()):
        raise InputError("subspace identification: an output is constant; leave it out")
    y = np.array([(signal - signal.mean()) / scales[name] for name, signal in outputs.items()])
    # In units of samples: with a sample time, python-control 0.10.2 scales B by it and leaves D as it is.
    impulse = np.atleast_3d(control.markov(y, u[None, :], length, dt=True, truncate=True))
    impulse = impulse.reshape(len(outputs), 1, length)
    _, values = control.eigensys_realization(impulse, 1, m=blocks, n=blocks, dt=True)
    if order is None:
        level = max(ABOVE_NOISE * values[LARGEST_ORDER], SMALLEST * values[0])
        order = max(int(np.count_nonzero(values[:LARGEST_ORDER] > level)), 1)
    if not 1 <= order < blocks:
        raise InputError(f"subspace identification: order = {order}; expected 1 to {blocks - 1}")
    for tried in range(order, 0, -1):
        found, _ = control.eigensys_realization(impulse, tried, m=blocks, n=blocks, dt=True)
        order = tried
        if np.max(np.abs(found.poles())) < 1.0:
            break
    else:
        raise InputError(
            "subspace identification: no stable linear model follows from this record; the plant is not linear for "
            "this input (friction, limits), or it has an integrator"
        )
    back = np.diag(list(scales.values()))
    system = control.ss(
        found.A, found.B, back @ found.C, back @ found.D, sample_time,
        inputs=["drive"], outputs=list(outputs), name=f"subspace model of order {order}",
    )  # fmt: skip
    time = sample_time * np.arange(u.size)
    simulated = np.atleast_2d(control.forced_response(system, time, u).outputs)
    fits = {
        name: fit_percent(signal - signal.mean(), run - run.mean())
        for (name, signal), run in zip(outputs.items(), simulated, strict=True)
    }
    return SubspaceModel(system, values, fits)
