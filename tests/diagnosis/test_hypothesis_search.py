"""Where refits of related hypotheses start, on a log of a carriage whose parameters are known."""

from types import SimpleNamespace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_search import Hypotheses, Task
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.diagnosis.refit import refit, refit_until_converged
from ehsa_ctrl.diagnosis.scoring import _bases

RIG = ehsa_ctrl.load_plant("emps")


@pytest.fixture(scope="module")
def hypotheses():
    """Of a nominal carriage with 3 % too large a mass and 4 % too little viscous friction."""
    time = np.arange(0.0, 9.0, 0.004)
    force = 75.0 * np.sin(2.0 * np.pi * 0.9 * time) * np.where(np.sin(2.0 * np.pi * 0.17 * time) > 0.0, 1.0, 0.6)
    run = ehsa_ctrl.simulate(RIG, force, hold="first_order", sample_time=0.004)
    position = run["x"] + 1e-6 * np.random.default_rng(0).standard_normal(time.size)
    log = ehsa_ctrl.Log(time, {"drive_force": force, "position": position})
    nominal = RIG.set(M=1.03 * RIG["M"], Fv=0.96 * RIG["Fv"])
    prepared = prepare_logs(nominal, [log], None, 0.03, check=True)
    training = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True).training
    objective, sensitivities = objective_of(training, 0.03)
    return Hypotheses.initial(objective, tuple(candidate_effects(training.model)), sensitivities, Pool())


def members(hypotheses, *ids):
    return tuple(next(one for one in hypotheses.candidates if one.id == id) for id in ids)


def cost(hypotheses, candidates, values):
    """Cost of a hypothesis at these values."""
    return refit(hypotheses.objective, candidates, values, {}, steps=0).cost


@pytest.mark.parametrize("left_out", ["payload_mass", "rod_viscous_friction"])
def test_a_set_without_one_effect_starts_near_its_optimum(hypotheses, left_out):
    """The rest makes up for the missing effect: a good part of what a refit gains is gained at the start already."""
    both = members(hypotheses, "payload_mass", "rod_viscous_friction")
    fit = refit_until_converged(hypotheses.objective, both, {})
    (gone,) = members(hypotheses, left_out)
    rest = tuple(one for one in both if one is not gone)
    kept = {name: value for name, value in fit.values.items() if name not in gone.names}

    start = fit.without(gone, hypotheses.objective)

    optimum = refit_until_converged(hypotheses.objective, rest, start).cost
    before, after = (cost(hypotheses, rest, values) - optimum for values in (kept, start))
    assert set(start) == set(kept)
    assert after < 0.7 * before


def test_an_effect_without_a_neutral_value_is_taken_out_alone(hypotheses):
    """Nothing tells how the others would move."""
    (mass,) = members(hypotheses, "payload_mass")
    stop = next(c for c in hypotheses.candidates if c.id == "end_stop" and not np.isfinite(c.free[0].nominal))
    values = {"M": RIG["M"], **dict(zip(stop.names, stop.starts[0], strict=True))}
    fit = refit(hypotheses.objective, (mass, stop), values, {}, steps=0)

    start = fit.without(stop, hypotheses.objective)

    assert start == {name: value for name, value in fit.values.items() if name not in stop.names}


def test_a_set_fits_no_worse_than_a_part_of_it(hypotheses):
    """Its refit ended at a poor point; that of the part shows a better one."""
    both = members(hypotheses, "payload_mass", "rod_viscous_friction")
    part = refit_until_converged(hypotheses.objective, both[:1], {})
    stuck = refit(hypotheses.objective, both, {"M": 2.0 * RIG["M"], "Fv": 3.0 * RIG["Fv"]}, {}, steps=0)
    assert stuck.cost > part.cost
    tasks = [Task(both, {})]

    after = hypotheses.with_fits([part, stuck]).with_nested_refits(tasks, "sets")

    (fit,) = after.fits_of(tasks)
    assert fit.cost < part.cost
    assert fit.values["Fv"] == pytest.approx(RIG["Fv"], rel=0.02)
    assert after.with_nested_refits(tasks, "sets") is after


def test_an_effect_that_is_neutral_at_infinity_starts_where_it_was(hypotheses):
    """A stop beyond the stroke beside a wrong mass, whose own refit has found the right one."""
    (mass,) = members(hypotheses, "payload_mass")
    stop = next(c for c in hypotheses.candidates if c.id == "end_stop" and not np.isfinite(c.free[0].nominal))
    beyond = dict(zip(stop.names, stop.starts[0], strict=True)) | {stop.free[0].name: 10.0}
    part = refit_until_converged(hypotheses.objective, (mass,), {})
    stuck = refit(hypotheses.objective, (mass, stop), {**beyond, "M": 2.0 * RIG["M"]}, {}, steps=0)
    tasks = [Task((mass, stop), {})]

    after = hypotheses.with_fits([part, stuck]).with_nested_refits(tasks, "sets")

    (fit,) = after.fits_of(tasks)
    assert fit.cost < part.cost + 0.5
    assert np.isfinite(list(fit.values.values())).all()


def test_a_local_search_also_starts_without_the_largest_cause():
    """All the best sets may hold one cause that imitates another."""

    def scored(*causes):
        own = {(id, None): {"speed": gap} for id, gap in causes}
        return SimpleNamespace(causes=tuple(own), own_gaps=own, fit=object())

    best = scored(("torque_constant", 0.3), ("motor_friction", 0.1))
    second = scored(("torque_constant", 0.3), ("rod_friction", 0.1))
    other = scored(("motor_friction", 0.2))
    none = SimpleNamespace(causes=(), own_gaps={}, fit=object())

    assert _bases([best, second], [best, second, none, other]) == [best, second, other]
    assert _bases([best, other, second], [best, other, second]) == [best, other]
    assert _bases([], [none]) == []
