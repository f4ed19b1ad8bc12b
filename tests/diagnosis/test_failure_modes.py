"""What a naive search gets wrong, and this one must not."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.candidate_effects import candidate_effects
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel, with_every_effect
from ehsa_ctrl.diagnosis.hypothesis_search import MIN_GAIN, Hypotheses
from ehsa_ctrl.diagnosis.objective import TEMPER, objective_of
from ehsa_ctrl.diagnosis.pool import Pool
from ehsa_ctrl.diagnosis.records import Record, Segment
from ehsa_ctrl.diagnosis.screening import Response, Screening
from ehsa_ctrl.diagnosis.signals import estimate_noise
from ehsa_ctrl.physics.effects import CandidateEffect, Effect, FreeNumber


@pytest.fixture(scope="module")
def screened():
    """A rig whose numbers are all slightly different from nominal and that has no effect, after the screening."""
    plant = ehsa_ctrl.load_plant("ehsa")
    off = {"J_M": 1.03, "A_FM": 0.99, "B_FM": 1.01, "K_L": 1.1, "M": 1.03, "A_FR": 1.01, "B_FR": 0.99, "C_FR": 1.05}
    rig = plant.set(**{name: factor * plant[name] for name, factor in off.items()})
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=8.0, seed=4)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=5, centre=True)
    model = HypothesisModel(with_every_effect(plant), log)
    objective, sensitivities = objective_of(Segment((Record(model, estimate_noise(log)),), ""), 0.03)
    hypotheses = Hypotheses.initial(objective, candidate_effects(model), sensitivities, Pool())
    return hypotheses, hypotheses.screening()


@pytest.mark.slow
def test_wrong_numbers_of_the_plant_look_like_no_effect(screened):
    """Without the nominal parameters following, some effect would explain a good part of what they do; with them next
    to nothing is left for it."""
    hypotheses, screening = screened
    r, own = hypotheses.residual, set(hypotheses.objective.nominal.names)
    others = [x for x in screening.responses if not own & set(x.candidate.names)]
    sensitivities = [c for x in others for c in x.sensitivities.values() if c.any()]
    naive = max(TEMPER * float(r @ column) ** 2 / float(column @ column) for column in sensitivities)
    projected = max(
        gain.decrease for gain in screening.gains(hypotheses.nominal) if not own.intersection(gain.candidate.names)
    )

    assert naive > 10.0 * MIN_GAIN
    assert projected < MIN_GAIN


@pytest.mark.slow
def test_a_placebo_gains_nothing(screened):
    """A response that has nothing to do with the rig takes away what chance does, at most."""
    hypotheses, screening = screened
    rng = np.random.default_rng(0)
    base = screening.responses[0].base
    responses = []
    for k in range(20):
        effect = Effect(f"placebo_{k}", "torque", "", "")
        candidate = CandidateEffect(effect, (FreeNumber(effect.name, 0.0, 1.0),), ((0.0,),))
        column = rng.standard_normal(hypotheses.residual.size)
        responses.append(Response(candidate, {effect.name: 0.0}, base, {effect.name: column}))

    assert max(gain.decrease for gain in Screening.of(responses, base).gains(hypotheses.nominal)) < 2.0
