"""A headline says which data its figures are of, and has those of the table below it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ehsa_ctrl import load_plant
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.closed_loop_replay import ClosedLoopReplay
from ehsa_ctrl.diagnosis.diagnosis import MODELS, Cause, CauseParameter, Diagnosis, LogGap
from ehsa_ctrl.diagnosis.verdict_text import _law, advice, with_alternatives
from ehsa_ctrl.report.kinds._diagnosis_causes import parameter_rows


def found(verdict, held, whole, after=0.0):
    cause = Cause("internal_leakage", None, "flow", 0.98, {})
    gaps = {
        "nominal": {"speed": held / 2, "p1": held, "total": held},
        "with_effects": {"speed": after, "p1": after, "total": after},
    }
    return Diagnosis(
        load_plant("ehsa"), None, 0.03, verdict, (("flow", 1.0),) if verdict != "no_gap" else (),
        (cause,) if verdict in ("effect", "ambiguous", "partly") else (), gaps,
        {"speed": whole, "p1": whole / 2, "total": whole},
        "the last third of log.csv", {}, {}, {},
    )  # fmt: skip


@pytest.mark.parametrize("verdict", ["effect", "ambiguous", "outside_catalogue", "underdetermined"])
def test_a_gap_in_the_headline_is_that_of_the_table(verdict):
    """14.7 % of p1 on held-out data, whatever the whole log has."""
    text = str(found(verdict, 0.147, 0.161))

    assert "14.7 % in p1 on held-out data" in text.splitlines()[0] and "16.1" not in text
    assert "held-out data: the last third" in text and "gap there (%)" in text
    assert "place of the gap, over the whole log: flow 100 %" in text


@pytest.mark.parametrize(
    ("verdict", "models"),
    [
        ("effect", ["nominal", "refit", "with_effects", "upper_bound"]),
        ("partly", ["nominal", "refit", "with_effects", "upper_bound"]),
        ("outside_catalogue", ["nominal", "refit", "upper_bound"]),
        ("no_gap", ["nominal"]),
    ],
)
def test_the_text_has_the_models_that_a_verdict_uses(verdict, models):
    """Without a cause there is no model with it, and without a gap nothing is refitted: also of each of several logs,
    and in closed loop."""
    one = found(verdict, 0.147, 0.161)
    gap = {model: {"speed": 0.1, "total": 0.1} for model in MODELS}
    errors = dict.fromkeys(MODELS, 1e-3)
    t = np.array([0.0, 0.004])
    loop = ClosedLoopReplay("pid", 0, gap, gap, {"speed": 0.1, "total": 0.1}, errors, errors, 1e-3, 0.0, t, {}, {})
    log = Log(t, {"current": np.zeros(2)}, label="rest.csv")
    text = str(replace(one, gap=gap, closed_loop=loop, logs=(LogGap(log, gap, one.whole, {}, "", (), {}),)))
    words = [MODELS[model] for model in models]
    left_out = [MODELS[model] for model in MODELS if model not in models]

    assert [line[2:30].strip() for line in text.splitlines() if line[2:30].strip() in MODELS.values()] == 2 * words
    for begin in ("  rest.csv: total gap ", "  position error with pid (RMS): ", "  gap of the drive: "):
        (line,) = [line for line in text.splitlines() if line.startswith(begin)]
        assert all(each in line for each in words) and not any(each in line for each in left_out)


def test_a_number_that_the_log_does_not_determine_is_said_to_be_one():
    """In the text and on the page, in the place of an infinite deviation."""
    numbers = {"K_L": CauseParameter(8e-13, np.inf, "m3/(Pa s)"), "M": CauseParameter(90.0, 2.0, "kg")}
    one = found("effect", 0.147, 0.161)
    text = str(replace(one, effects=(replace(one.effects[0], parameters=numbers),)))
    rows = parameter_rows({"parameters": {"K_L": {"value": 8e-13, "sd": None, "unit": "m3/(Pa s)"}}})

    assert "K_L = 8e-13 m3/(Pa s), not determined by this log, M = 90 +- 2 kg" in text
    assert "(not determined)" in rows[0][1] and "±" not in rows[0][1]


def test_no_gap_is_said_of_the_whole_log():
    """That is what decides it; the held-out part may have less."""
    assert found("no_gap", 0.001, 0.021).sentence.startswith(
        "No relevant gap: the largest is 2.1 % in speed over the whole log, below the threshold of 3 %"
    )


def test_a_gap_that_only_the_whole_log_has_is_said_to_be_its_own():
    """The held-out third shows nothing."""
    assert found("effect", 0.01, 0.161).sentence.startswith("The gap (16.1 % in speed over the whole log) comes from")


def test_what_a_cause_closes_is_of_the_same_data():
    """All signals together, as in the column total."""
    assert "which closes 90 % of the total gap there." in found("effect", 0.2, 0.3, after=0.02).sentence


def test_what_is_closed_in_part_takes_the_refitted_values_too():
    """The improved plant has them beside the named effect."""
    sentence = found("partly", 0.2, 0.3, after=0.05).sentence

    assert (
        "comes from internal_leakage, which with the refitted nominal values closes 75 % of the total gap" in sentence
    )


def test_a_parameter_that_the_plant_lacks_has_no_nominal_value():
    """The stiffness of presliding is of a law that the nominal plant does not have; JSON says null."""
    log = Log(np.array([0.0, 0.004]), {"current": np.zeros(2)})
    parameters = {"sigma_0": CauseParameter(2e7, 1e5, "N/m"), "A_FR": CauseParameter(900.0, 5.0, "N")}
    cause = Cause("presliding", None, "force", 0.9, parameters)

    (effect,) = replace(found("effect", 0.1, 0.1), log=log, effects=(cause,)).to_dict()["effects"]

    assert effect["parameters"]["sigma_0"]["nominal"] is None
    assert effect["parameters"]["A_FR"]["nominal"] == 854.0


def test_several_logs_are_spoken_of_in_the_plural():
    """In the headline and below each cause."""
    log = Log(np.array([0.0, 0.004]), {"current": np.zeros(2)})
    one = found("ambiguous", 0.147, 0.161)
    cause = replace(one.effects[0], ambiguous_with=("orifice_leakage",))
    own = LogGap(log, one.gap, one.whole, {}, "the last third of log.csv", (), {})
    several = str(replace(one, effects=(cause,), logs=(own, own)))

    assert "; these logs can't separate these alternatives." in several.splitlines()[0]
    assert "    these logs can't separate it from orifice_leakage" in several and "this log" not in several
    assert "this log can't separate" in str(replace(one, effects=(cause,)))


@pytest.mark.parametrize(("closed", "words"), [(0.837, "84 % of the total gap"), (-0.12, "nothing of the total gap")])
def test_a_law_that_only_windows_show_closes_nothing(closed, words):
    """Not a negative share."""
    law = SimpleNamespace(beside=(), forms=[SimpleNamespace(gap_closed=closed)], words="c_1 * sin(c_m_1)")

    assert f"closes {words} on held-out data" in _law(SimpleNamespace(law=law, effects=(), explained=0.0))


def test_a_proposed_law_is_to_be_confirmed():
    """Whatever the verdict; without a law, the curve is what there is to look at."""
    system = load_plant("ehsa").structure.system

    for verdict in ("effect", "partly", "outside_catalogue"):
        assert "effects confirm" in advice(verdict, (), system, (), has_law=True)
    assert "the curve found there" in advice("outside_catalogue", (), system, (), has_curve=True)
    assert "no curve over" not in advice("partly", (), system, (), has_curve=True)
    assert "no curve over" in advice("outside_catalogue", (), system, ())
    assert advice("effect", (), system, ()) is None


def test_alternatives_are_told_apart_from_further_causes():
    """With brackets where there are several causes, and the channel is another one where the id is the same."""
    gain = Cause("torque_constant", None, "torque", 1.0, {}, ambiguous_with=("sensor_scale",))
    scale = Cause("sensor_scale", "speed", "sensor", 1.0, {}, ambiguous_with=("sensor_scale",))
    leak = Cause("internal_leakage", None, "flow", 1.0, {})

    assert with_alternatives([gain]) == "torque_constant or sensor_scale"
    assert with_alternatives([gain, leak]) == "(torque_constant or sensor_scale) and internal_leakage"
    assert with_alternatives([scale]) == "sensor_scale (speed) or sensor_scale of another channel"


@pytest.mark.parametrize(("probability", "words"), [(0.9, "comes from"), (0.1, "may come from")])
def test_an_improbable_part_may_be_one(probability, words):
    partly = found("partly", 0.2, 0.3, after=0.05)
    sentence = replace(partly, effects=(replace(partly.effects[0], probability=probability),)).sentence

    assert f"{words} internal_leakage" in sentence
