"""Tuning of any kind by its keys."""

import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.files import read_toml
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.specification import definition_keys, design, starting_definition
from ehsa_ctrl.design.tuning.constraints import Tuning
from ehsa_ctrl.design.tuning.keys import tune_keys
from ehsa_ctrl.design.tuning.tune import tune

BOUNDS = Tuning(Ms=1.4, Mt=1.4, disk_margin=0.8, noise_gain="8000 A/m")


@pytest.fixture(scope="module")
def model():
    return ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear"))


def tuned(kind, model, bounds=BOUNDS, **given):
    chosen, path = starting_definition(kind)
    return design("mine", chosen, read_toml(path), model, tuning=bounds, **given)


@pytest.mark.parametrize("kind", [name for name, kind in CONTROLLER_KINDS.items() if kind.tunes])
def test_what_a_kind_tunes_are_keys_of_its_form(kind):
    chosen = CONTROLLER_KINDS[kind]

    assert set(chosen.tunes) <= set(definition_keys(chosen.file))
    assert all(0 < low < high for _, low, high in chosen.tunes.values())


def test_the_bounds_hold_on_the_exact_loop_and_one_is_active(model):
    """By the loop analysis, which shares no frequency grid with the search."""
    loop = tuned("sliding_mode", model).loop

    assert loop.stable and loop.disk_margin > 0.8 * 0.999
    assert loop.Ms < 1.4 * 1.001 and loop.Mt < 1.4 * 1.001 and loop.noise_gain["position"] < 8000 * 1.001
    assert loop.Ms > 1.39 or loop.Mt > 1.39 or loop.noise_gain["position"] > 7900


def test_a_key_that_is_given_stays(model):
    found = tuned("adrc", model, values={"adrc.observer_ratio": "3"})

    assert found.content["adrc"]["observer_ratio"] == 3
    assert found.controller.law.w_o == pytest.approx(3.0 * found.controller.law.w_c)


@pytest.mark.slow
def test_it_finds_what_the_tuner_of_a_pid_finds(model):
    """Other parameters, other starts, the same problem: the criterion agrees within 5 %."""
    peer = tune(model, BOUNDS, sample_time=0.004)
    chosen, _ = starting_definition("pid")
    limits = {key: span[1:] for key, span in chosen.tunes.items()}

    def build(values):
        table = {key.removeprefix("design."): value for key, value in values.items()}
        return ehsa_ctrl.load_controller(
            {"kind": "pid", "current_limit": 6.0, "sample_time": 0.004, "design": table}, model
        )

    mine = tune_keys(build, limits, model, BOUNDS, sample_time=0.004, budget=600)
    assert mine.objective == pytest.approx(peer.objective, rel=0.05)


def test_the_budget_is_kept_and_the_result_is_reproducible(model):
    def build(values):
        calls.append(values)
        table = {"bandwidth": values["w"], "disturbance": 0.6}
        content = {"kind": "sliding_mode", "current_limit": 6.0, "sample_time": 0.004, "sliding_mode": table}
        return ehsa_ctrl.load_controller(content, model)

    calls = []
    found = [tune_keys(build, {"w": (5.0, 100.0)}, model, BOUNDS, sample_time=0.004, budget=90) for _ in range(2)]

    assert found[0] == found[1]
    assert found[0].evaluations <= 90 and len(calls) == 2 * found[0].evaluations


def test_what_can_not_be_reached_is_one_sentence(model):
    with pytest.raises(InputError, match=r"no values satisfy .*Ms at most 1\.01.*; the nearest, .*: relax the bounds"):
        tuned("adrc", model, Tuning(Ms=1.01))
    with pytest.raises(InputError, match=r"a force has no keys that are tuned; kinds with some: .*adrc"):
        tuned("force", model)
    with pytest.raises(InputError, match="no key left to tune"):
        tuned("adrc", model, values={"adrc.observer_ratio": "3", "adrc.bandwidth": "20 rad/s"})
