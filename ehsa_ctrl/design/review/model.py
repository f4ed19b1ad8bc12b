"""Tests of the model: can the current move all of it, is it fit for computing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..analysis.reachable import hidden_modes
from ..analysis.sampled import readings, sizes
from .case import Case
from .finding import Finding, Verdict, judge

#: Largest ratio of the sizes of a model's states that double precision and first-order solvers bear well.
SCALES = 1e6


def reach(case: Case) -> Iterator[Finding]:
    """Modes that the current does not reach, or that the readings don't show."""
    scale = sizes(case.system)
    a = case.system.A * (scale[None, :] / scale[:, None])
    current = case.system.B[:, [list(case.system.input_labels).index("current")]] / scale[:, None]
    seen = readings(case.system) @ case.system.C * scale[None, :]
    for word, modes, fix in (
        ("controllable", hidden_modes(a, current), "design on a model without the mode, e.g. three_state"),
        ("observable", hidden_modes(a.T, seen.T), "measure more, or design on a model without the mode"),
    ):
        growing = [mode for mode in modes if mode.real > 1e-9]
        lasting = [mode for mode in modes if abs(mode.real) <= 1e-9]
        words = ", ".join(f"{mode if mode.imag else mode.real:.3g} rad/s" for mode in modes)
        verdict: Verdict = "fault" if growing else ("warning" if lasting else "good")
        yield Finding(
            f"model {word}", f"not these modes: {words}" if modes else "every mode", verdict if modes else "good", fix
        )


def scaling(case: Case) -> Iterator[Finding]:
    """Sizes of the states of the model that is computed with."""
    from scipy.linalg import matrix_balance

    model = getattr(case.feedback, "model", None)
    scale = sizes(case.system)
    if model is not None:
        _, (scale, _) = matrix_balance(np.asarray(model.A), permute=False, separate=True)
    ratio = float(np.max(scale) / np.min(scale))
    of = "the law's own model" if model is not None else "the plant's model, in SI units"
    verdict = judge(ratio > SCALES) if model is not None or hasattr(case.feedback, "horizon") else "good"
    yield Finding(
        "state scaling",
        f"sizes of the states differ by {ratio:.1e} in {of}",
        verdict,
        "design in units in which the states are of like size (rad/s, bar, mm)",
    )
