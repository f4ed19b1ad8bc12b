"""The verdict from hypotheses made by hand: what is named, what can't be excluded, when to abstain."""

from types import SimpleNamespace

import pytest

from ehsa_ctrl.diagnosis.model_selection import Reference, select_model
from ehsa_ctrl.diagnosis.scoring import LowFrequencyError, ScoredHypothesis

NOTHING = (LowFrequencyError(), LowFrequencyError())
GAPS = {"speed": 0.1, "total": 0.1}


def hypothesis(evidence, *ids, gap=0.005, own=0.1, numbers=1, chi=0.86, slow=NOTHING):
    """A hypothesis whose members all matter; noise alone leaves a chi of 0.86 and nothing that is slow."""
    keys = tuple((id, None) for id in ids)
    candidates = tuple(SimpleNamespace(key=key, free=[None] * numbers) for key in keys)
    gaps = {"speed": gap, "total": gap}
    return ScoredHypothesis(
        SimpleNamespace(candidates=candidates, rms=chi),
        evidence,
        {k: {"speed": own} for k in keys},
        gaps,
        gaps,
        keys,
        slow,
    )


def verdict(*scores, least=5000.0, most=60000.0):
    """Verdict of hypotheses, with the ids of the chosen one."""
    found = select_model(scores, Reference(least, most, 0.1, 0.74))
    return found.verdict, {id for id, _ in found.chosen.causes}, found


def misfits(*scores):
    """Whether the chosen hypothesis leaves more than noise explains."""
    return verdict(*scores)[2].misfit > 1.0


def test_a_clear_winner_is_named():
    """It explains all that is not noise, its alternative clearly less."""
    word, ids, found = verdict(hypothesis(5000.0, "internal_leakage"), hypothesis(9000.0, "orifice_leakage"))

    assert (word, ids) == ("effect", {"internal_leakage"})
    assert found.probability["internal_leakage", None] > 0.99


def test_alternatives_that_explain_as_much_are_a_set():
    """The one with fewer free numbers comes first though it is a little worse."""
    word, ids, found = verdict(
        hypothesis(5000.0, "chamber_volume_variation", numbers=3), hypothesis(5060.0, "bulk_modulus")
    )

    assert (word, ids) == ("ambiguous", {"bulk_modulus"})
    assert found.alternatives["bulk_modulus", None] == (("chamber_volume_variation", None),)
    assert 0.2 < found.probability["bulk_modulus", None] < 0.8


def test_a_gap_above_one_counts_as_that_of_a_model_that_stands_still():
    """In margins and shares; a nominal model that runs away would make all causes alike."""
    still, runs_away = Reference(10.0, 1010.0, 1.0, 0.74), Reference(10.0, 16010.0, 4.0, 0.74)
    one = hypothesis(110.0, "internal_leakage")

    assert runs_away.capped_nominal == still.capped_nominal == still.nominal == 1010.0
    assert runs_away.margin(one) == still.margin(one) == pytest.approx(12.0 + 0.3 * 100.0 + 0.004 * 900.0)
    assert runs_away.unexplained_share(one) == still.unexplained_share(one) == pytest.approx(0.1)


def test_a_second_cause_has_to_be_worth_it():
    """A pair that fits better by what a missed slip makes is not two causes; one that closes the gap is."""
    single = hypothesis(5600.0, "rotor_inertia", gap=0.010)
    idle = hypothesis(5500.0, "rotor_inertia", "rod_friction", gap=0.009)
    real = hypothesis(5000.0, "rotor_inertia", "rod_friction", gap=0.002)
    poor = hypothesis(20000.0, "rotor_inertia", gap=0.05)

    assert verdict(single, idle)[1] == {"rotor_inertia"}
    assert verdict(poor, real)[1] == {"rotor_inertia", "rod_friction"}


def test_a_larger_set_is_not_chosen_over_one_that_explains_as_much():
    """Four causes are clearly better than one, and two are not; but four are not clearly better than two."""
    one = hypothesis(5600.0, "rotor_inertia", gap=0.030)
    two = hypothesis(5450.0, "rotor_inertia", "rod_friction", gap=0.012)
    four = hypothesis(5400.0, "rotor_inertia", "torque_constant", "load_spring", "payload_mass", gap=0.010)

    assert len(verdict(one, two, least=5400.0)[1]) == 1
    assert len(verdict(one, four, least=5400.0)[1]) == 4
    assert len(verdict(one, two, four, least=5400.0)[1]) == 2


def test_a_set_that_leaves_a_much_larger_gap_is_left_out():
    """The robust loss counts large errors in few blocks for little, the gap counts them in full."""
    few_blocks = hypothesis(5000.0, "windage", "drive_lag", gap=0.12)
    right = hypothesis(5140.0, "line_pressure_drop", "drive_lag", gap=0.02)
    single = hypothesis(5140.0, "line_pressure_drop", gap=0.02)

    _, ids, found = verdict(few_blocks, right, least=4000.0)

    assert ids == {"line_pressure_drop", "drive_lag"}
    assert ("windage", None) not in found.probability
    assert found.alternatives["line_pressure_drop", None] == ()
    assert found.ranked == (few_blocks, right)
    assert verdict(few_blocks, single, least=4000.0)[1] == {"line_pressure_drop"}


def test_no_set_wins_because_a_better_one_is_left_out():
    """The set that takes the place of another one is that which leaves the smaller gap, not a third one."""
    few_blocks = hypothesis(5000.0, "windage", "drive_lag", gap=0.12)
    single = hypothesis(6500.0, "windage", gap=0.13)
    right = hypothesis(9000.0, "line_pressure_drop", "rod_friction", gap=0.02)

    assert verdict(few_blocks, single, right)[1] == {"line_pressure_drop", "rod_friction"}


@pytest.mark.parametrize(
    "other",
    [
        hypothesis(5140.0, "line_pressure_drop", "drive_lag", gap=0.05),
        hypothesis(5140.0, "line_pressure_drop", "drive_lag", "rod_friction", gap=0.02),
        hypothesis(5140.0, gap=0.02),
    ],
    ids=["less than half", "larger", "no cause"],
)
def test_the_deviance_decides_between_sets_whose_gaps_are_alike(other):
    """So it does where the set that leaves less has more causes, or none."""
    best = hypothesis(5000.0, "windage", "drive_lag", gap=0.12)

    assert verdict(best, other)[1] == {"windage", "drive_lag"}


def test_gaps_far_below_the_threshold_leave_no_set_out():
    """There noise decides which is a third of the other."""
    best = hypothesis(5000.0, "bulk_modulus", gap=0.006)

    assert verdict(best, hypothesis(5140.0, "hose_wall", gap=0.001))[1] == {"bulk_modulus"}


def test_what_none_explains_is_a_misfit():
    """The best leaves nearly half of the gap, and residuals half as large again as noise."""
    assert misfits(hypothesis(17000.0, "motor_friction", gap=0.045, chi=1.3))


@pytest.mark.parametrize(("gap", "chi"), [(0.035, 0.88), (0.01, 1.3)])
def test_one_sign_alone_is_no_misfit(gap, chi):
    """A gap that noise makes leaves no residual beyond it; a form that is a little other leaves no gap."""
    assert not misfits(hypothesis(5200.0, "motor_friction", gap=gap, chi=chi))


@pytest.mark.parametrize(
    ("slow", "misfit"),
    [
        ((LowFrequencyError(0.1, 2.0), LowFrequencyError()), True),
        ((LowFrequencyError(), LowFrequencyError(0.5, 3.0)), True),
        ((LowFrequencyError(0.1, 0.3), LowFrequencyError(0.5, 0.5)), False),
        ((LowFrequencyError(0.02, 2.0), LowFrequencyError(0.1, 3.0)), False),
    ],
)
def test_a_relative_leaves_what_is_slow(slow, misfit):
    """It closes the gap but for some per cent, which stand out of the noise in means; small shares or sizes do not."""
    assert misfits(hypothesis(5200.0, "motor_friction", slow=slow)) is misfit


def test_what_noise_of_the_current_makes_is_no_sign():
    """A gap that the noise of the logged current alone leaves is left by the truth too."""
    lost = hypothesis(5200.0, "motor_friction", gap=0.045, chi=1.3)

    def misfit(input_noise):
        return select_model([lost], Reference(5000.0, 60000.0, 0.1, 0.74, ({"total": input_noise}, {}))).misfit

    assert misfit(0.0) > 1.0 > misfit(0.044)


def test_a_crowd_is_underdetermined():
    """Five causes that explain the log alike: it does not excite what tells them apart."""
    names = ("torque_constant", "motor_friction", "motor_viscous_friction", "torque_saturation", "pump_torque_loss")

    assert verdict(*(hypothesis(5000.0 + i, name) for i, name in enumerate(names)))[0] == "underdetermined"


def test_nothing_that_matters_alone_is_underdetermined():
    """Several parameters a little wrong make a gap that none of them makes."""
    nothing = ScoredHypothesis(SimpleNamespace(candidates=(), rms=0.86), 5000.0, {}, GAPS, GAPS, ())

    assert verdict(nothing)[0] == "underdetermined"


def test_what_nothing_touches_is_a_misfit():
    """No effect matters, and all of the gap is left with residuals far beyond noise."""
    nothing = ScoredHypothesis(SimpleNamespace(candidates=(), rms=3.0), 50000.0, {}, GAPS, GAPS, ())

    assert misfits(nothing)
