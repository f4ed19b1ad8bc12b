"""Keys of other benches, verdicts that name causes, intervals of sizes, calibration and the list of failures."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
LOGS = ROOT.parent / "shared" / "logs"

sys.path.append(str(ROOT / "benchmarks" / "withheld"))
import answer_score  # noqa: E402
import calibration  # noqa: E402
import failures  # noqa: E402
import law_score  # noqa: E402
import leave_one_out  # noqa: E402
import score_statistics  # noqa: E402
from effects import IDS  # noqa: E402
from effects_outside import OUTSIDE  # noqa: E402
from gap import SIGNALS  # noqa: E402
from key_formats import in_this_form, read_key  # noqa: E402


def changed(name, id, relative, alone, value=1.0):
    return {"name": name, "id": id, "relative": relative, "value": value, "alone": [alone] * 4}


def hard_row(**more):
    return {
        "family": "H1",
        "effects": ["external_leakage"],
        "effect_detail": [
            {
                "id": "external_leakage", "channel": None, "law": "external_leakage", "magnitude": 1e-15,
                "parameter": "K_e", "value": 1e-15, "alone": [0.0, 0.08, 0.09, 0.0],
            }
        ],
        "parameters": [
            changed("A_FR", "rod_friction", -0.15, 0.11, 730.0), changed("C_FR", "rod_friction", 0.1, 0.05, 230.0),
            changed("B_FR", "rod_viscous_friction", 0.1, 0.05, 9000.0),
        ],
        "minor": [changed("K_L", "internal_leakage", 0.1, 0.01)],
        "gap": [0.1, 0.2, 0.1, 0.1],
        "held_out_nominal": [0.1, 0.1, 0.1, 0.1],
        "held_out_truth": [0.02, 0.0, 0.0, 0.0],
        "loop": True,
        "force": False,
        **more,
    }  # fmt: skip


def named(verdict, *effects, closed=0.01):
    """effects: (id, probability, parameters, set); parameters: name -> (value, sd)."""
    return {
        "verdict": verdict,
        "where": [],
        "effects": [
            {
                "id": id,
                "channel": None,
                "probability": p,
                "ambiguous_with": list(same),
                "parameters": {name: {"value": v, "sd": sd} for name, (v, sd) in parameters.items()},
            }
            for id, p, parameters, same in effects
        ],
        "gap": {"nominal": {"total": 0.1}, "with_effects": {"total": closed}},
    }


def score(answer, row=None):
    return answer_score.score_answer("case", in_this_form(row or hard_row()), answer)


# Keys of other benches.


def test_nominal_parameters_are_causes_beside_the_effect():
    """Largest first; two parameters under one id are one cause; a stiffer viscous friction may be a line."""
    key = in_this_form(hard_row())

    assert [e["id"] for e in key["effects"]] == ["rod_friction", "external_leakage", "rod_viscous_friction"]
    assert key["effects"][0]["parameters"] == {"A_FR": 730.0, "C_FR": 230.0}
    assert {"id": "line_pressure_drop", "channel": None} in key["effects"][2]["accepted"]
    assert [e["id"] for e in key["below_threshold"]] == ["internal_leakage"]
    assert key["held_out"]["gap"]["truth"]["total"] == pytest.approx(0.01)
    assert key["verdict"] == "effect" and key["loop"] == "position" and not key["load_cell"]


def test_plain_ids_name_sensors_and_unknown_effects():
    """The channel stands in the name; what no id describes is outside the catalogue."""
    key = in_this_form({"effects": ["pressure_bias", "OUT_resonant_load"], "gap": [0.1, 0.2, 0.3, 0.4]})
    sensor, outside = key["effects"]

    assert sensor["id"] == "sensor_bias" and {a["channel"] for a in sensor["accepted"]} == {"p1", "p2"}
    assert outside["id"] == OUTSIDE and key["verdict"] == OUTSIDE
    assert in_this_form({"effects": [], "gap": [0.01] * 4})["verdict"] == "no_gap"


def test_a_row_of_this_bench_stays_as_it_is():
    row = {"effects": [], "held_out": {"gap": {}}, "verdict": "no_gap", "gap": {}, "family": "none"}

    assert in_this_form(row) == row


@pytest.mark.parametrize("folder", ["labelled", "withheld", "hard/labelled"])
def test_the_keys_at_hand_are_read(folder):
    """Every cause has an id of this bench or is outside; an answer with exactly the causes has no fault."""
    file = LOGS / folder / "key.json"
    if not file.exists():
        pytest.skip(f"{file} is not there")
    key = read_key(file)

    assert len(key) == len(json.loads(file.read_text()))
    for case in key.values():
        assert all(e["id"] in (*IDS, OUTSIDE) for e in case["effects"])
        effects = [{**e, "probability": 1.0, "parameters": {}} for e in case["effects"] if e["id"] != OUTSIDE]
        answer = {"verdict": case["verdict"], "where": [], "effects": effects}
        closes = case["held_out"]["gap"]
        if "truth" in closes:
            answer["gap"] = {"nominal": closes["nominal"], "with_effects": closes["truth"]}
        assert failures.faults(answer_score.score_answer("", case, answer)) == []


# Answers.


@pytest.mark.parametrize("verdict", ["effect", "ambiguous", "partly", "parameters"])
def test_verdicts_that_name(verdict):
    """The first effect counts as named whatever its probability; the others from 0.5 on."""
    row = score(
        named(
            verdict,
            ("rod_friction", 0.4, {}, []),
            ("external_leakage", 0.9, {}, []),
            ("line_pressure_drop", 0.4, {}, []),
            ("backlash", 0.6, {}, []),
        )
    )

    assert row.top_1 and (row.found, row.listed) == (2, 3)
    assert row.missed == ("rod_viscous_friction",) and row.wrong == ("backlash",)


def test_abstaining_names_only_what_is_certain():
    """Under outside_catalogue an effect with a probability of a half or more is a name, the first one below is none."""
    unsure = score(named("outside_catalogue", ("backlash", 0.3, {}, [])))
    sure = score(named("outside_catalogue", ("backlash", 0.7, {}, [])))

    assert unsure.wrong == () and sure.wrong == ("backlash",)
    assert not sure.top_1 and sure.missed == ("rod_friction", "external_leakage", "rod_viscous_friction")


def test_intervals_of_sizes_hold_the_truth_or_do_not():
    """1.96 standard deviations to either side, parameter by parameter; a size of another name does not count."""
    answer = named(
        "effect",
        ("rod_friction", 1.0, {"A_FR": (700.0, 16.0), "C_FR": (200.0, 15.0)}, []),
        ("line_pressure_drop", 1.0, {"R_lam": (1e9, 1.0)}, []),
    )
    row = score(answer)

    assert sorted(row.in_interval) == [False, True]
    assert figure([row], "Gap closed on held-out data", "95 % intervals of sizes").value == 0.5
    # null: a number that the log does not determine, whose interval holds anything.
    answer["effects"][0]["parameters"]["C_FR"]["sd"] = None
    assert score(answer).in_interval == (True,)


def figure(rows, heading, label):
    return next(f for f in score_statistics.sections(rows)[heading] if f.label.startswith(label))


def test_families_are_told_apart():
    """Quiet without a gap, no wrong name outside, all causes named elsewhere."""
    quiet = hard_row(family="H5", effect_detail=[], parameters=[])
    strange = hard_row(family="H6", parameters=[])
    strange["effect_detail"] = [{"id": "swirl", "law": "swirl", "alone": [0.1] * 4}]
    rows = [
        score(named("no_gap"), quiet),
        score(named("partly", ("backlash", 0.2, {}, [])), strange),
        score(named("effect", ("external_leakage", 0.9, {}, []), closed=0.03)),
    ]

    def of(label):
        return figure(rows, "By family", label).value

    assert of("H5: no gap, quiet") == 1.0 and of("H6: outside, no wrong name") == 0.0
    assert of("H1: first name right") == 1.0 and of("H1: every cause named") == 0.0
    assert of("H1: closes 95 %") == 0.0  # 70 % of the gap; the truth closes 90 %


# Calibration.


def test_calibrated_probabilities_have_no_calibration_error():
    """Ids listed with 0.8 that are causes in four of five cases; with 0.95 the error is 0.15."""
    one = hard_row(parameters=[])

    def rows(p):
        right = named("effect", ("external_leakage", p, {}, []))
        wrong = named("effect", ("backlash", p, {}, []))
        return [score(a, one) for a in (right, right, right, right, wrong)]

    for p, error in ((0.8, 0.0), (0.95, 0.15)):
        pairs = np.concatenate([calibration.listed(r) for r in rows(p)])
        (only,) = calibration.reliability(rows(p))

        assert calibration.calibration_error(pairs) == pytest.approx(error, abs=1e-12)
        assert only.low <= p <= only.high and (only.present.value, only.present.count) == (0.8, 5)


def test_errors_in_bins_do_not_cancel():
    """Half a bin too sure and half a bin too shy is an error, though the means agree over all."""
    pairs = np.array([[0.9, 1.0], [0.9, 0.0], [0.1, 0.0], [0.1, 1.0]])

    assert calibration.calibration_error(pairs) == pytest.approx(0.4)


def test_true_changes_below_the_threshold_do_not_count_against_a_probability():
    row = score(named("effect", ("internal_leakage", 0.9, {}, [])))

    assert row.minor == 1 and calibration.listed(row).size == 0


# Failures.


def test_failures_show_the_truth_beside_the_answer():
    """Missed causes, wrong names and the gap that stays open, each in words; a right answer is not listed."""
    key = in_this_form(hard_row())
    good = named(
        "effect", *((e["id"], 0.9, {k: (v, 1e-9) for k, v in e["parameters"].items()}, []) for e in key["effects"])
    )
    bad = named("effect", ("backlash", 0.8, {}, ["end_stop"]), closed=0.06)
    rows = [answer_score.score_answer(name, key, answer) for name, answer in (("good", good), ("bad", bad))]

    text = failures.failure_table(rows, {"good": key, "bad": key}, {"good": good, "bad": bad})

    assert text.startswith("**Failures: 1 of 2 cases**") and "| good |" not in text
    assert "external_leakage (9.0 % alone)" in text and "rod_friction (A_FR -15 %, C_FR +10 %, 11.0 % alone)" in text
    assert "effect: backlash or end_stop 0.80" in text
    assert "wrong name backlash; first name wrong; rod_friction missed; external_leakage missed" in text
    assert "closes 40 % of the gap, the truth 90 %" in text
    assert failures.faults(answer_score.score_answer("", key, None)) == ["no answer"]


def test_ids_beyond_the_benchs_own_count_in_the_calibration():
    """A name that the bench does not draw is false like any other; a drag of the rod stands for a turbulent line."""
    line = {"id": "line_pressure_drop", "law": "line_pressure_drop", "parameter": "R_turb", "value": 1e12}
    row = hard_row(parameters=[], effect_detail=[{**line, "alone": [0.1] * 4}])

    drag = score(named("effect", ("rod_drag", 0.9, {}, [])), row)
    strange = score(named("effect", ("swirl", 0.7, {}, [])), row)

    assert drag.top_1 and calibration.listed(drag).tolist() == [[0.9, 1.0]]
    assert strange.wrong == ("swirl",) and calibration.listed(strange).tolist() == [[0.7, 0.0]]


def test_an_effect_that_the_others_hide_is_no_cause():
    """To name it is neither right nor wrong; one that acts is missed where it is not named."""
    effects = [
        {"id": id, "channel": None, "law": "", "accepted": [], "parameters": {}, "alone": dict.fromkeys(SIGNALS, 0.2),
         "beside": dict.fromkeys(SIGNALS, beside)}
        for id, beside in (("pump_torque_loss", 0.2), ("end_stop", 0.0))
    ]  # fmt: skip
    key = {"effects": effects, "gap": dict.fromkeys(SIGNALS, 0.2), "held_out": {"gap": {}}, "family": "several"}

    seen, named_too, wrong = (
        answer_score.score_answer("", key, named("effect", *((id, 0.9, {}, []) for id in ids)))
        for ids in (["pump_torque_loss"], ["pump_torque_loss", "end_stop"], ["end_stop"])
    )

    assert (seen.truth, seen.missed, seen.wrong, seen.hidden) == (("pump_torque_loss",), (), (), 1)
    assert named_too.wrong == () and named_too.missed == ()
    assert wrong.missed == ("pump_torque_loss",) and not wrong.top_1


def test_as_much_as_the_truth_closes_with_other_noise_is_counted_beside():
    """60 % of 95 % is too little, but no more can be asked of a log in which the truth itself repeats 50 %."""
    gap = {"nominal": {"total": 0.1}, "truth": {"total": 0.005}, "repeated": {"total": 0.05}}
    key = {**in_this_form(hard_row()), "held_out": {"gap": gap}}

    row = answer_score.score_answer("", key, named("effect", ("rod_friction", 0.9, {}, []), closed=0.04))

    assert not score_statistics.closes(row) and score_statistics.repeats(row)
    assert "closes 60 % of the gap, the truth 95 %, 50 % with other input noise" in failures.faults(row)


LEFT_OUT_KEY = {
    "effects": [{"id": "relief_valve", "law": "to the tank"}],
    "held_out": {"gap": {"nominal": {"total": 0.2}, "truth": {"total": 0.01}}},
}


def left_out_answer(law, left, *named):
    gaps = {"nominal": {"p1": 0.2, "total": 0.2}, "with_effects": {"p1": left, "total": left}}
    effects = [{"id": id} for id in named]
    return {"law": law, "effects": effects, "seconds": 9.0, "gap": {**gaps, "with_law": {"p1": 0.02, "total": 0.02}}}


def test_an_effect_that_is_left_out_is_scored_by_its_law():
    """Right; a law of another form; nothing; and a case that the rest of the catalogue explains."""
    valve = law_answer("flow_1", ["P_1"], "c_1 * max(P_1 - c_at_1, 0)")["law"]
    other = law_answer("flow_1", ["P_1"], "c_1 * P_1 * abs(P_1)")["law"]
    answers = [left_out_answer(valve, 0.1), left_out_answer(other, 0.1), left_out_answer(None, 0.1)]
    answers.append(left_out_answer(None, 0.02, "external_leakage"))
    rows = [leave_one_out.score_answer("relief_valve", LEFT_OUT_KEY, one) for one in answers]
    shown = leave_one_out.table(rows)

    assert [row.right_form for row in rows] == [True, False, False, False]
    assert [row.needs_none for row in rows] == [False, False, False, True]
    assert rows[0].enough and rows[0].closable == pytest.approx(0.95)
    assert "form right or in a set of 3: 1 of 3" in shown and "leaves less than 3 %: 1 of 4" in shown
    assert leave_one_out.options_of("relief_valve")[1::2] == ["relief_valve", "relief_hysteresis"]


def test_every_effect_that_is_left_out_is_drawn_and_its_form_can_be_read():
    """Ids of the bench, and regular expressions that the tool's own wording of a constant fits."""
    assert set(leave_one_out.REMOVED) <= set(IDS)
    constant = leave_one_out.REMOVED["constant_force"].truth
    found = law_answer("force", [], "c_1 + c_2 * d_R")["law"]

    assert constant.form_in(found)
    assert not constant.form_in(law_answer("force", ["x"], "c_1 * x + c_2 * d_R")["law"])


def test_a_small_change_of_one_sensor_excuses_no_other_channel():
    """A filter of p1 that is there but does not matter is a minor name; one of the position is a wrong one."""
    filters = [{**changed("lag_p", "sensor_filter", None, 0.01), "channel": "p1"}]
    answer = named("effect", ("external_leakage", 0.9, {}, []), ("sensor_filter", 0.9, {}, []))

    def with_channel(channel):
        answer["effects"][1]["channel"] = channel
        return score(answer, hard_row(parameters=[], minor=filters))

    assert (with_channel("p1").minor, with_channel("p1").wrong) == (1, ())
    assert (with_channel("position").minor, with_channel("position").wrong) == (0, ("sensor_filter",))


def law_answer(place, variables, expression, closed=0.9):
    forms = [{"expression": expression, "gap_closed": closed}]
    return {"law": {"place": place, "variables": variables, "forms": forms}, "seconds": 9.0}


def law_key(law):
    gaps = {"nominal": {"total": 0.2}, "truth": {"total": 0.01}}
    return {"effects": [{"id": "outside_catalogue", "law": law}], "held_out": {"gap": gaps}}


def test_a_law_is_scored_by_variable_form_and_gap():
    """A leak that grows with time; a right variable under a wrong form; a law where no expression is right."""
    grown = law_answer("pump_flow", ["(P_1 - P_2)", "time"], "c_1 * (P_1 - P_2) * c_m_1; d c_m_1/dt = 1")
    static = law_answer("flow_1", ["P_1", "time"], "c_1 * P_1 * (1 - exp(-c_m_1 / c_tau_1)); d c_m_1/dt = 1", 0.5)
    right, wrong = (law_score.score_law("a", law_key("leak_growth"), one) for one in (grown, static))
    made_up = law_score.score_law("b", law_key("mains"), static)
    nothing = law_score.score_law("c", {"effects": []}, {"law": None, "seconds": 1.0})

    assert right.right_variable and right.right_form and right.enough
    assert wrong.right_variable and not wrong.right_form and not wrong.enough
    assert made_up.right_form is None and made_up.proposed and not nothing.proposed
    valve = law_score.score_law(
        "d", {"effects": [{"id": "relief_valve", "law": "to the tank"}]}, {**grown, "law": None}
    )
    shown = law_score.table([right, wrong, made_up, nothing, valve])
    assert "nothing proposed where no expression is right: 1 of 2" in shown and "| d | relief_valve | no |" in shown
    assert "nothing proposed without a gap: 1 of 1" in shown
