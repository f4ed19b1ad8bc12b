"""What a naive search gets wrong, and this one must not."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.fit import TEMPER, Bench, Metric, Nominal
from ehsa_ctrl.diagnosis.search import WORTH_GROWING, Response, Search
from ehsa_ctrl.diagnosis.signals import noise_of
from ehsa_ctrl.diagnosis.suspect import Free, Suspect
from ehsa_ctrl.diagnosis.suspects import suspects
from ehsa_ctrl.diagnosis.twin import Twin, with_every_effect


@pytest.fixture(scope="module")
def screened():
    """A rig whose numbers are all a little other than believed and that does nothing else, after the screening."""
    plant = ehsa_ctrl.load_plant("ehsa")
    off = {"J_M": 1.03, "A_FM": 0.99, "B_FM": 1.01, "K_L": 1.1, "M": 1.03, "A_FR": 1.01, "B_FR": 0.99, "C_FR": 1.05}
    rig = plant.set(**{name: factor * plant[name] for name, factor in off.items()})
    time, current = ehsa_ctrl.excitation("noise", amplitude=3.0, duration=8.0, seed=4)
    log, _ = ehsa_ctrl.record(rig, time, current, seed=5, centre=True)
    twin = Twin(with_every_effect(plant), log)
    metric = Metric.of(twin, noise_of(log))
    nominal, columns = Nominal.of(twin, metric, 0.03)
    search = Search(Bench(twin, metric, nominal), suspects(twin), columns, jobs=2)
    search.respond()
    return search


@pytest.mark.slow
def test_wrong_numbers_of_the_plant_look_like_no_effect(screened):
    """Without the nominal parameters following, some effect would explain a good part of what they do; with them next
    to nothing is left for it."""
    r, own = screened.residual, set(screened.bench.nominal.names)
    columns = [c for x in screened.responses if not own & set(x.suspect.names) for c in x.columns.values() if c.any()]
    naive = max(TEMPER * float(r @ column) ** 2 / float(column @ column) for column in columns)
    projected = max(gain for gain, x, _ in screened.gains() if not own & set(x.suspect.names))

    assert naive > 10.0 * WORTH_GROWING
    assert projected < WORTH_GROWING


@pytest.mark.slow
def test_a_placebo_gains_nothing(screened):
    """A response that has nothing to do with the rig takes away what chance does, at most."""
    rng = np.random.default_rng(0)
    like = screened.responses[0]
    names = [f"placebo_{k}" for k in range(20)]
    responses = [
        Response(
            Suspect(name, "torque", (Free(name, 0.0, 1.0),), ((0.0,),)),
            {name: 0.0},
            like.base,
            {name: rng.standard_normal(screened.residual.size)},
        )
        for name in names
    ]
    search = replace(
        screened,
        responses=responses,
        columns=np.column_stack([column for x in responses for column in x.columns.values()]),
        shifts=np.zeros((screened.residual.size, len(responses))),
    )

    assert max(gain for gain, *_ in search.gains()) < 2.0
