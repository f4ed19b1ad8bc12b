"""The PID: its forms, its law, anti-windup, start, schedule."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ehsa_ctrl
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.analysis.operating_point import operating_point
from ehsa_ctrl.design.controller import SampledController
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.kinds.pid import Gains, Pid, PidFile, PidGains
from ehsa_ctrl.design.kinds.scheduled_pid import ScheduledFile
from ehsa_ctrl.design.load import build_controller

T_S = 0.004
HEAD = {"schema": 1, "title": "under test", "current_limit": "6 A"}
positive = st.floats(0.01, 100.0)
#: Of a schedule.
ROWS = [{"at": "-50 mm", "gains": {"k_p": "100 A/m", "k_i": "500 A/(m s)", "k_d": "4 A s/m", "T_f": "4 ms"}}] + [
    {"at": "50 mm", "gains": {"k_p": "300 A/m", "k_i": "900 A/(m s)", "k_d": "8 A s/m", "T_f": "8 ms"}}
]


@pytest.fixture
def model(linear):
    return ehsa_ctrl.three_state(linear)


def controller(model, kind="pid", **content):
    form = CONTROLLER_KINDS[kind].file
    return build_controller("mine", CONTROLLER_KINDS[kind], form.model_validate(HEAD | {"kind": kind} | content), model)


def pid(gains, b=1.0, c=0.0, limit=6.0, T_t=np.inf, conditional=False):
    return Pid(gains, b, c, limit, T_t, conditional, T_S)


def run(law, reference, measured, extra=0.0, hold=0.0):
    """Currents (N,) of a law for references and positions (N,), and its integral after each sample."""
    memory, numbers = law.initial_memory(), law.settings()
    currents, integrals = [], []
    for r, y in zip(reference, measured, strict=True):
        row, read = np.array([r, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, y, 0.0])
        currents.append(law.function(row, read, memory, numbers, extra, hold))
        integrals.append(memory[law.traces["integral"]])
    return np.array(currents), np.array(integrals)


# Forms


def gains_of(form, **values):
    """The parallel gains of a [gains] table."""
    units = {"K": "A/m", "T_i": "s", "T_d": "s", "T_f": "s"}
    table = {"form": form, **{key: f"{value!r} {units[key]}" for key, value in values.items()}}
    return validate(table, PidGains, "mine.toml").parallel()


@settings(max_examples=50, deadline=None)
@given(positive, positive, positive, positive)
def test_the_three_forms_have_one_response(K, T_i, T_d, T_f):
    """The parallel gains of the standard and the series form have the response that the module's head writes."""
    s = 1j * np.geomspace(1e-3, 1e3, 50)
    derivative = s / (1 + T_f * s)
    written = {
        "standard": K * (1 + 1 / (T_i * s) + T_d * derivative),
        "series": K * (1 + 1 / (T_i * s)) * (1 + T_d * derivative),
    }
    for form, response in written.items():
        g = gains_of(form, K=K, T_i=T_i, T_d=T_d, T_f=T_f)
        assert np.allclose(g.k_p + g.k_i / s + g.k_d * s / (1 + g.T_f * s), response, rtol=1e-9)


def test_forms_without_integral_action():
    assert gains_of("series", K=3.0, T_d=0.5, T_f=0.1) == Gains(3.0, 0.0, 1.5, 0.1)
    assert gains_of("standard", K=3.0, T_d=0.5, T_f=0.1) == Gains(3.0, 0.0, 1.5, 0.1)


def test_a_toml_in_any_form_is_the_same_controller(model):
    series = controller(model, gains={"form": "series", "K": "300 A/m", "T_i": "0.4 s", "T_d": "50 ms", "T_f": "4 ms"})
    g = series.law.gains
    same = controller(
        model,
        gains={"k_p": f"{g.k_p} A/m", "k_i": f"{g.k_i} A/(m s)", "k_d": f"{g.k_d} A s/m", "T_f": "4 ms"},
    )

    assert g.k_p == pytest.approx(300 * (1 + 0.05 / 0.4))
    assert np.allclose(series.settings(), same.settings())


# Law


def test_the_step_response_is_the_closed_form():
    """P and I: a ramp of the error's sum; D: b r - y filtered by T_f / (T_f + T_s)."""
    g = Gains(10.0, 50.0, 2.0, 0.01)
    r, k = 1e-3, np.arange(40)

    currents, _ = run(pid(g, b=0.7, c=0.4, limit=1e9), np.where(k > 0, r, 0.0), np.zeros(40))

    share = g.T_f / (g.T_f + T_S)
    expected = g.k_p * 0.7 * r + g.k_i * T_S * (k - 1) * r + 0.4 * r * g.k_d / (g.T_f + T_S) * share ** (k - 1)
    assert np.allclose(currents[1:], expected[1:], rtol=1e-12)


def test_the_linear_law_is_the_law_without_limit():
    import control

    rng = np.random.default_rng(1)
    r, y = rng.normal(0, 1e-3, (2, 200))
    r[0] = y[0] = 0.0
    law = pid(Gains(400.0, 1500.0, 20.0, 0.003), b=0.6, c=0.2, limit=1e9)

    currents, _ = run(law, r, y)

    inputs = np.zeros((8, 200))
    inputs[0], inputs[6] = r, y
    assert np.allclose(control.forced_response(law.linear(), inputs=inputs).outputs[0], currents, atol=1e-9)


def test_the_response_of_the_gains_is_that_of_the_linear_law():
    g = Gains(400.0, 1500.0, 20.0, 0.003)
    z = np.exp(1j * np.geomspace(1e-3, 3.1, 30))

    law = np.array([pid(g).linear()(point)[0, 6] for point in z])

    assert np.allclose(-law, g.response(z, T_S), rtol=1e-9)


def test_no_kick_at_the_start_wherever_the_rod_is():
    """With any weights the first currents are those of a loop that rests: zero."""
    law = pid(Gains(400.0, 1500.0, 20.0, 0.003), b=0.3, c=0.5)

    currents, _ = run(law, np.full(20, 0.05), np.full(20, 0.05))

    assert np.allclose(currents, 0.0, atol=1e-12)


def test_the_integral_stands_still_while_it_is_held():
    _, held = run(pid(Gains(400.0, 1500.0)), np.full(20, 1e-3), np.zeros(20), hold=1.0)
    _, free = run(pid(Gains(400.0, 1500.0)), np.full(20, 1e-3), np.zeros(20))

    assert np.all(held == held[0])
    assert free[-1] > free[0]


# Anti-windup


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.booleans(), st.floats(-1.0, 1.0))
def test_conditional_integration_never_goes_further_into_the_limit(seed, slow, extra):
    rng = np.random.default_rng(seed)
    error = np.cumsum(rng.normal(0, 5e-3, 300)) if slow else rng.normal(0, 0.02, 300)
    law = pid(Gains(400.0, 8000.0, 5.0, 0.01), limit=2.0, conditional=True)

    currents, integrals = run(law, error, np.zeros(300), extra=extra)

    change = np.diff(integrals, prepend=0.0)
    assert np.all(change[currents >= 2.0] <= 0.0)
    assert np.all(change[currents <= -2.0] >= 0.0)
    assert np.any(np.abs(currents) == 2.0)


def test_back_calculation_brings_the_wanted_current_to_its_balance():
    """With a constant error e the excess over the limit tends to T_t k_i e instead of growing without bound."""
    T_t, e = 0.05, 0.1
    law = pid(Gains(100.0, 400.0), limit=1.0, T_t=T_t)

    _, integrals = run(law, np.full(2000, e), np.zeros(2000))
    _, runaway = run(pid(Gains(100.0, 400.0), limit=1.0), np.full(2000, e), np.zeros(2000))

    assert 100.0 * e + integrals[-1] - 1.0 == pytest.approx(T_t * 400.0 * e, rel=1e-6)
    assert runaway[-1] == pytest.approx(2000 * T_S * 400.0 * e)


def overshoot(plant, chosen, amplitude):
    reference = np.zeros((1200, 3))
    reference[5:, 0] = amplitude
    return ehsa_ctrl.run_closed_loop(plant, chosen, reference).trajectory["x"].max() / amplitude - 1.0


def test_anti_windup_takes_away_the_overshoot_that_saturation_adds(linear, model):
    """Ways of a linear plant that saturates heavily; without a limit the overshoot is that of the linear loop."""
    gains = {"k_p": "393 A/m", "k_i": "3000 A/(m s)", "k_d": "25 A s/m", "T_f": "3.6 ms"}
    found = {
        way: overshoot(linear, controller(model, gains=gains, current_limit="2 A", anti_windup=way), 0.05)
        for way in ("back_calculation", "conditional", "none")
    }
    free = overshoot(linear, controller(model, gains=gains, current_limit="1000 A"), 0.05)

    assert found["none"] > free + 0.2
    assert found["back_calculation"] < free
    assert found["conditional"] < free


# In the house


@pytest.mark.parametrize(("crossover", "margin"), [(20.0, 70.0), (35.0, 60.0), (45.0, 45.0)])
def test_the_classic_design_has_exactly_what_was_asked_for(model, crossover, margin):
    chosen = controller(model, design={"crossover": f"{crossover} rad/s", "phase_margin": f"{margin} deg"})

    loop = analyse_loop(model, chosen)

    assert loop.stable
    assert loop.crossover == pytest.approx(crossover, rel=1e-4)
    assert loop.phase_margin == pytest.approx(margin, abs=0.01)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({}, r"expected one of the tables \[design\], \[tuning\] and \[gains\]; got none"),
        ({"gains": {"k_p": "1 A/m"}, "tuning": {}}, "got tuning and gains"),
        ({"gains": {"k_p": "-1 A/m"}}, "k_p = -1; expected at least 0"),
        ({"gains": {"k_p": 3.0}}, "has no unit"),
        ({"gains": {"form": "series", "k_p": "1 A/m"}}, "has the keys K, T_i, T_d and T_f; got k_p"),
        ({"gains": {"form": "standard", "K": "1 A/m", "T_i": "0 s"}}, "T_i = 0; expected more than 0"),
        ({"gains": {"k_p": "1 A/m"}, "tracking_time": "1 ms"}, "0.001 s; expected at least sample_time"),
        ({"gains": {"k_p": "1 A/m"}, "tracking_time": "1 s", "anti_windup": "none"}, "tracking_time needs anti_windup"),
    ],
)
def test_a_wrong_file_is_one_sentence(content, sentence):
    from ehsa_ctrl.core.definition import validate

    with pytest.raises(InputError, match=sentence) as raised:
        validate(HEAD | {"kind": "pid"} | content, PidFile, "mine.toml")

    assert "\n" not in str(raised.value)


def test_what_no_pid_reaches_is_one_sentence(model):
    with pytest.raises(InputError, match=r"needs .* deg from the controller"):
        controller(model, design={"crossover": "300 rad/s", "phase_margin": "70 deg"})
    with pytest.raises(InputError, match=r"must lie between 0 and the Nyquist frequency 785.4 rad/s"):
        controller(model, design={"crossover": "900 rad/s", "phase_margin": "70 deg"})
    with pytest.raises(InputError, match=r"reference_weight = 0.5 without integral action"):
        controller(model, gains={"k_p": "100 A/m"}, reference_weight=0.5)


# Schedule


def scheduled(model, **schedule):
    content = {"variable": "position", "filter_time": "0 s", "points": ROWS} | schedule
    return controller(model, "scheduled_pid", schedule=content)


def test_a_schedule_with_equal_rows_is_the_fixed_pid(model):
    gains = ROWS[0]["gains"]
    fixed = controller(model, gains=gains, reference_weight=0.6)
    rows = [{"at": "-50 mm", "gains": gains}, {"at": "50 mm", "gains": gains}]
    table = controller(model, "scheduled_pid", reference_weight=0.6, schedule={"variable": "position", "points": rows})
    rng = np.random.default_rng(3)
    r, y = np.cumsum(rng.normal(0, 2e-3, (2, 300)), axis=1)

    assert np.allclose(run(table.law, r, y)[0], run(fixed.law, r, y)[0], rtol=1e-9, atol=1e-12)


def test_gains_are_interpolated_and_stay_beyond_the_ends(model):
    law = scheduled(model).law

    assert law.at(0.0).gains == Gains(200.0, 700.0, 6.0, 0.006)
    assert law.at(-0.09).gains.k_p == pytest.approx(100.0)
    assert law.at(0.09).gains.k_p == pytest.approx(300.0)


def test_a_change_of_gains_makes_no_step_in_the_current(model):
    """The load jumps, and with it all gains: the current goes on from where it was."""
    rows = [{**row, "at": at} for row, at in zip(ROWS, ("0 N", "1000 N"), strict=True)]
    law = scheduled(model, variable="load", points=rows).law
    memory, numbers = law.initial_memory(), law.settings()
    row = np.array([2e-3, 0.0, 0.0])
    read = np.zeros(5)

    before = [law.function(row, read, memory, numbers, 0.0, 0.0) for _ in range(10)]
    read[4] = 1000.0
    after = law.function(row, read, memory, numbers, 0.0, 0.0)

    assert memory[law.traces["k_p"]] == pytest.approx(300.0)
    assert after - before[-1] == pytest.approx(before[-1] - before[-2], abs=1e-12)
    assert before[-1] > 0.2


def test_another_operating_point_is_the_plant_with_that_load_and_oil(linear):
    settings = {"load.stiffness": "100 kN/m", "load.mass": "40 kg", "beta": "7e8 Pa"}
    truth = ehsa_ctrl.three_state(ehsa_ctrl.load_plant("ehsa", model="linear", settings=settings))

    found = operating_point(ehsa_ctrl.three_state(linear), stiffness=100e3, mass=40.0, bulk_modulus=0.5)

    assert np.allclose(found.A, truth.A, rtol=1e-12)
    assert np.allclose(found.B, truth.B, rtol=1e-12)


@pytest.mark.slow
def test_a_fixed_gain_falls_short_where_the_oil_softens_and_the_schedule_does_not(model):
    """At 2 bar air leaves an eighth of the oil's stiffness; a spring, however stiff, is no such case."""
    fixed = ehsa_ctrl.load_controller("pid_tuned", model)
    table = ehsa_ctrl.load_controller("pid_scheduled", model)

    soft = operating_point(model, bulk_modulus=0.13)
    there = SampledController("table", "pid", T_S, 6.0, table.law.at(2e5))

    assert analyse_loop(soft, fixed).Ms > 3.0
    assert analyse_loop(soft, there).Ms < 1.46
    assert analyse_loop(operating_point(model, stiffness=200e3), fixed).Ms < 1.46


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"schedule": {"variable": "position", "points": ROWS[:1]}}, "at least 2"),
        ({"schedule": {"variable": "position", "points": ROWS[::-1]}}, "must be in ascending order"),
        ({"schedule": {"variable": "level", "points": ROWS}}, "does not fit"),
        ({"schedule": {"variable": "position", "points": ROWS}, "tuning": {}}, "every point has gains"),
        ({"schedule": {"variable": "position", "points": [{"at": "0 m"}, ROWS[1]]}}, r"either \[design\] or"),
    ],
)
def test_a_wrong_schedule_is_one_sentence(content, sentence):
    from ehsa_ctrl.core.definition import validate

    with pytest.raises(InputError, match=sentence) as raised:
        validate(HEAD | {"kind": "scheduled_pid"} | content, ScheduledFile, "mine.toml")

    assert "\n" not in str(raised.value)
