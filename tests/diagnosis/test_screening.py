"""The predicted gain of an effect, beside the same linear least-squares problem solved by scipy."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ehsa_ctrl.diagnosis.objective import TEMPER
from ehsa_ctrl.diagnosis.refit import HypothesisFit
from ehsa_ctrl.diagnosis.screening import Response, Screening
from ehsa_ctrl.physics.effects import CandidateEffect, Effect, FreeNumber

N = 2000


def candidate(*numbers):
    return CandidateEffect(Effect(numbers[0].name, "torque", "", ""), numbers, ())


def response(rng, *numbers, shift=0.0, at=0.0):
    """Random columns for numbers that begin at `at`."""
    base = RESIDUAL + shift * rng.standard_normal(N)
    columns = {one.name: 0.3 * rng.standard_normal(N) for one in numbers}
    return Response(candidate(*numbers), {one.name: at for one in numbers}, base, columns)


RESIDUAL = np.random.default_rng(1).standard_normal(N)
OWN = FreeNumber("own", 0.0, 1.0)
NOMINAL = tuple(FreeNumber(f"p{i}", 1.0, 0.1) for i in range(4))


@pytest.fixture
def fit():
    """One effect and four nominal parameters away from their nominal values."""
    rng = np.random.default_rng(2)
    values = {"own": 0.7, "p0": 1.2, "p1": 0.95, "p2": 1.0, "p3": 1.02}
    return HypothesisFit((candidate(OWN),), values, 0.0, RESIDUAL, rng.standard_normal((N, 5)), (OWN, *NOMINAL))


def cost_after(fit, responses, freed=()):
    """The least cost of the linear model with these responses, which stand for the parameters in `freed`."""
    kept = [i for i, f in enumerate(fit.free) if f.name not in freed]
    moved = [column for r in responses for column in r.sensitivities.values()]
    rows = [np.sqrt(TEMPER) * np.column_stack([fit.jacobian[:, kept], *moved])]
    right = [-np.sqrt(TEMPER) * (fit.residual + sum(r.base - fit.residual for r in responses))]
    for k, i in enumerate(kept):
        f = fit.free[i]
        if f is not OWN:
            rows.append(np.eye(rows[0].shape[1])[[k]])
            right.append(np.array([(f.nominal - fit.values[f.name]) / f.scale]))
    low, high = np.full(rows[0].shape[1], -np.inf), np.full(rows[0].shape[1], np.inf)
    at = len(kept)
    for r in responses:
        for f in r.moving:
            low[at], high[at] = (f.lower - r.origin(f)) / f.scale, (f.upper - r.origin(f)) / f.scale
            at += 1
    found = lsq_linear(np.vstack(rows), np.concatenate(right), (low, high), method="trf", tol=1e-15, lsq_solver="exact")
    assert found.success
    return 2.0 * found.cost


def test_the_gain_of_an_effect_is_that_of_least_squares(fit):
    """Also with a shift, with two numbers, at a bound, and where a nominal parameter has no prior any more."""
    rng = np.random.default_rng(3)
    free, bounded = FreeNumber("free", 0.0, 2.0), FreeNumber("bounded", 0.0, 1.0, -0.01, 0.01)
    one, two = response(rng, free), response(rng, FreeNumber("a", 0.0, 1.0), FreeNumber("b", 0.0, 1.0), shift=0.1)
    at_bound = response(rng, bounded)
    column = fit.jacobian[:, 2]
    freeing = Response(candidate(NOMINAL[1]), {"p1": 0.95}, RESIDUAL, {"p1": column})
    screening = Screening.of([one, two, at_bound, freeing], RESIDUAL)
    before = cost_after(fit, [])

    gains = screening.gains(fit)

    found = {gain.candidate.id: gain.decrease for gain in gains}
    for r, freed in ((one, ()), (two, ()), (at_bound, ()), (freeing, ("p1",))):
        expected = before - cost_after(fit, [r], freed)
        assert found[r.candidate.id] == pytest.approx(expected, rel=1e-4, abs=1e-4)
    assert [gain.decrease for gain in gains] == sorted((gain.decrease for gain in gains), reverse=True)


def test_effects_and_numbers_of_the_fit_are_left_out(fit):
    """Its own effect in another form, and another effect with one of its numbers."""
    rng = np.random.default_rng(5)
    other = FreeNumber("other", 0.0, 1.0)
    same_number = Response(
        CandidateEffect(Effect("x", "torque", "", ""), (OWN, other), ()), {"own": 0.0, "other": 0.0}, RESIDUAL, {}
    )
    screening = Screening.of([response(rng, OWN, at=0.5), same_number, response(rng, other)], RESIDUAL)

    assert [gain.candidate.id for gain in screening.gains(fit)] == ["other"]


def test_the_start_is_the_predicted_step_within_bounds(fit):
    """The values of a set, with the new effect's numbers after the step."""
    rng = np.random.default_rng(6)
    number = FreeNumber("free", 0.0, 2.0, -1.0, 0.001)
    one = response(rng, number)
    one.sensitivities["free"][:] = -RESIDUAL

    (gain,) = Screening.of([one], RESIDUAL).gains(fit)

    assert gain.start(fit.values) == {**fit.values, "free": 0.001}
