"""The predicted gain of an effect, beside the same linear least-squares problem solved by scipy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ehsa_ctrl.diagnosis.objective import TEMPER
from ehsa_ctrl.diagnosis.refit import HypothesisFit
from ehsa_ctrl.diagnosis.screening import Response, Screening
from ehsa_ctrl.physics.effects import CandidateEffect, Effect, EffectParameter, FreeNumber

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


def least_squares(fit, responses, freed=()):
    """The linear model with these responses, which stand for the parameters in `freed`, at its least cost."""
    kept = [i for i, f in enumerate(fit.free) if f.name not in freed]
    moved = [column for r in responses for column in r.sensitivities.values()]
    rows = [np.sqrt(TEMPER) * np.column_stack([fit.jacobian[:, kept], *moved])]
    right = [-np.sqrt(TEMPER) * (fit.residual + sum(r.base - fit.residual for r in responses))]
    for k, i in enumerate(kept):
        f = fit.free[i]
        if k >= fit.n_effect:
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
    return found


def cost_after(*given):
    return 2.0 * least_squares(*given).cost


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
    """Its own effect in a form with another number, and another effect with one of its numbers."""
    rng = np.random.default_rng(5)
    other = FreeNumber("other", 0.0, 1.0)
    same_number = Response(
        CandidateEffect(Effect("x", "torque", "", ""), (OWN, other), ()), {"own": 0.0, "other": 0.0}, RESIDUAL, {}
    )
    form = replace(fit.candidates[0], free=(FreeNumber("form", 0.0, 1.0),))
    other_form = Response(form, {"form": 0.0}, RESIDUAL, {"form": rng.standard_normal(N)})
    screening = Screening.of([other_form, same_number, response(rng, other)], RESIDUAL)

    assert [gain.candidate.id for gain in screening.gains(fit)] == ["other"]


def test_the_start_is_the_predicted_step_within_bounds(fit):
    """The values of a set, with the new effect's numbers after the step."""
    rng = np.random.default_rng(6)
    bounded, free = FreeNumber("bounded", 0.0, 2.0, -1.0, 0.501), FreeNumber("free", 0.0, 2.0)
    at_bound, inside = response(rng, bounded, at=0.5), response(rng, free, at=0.5)
    at_bound.sensitivities["bounded"][:] = -RESIDUAL
    screening = Screening.of([at_bound, inside], RESIDUAL)

    found = {gain.candidate.id: gain.start(fit.values) for gain in screening.gains(fit)}

    assert found["bounded"] == {**fit.values, "bounded": 0.501}
    expected = least_squares(fit, [inside]).x[-1]
    assert abs(expected) > 1e-3
    assert found["free"] == {**fit.values, "free": pytest.approx(0.5 + 2.0 * expected, rel=1e-4)}


def test_the_step_of_a_shape_counts_from_the_neutral_value(fit):
    """It has a secant from there to its start, and its bounds hold from there."""
    numbers = FreeNumber("height", 0.0, 1.0, 0.0, 0.7), FreeNumber("place", 0.2, 1.0)
    place = EffectParameter("place", "m", "", 0.2, 0.3, 0.0, shape=True)
    bump = CandidateEffect(Effect("bump", "torque", "", "", parameters=(place,)), numbers, ())
    one = Response(bump, {"height": 0.5, "place": 0.3}, RESIDUAL, {"height": -RESIDUAL})

    (gain,) = Screening.of([one], RESIDUAL).gains(fit)

    assert gain.step.tolist() == [0.7]
    assert gain.start(fit.values) == {**fit.values, "height": 0.7, "place": 0.3}


def test_gains_beside_two_effects_that_are_nearly_the_same(fit):
    """Their difference explains nothing more, and the gain of a third one like them is that of least squares."""
    rng = np.random.default_rng(7)
    twin = FreeNumber("twin", 0.0, 1.0)
    hidden = rng.standard_normal(N)
    columns = fit.jacobian.copy()
    columns[:, 1] = columns[:, 0] + 1e-4 * hidden
    pair = (candidate(OWN), candidate(twin))
    both = replace(fit, candidates=pair, free=(OWN, twin, *NOMINAL[1:]), jacobian=10.0 * columns)
    both = replace(both, values={**fit.values, "twin": 0.1})
    third = response(rng, FreeNumber("third", 0.0, 1.0))
    third.sensitivities["third"][:] = 10.0 * columns[:, 0] + 0.3 * RESIDUAL

    (gain,) = Screening.of([third], RESIDUAL).gains(both)

    assert gain.decrease == pytest.approx(cost_after(both, []) - cost_after(both, [third]), rel=1e-3)
