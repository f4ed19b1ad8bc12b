"""Effects from TOML files: the same plant as a Python effect with this equation, exact at neutral, clear errors."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl as e
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core import registry
from ehsa_ctrl.physics.effects import EFFECTS
from ehsa_ctrl.scenario.prepare import check_definition

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "own-effect.md"
DRAG = """
schema = 1
status = "proposed"
summary = "drag of the shaft with the square of its speed"
adds_to = "torque"
expression = "-k_own * omega * abs(omega)"

[parameters]
k_own = { value = 1e-6, unit = "N m s2", neutral = 0.0, bounds = [0.0, 1e-3], sd = 1e-7 }

[range]
omega = [-200.0, 200.0]
"""
LAG = """
schema = 1
status = "proposed"
summary = "a current that follows late"
adds_to = "drive"
expression = "g_own * (late - current)"

[parameters]
g_own = { value = 1.0, unit = "1", neutral = 0.0 }
tau_own = { value = 0.02, unit = "s" }

[states]
late = { rate = "(current - late) / tau_own", unit = "A", scale = 1.0 }
"""
TIGHT = """
schema = 1
status = "confirmed"
summary = "a tight spot, and a spring"
adds_to = "force"
expression = "d_R * A_own * exp(-((x - x_own) / w_own)**2) + K_own * x"

[parameters]
x_own = { value = 0.005, unit = "m" }
w_own = { value = 0.01, unit = "m", bounds = [0.001, 0.1] }
A_own = { value = 150.0, unit = "N", neutral = 0.0 }
K_own = { value = 2e4, unit = "N/m", neutral = 0.0 }
"""
LOADED = """
schema = 1
status = "proposed"
summary = "friction of the gear under the load of the arm"
adds_to = "torque"
expression = "k_own * d_M * abs(T_L)"

[parameters]
k_own = { value = -0.05, unit = "1", neutral = 0.0 }

[range]
T_L = [-0.5, 0.5]
"""
CURRENT = 1.5 * np.sin(np.linspace(0, 12, 751))


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Writes effects/NAME.toml of a project that is the current folder."""
    (tmp_path / "effects").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_PROJECTS", [])

    def file(text, name="own_law"):
        path = tmp_path / "effects" / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return file


def test_it_equals_the_same_effect_in_python(write, plant):
    """The shipped windage has this equation: every state agrees to the last bit, in a run and in its derivatives."""
    write(DRAG)
    own = plant.with_effects("own_law", k_own=3e-6)
    shipped = plant.with_effects("windage", k_w=3e-6)
    one, other = e.simulate(own, CURRENT), e.simulate(shipped, CURRENT)

    for state in ("omega", "P_1", "P_2", "v", "x"):
        assert (one[state] == other[state]).all()
    assert (e.linearise(own).A == e.linearise(shipped).A).all()


def test_friction_sticks_at_its_level(write, plant):
    """A term with d_R adds to the breakaway force A_FR + C_FR: the rod does not move below it.

    At neutral values the run is that of the base plant to the last bit.
    """
    write(TIGHT.replace("value = 0.005", "value = 0.0"))
    base = e.simulate(plant, CURRENT)
    neutral = e.simulate(plant.with_effects("own_law", A_own=0.0, K_own=0.0), CURRENT)
    tight = plant.with_effects("own_law", A_own=2000.0, K_own=0.0)
    held = e.simulate(tight, np.linspace(0.0, 4.0, 1500))
    free = e.simulate(plant, np.linspace(0.0, 4.0, 1500))
    force = plant["A"] * (held["P_1"] - held["P_2"])
    level = 2000.0 + plant["A_FR"] + plant["C_FR"]

    assert all((neutral[state] == base[state]).all() for state in ("omega", "P_1", "x"))
    assert np.flatnonzero(held["v"])[0] > np.flatnonzero(free["v"])[0]
    assert force[np.flatnonzero(held["v"])[0] - 1] == pytest.approx(level, rel=0.05)


def test_what_it_is(write):
    """Parameters with a neutral value come first, the others are shapes; status and place are in the list."""
    write(TIGHT)
    effect = EFFECTS["own_law"]
    listed = CliRunner().invoke(app, ["list", "effects", "--json"]).output

    assert [(p.name, p.shape) for p in effect.parameters] == [
        ("A_own", False), ("K_own", False), ("x_own", True), ("w_own", True)
    ]  # fmt: skip
    assert set(effect.changes) == {"F_FR", "F_net"}
    assert "(force) a tight spot, and a spring (confirmed)" in listed


def test_a_changed_file_is_read_again(write, plant):
    """By the next plant that is loaded."""
    write(DRAG)
    before = e.simulate(plant.with_effects("own_law", k_own=1e-5), CURRENT)["omega"].max()
    write(DRAG.replace("-k_own", "-2 * k_own"))
    after = e.simulate(e.load_plant("ehsa").with_effects("own_law", k_own=1e-5), CURRENT)["omega"].max()

    assert after < before


def test_check_accepts_it_and_tries_the_plant(write):
    """`ehsa-ctrl check` names the kind; with --plant also what does not fit that plant."""
    path = write(DRAG.replace("omega", "v").replace("N m s2", "N s/m"))

    assert check_definition(path) == "effect"
    with pytest.raises(e.InputError, match=r"own_law\.toml: expression: .* expected N m"):
        check_definition(path, plant="ehsa")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("omega * abs", "omega * eval", "expression: 'eval\\(omega\\)': 'eval' can't be called"),
        ("-k_own *", "-k_own + ", "expression: is .* at omega = -200 with the neutral values"),
        ("-k_own * omega * abs(omega)", "-k_own * sign(omega)", "write d_M, the direction of dry friction"),
        ("neutral = 0.0, ", "", "none has `neutral`"),
        ("1e-6", "1e-2", "value = 0.01 is outside bounds"),
        ("N m s2", "bar", "'bar' is not an SI unit"),
        ('"torque"', '"speed"', "adds_to = 'speed'"),
        ('"proposed"', '"sure"', "status = 'sure'"),
        ("k_own = {", "k_other = { value = 1, unit = '1' }\nk_own = {", "the expression does not use it"),
        ("[-200.0, 200.0]", "[200.0, -200.0]", r"\[range\] omega = \[200, -200\]; expected the lower one first"),
        ("omega = [", "omga = [", r"\[range\] omga: is not a variable"),
        ("schema = 1", "schema = 1\nplace = 3", "place: unknown key"),
        ("omega * abs(omega)", "omega / (omega + 200.0)", "can't be computed at omega = -200"),
    ],
)
def test_a_wrong_file_is_a_sentence(write, old, new, says):
    """File and key, what was found and what was expected."""
    assert old in DRAG
    path = write(DRAG.replace(old, new))

    with pytest.raises(e.InputError, match=says) as caught:
        len(EFFECTS)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_law_of_the_drive_remembers_the_current_asked_for(write, plant):
    """A lag of the motor current: the same run as with the shipped effect."""
    write(LAG)
    current = 2.0 * np.sign(np.sin(2.0 * np.pi * 4.0 * np.arange(0.0, 1.0, 0.004)))
    tau = 0.02
    run = e.simulate(plant.with_effects("own_law", g_own=1.0, tau_own=tau), current, tolerance=1e-9)
    shipped = e.simulate(plant.with_effects("drive_lag", tau_I=tau), current, tolerance=1e-9)

    for name in ("omega", "P_1", "v", "x"):
        scale = np.max(np.abs(shipped[name]))
        np.testing.assert_allclose(run[name], shipped[name], atol=1e-5 * scale, err_msg=name)


@pytest.mark.parametrize(("size", "amplitude", "beyond"), [(1e-6, 0.5, False), (1e-6, 2.0, True), (0.0, 2.0, False)])
def test_a_run_beyond_the_range_of_a_law(write, plant, size, amplitude, beyond):
    """It says so where the speed leaves the range of the logs, and the law acts."""
    write(DRAG)
    rig = plant.with_effects("own_law", k_own=size)
    run = e.simulate(rig, np.full(100, amplitude))
    fastest = np.max(np.abs(run["omega"]))
    words = [one for one in str(run).splitlines() if "the law own_law is known for omega from -200 to 200 rad/s" in one]

    assert (fastest > 200.0) == (amplitude > 1.0)
    assert bool(words) == bool(run.extrapolated) == beyond


def test_a_scenario_beyond_the_range_of_a_law(write, plant):
    """The result warns, in its text and in its dictionary; of the plant without the law it does not."""
    write(DRAG)
    result, without = (e.run("steps_spring", plant=rig) for rig in (plant.with_effects("own_law", k_own=1e-6), plant))
    (words,) = result.to_dict()["warnings"]

    assert np.max(np.abs(result.nonlinear.trajectory["omega"])) > 210.0
    assert words.startswith("the law own_law is known for omega from -200 to 200 rad/s") and words in str(result)
    assert not without.warnings


@pytest.mark.parametrize(
    ("expression", "says"), [("-k_own * omega", "expected N m"), ("-k_own * omeg**2", "did you mean 'omega'")]
)
def test_units_and_names_are_checked_with_the_plant(write, plant, expression, says):
    """A law of one system may not fit another."""
    write(DRAG.replace("-k_own * omega * abs(omega)", expression).replace("[range]\nomega = [-200.0, 200.0]", ""))

    with pytest.raises(e.InputError, match=re.compile(says)):
        plant.with_effects("own_law")


@pytest.mark.slow
def test_it_is_diagnosed(write, plant):
    """A log of a rig with a law that the catalogue lacks: the law is named, with its size."""
    write(DRAG.replace("omega * abs(omega)", "omega**3").replace('"N m s2"', '"N m s3"').replace("1e-6", "2e-8"))
    rig = plant.with_effects("own_law", k_own=4e-8)
    log, _ = e.record(rig, *e.excitation("noise", amplitude=3.0, duration=16.0, sample_time=0.004), centre=True)
    found = e.diagnose(plant, log)

    assert "own_law" in {cause.id for cause in found.effects}, str(found)
    assert next(c for c in found.effects if c.id == "own_law").parameters["k_own"].value == pytest.approx(4e-8, rel=0.2)


def test_the_page_is_right(write, plant):
    """The file on the documentation's page is read and simulated."""
    title = 'title="effects/tight_spot_with_drag.toml"'
    text = re.search(rf"```toml {title}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL).group(1)
    write(text, "tight_spot_with_drag")
    run = e.simulate(plant.with_effects("tight_spot_with_drag"), CURRENT)

    assert run["x"].max() < e.simulate(plant, CURRENT)["x"].max()


LEAK = """
schema = 1
status = "proposed"
summary = "leakage of either chamber to the tank"
adds_to = "flows"
expression = "-K_own * P"

[parameters]
K_own = { value = 1e-12, unit = "m3/(s Pa)", neutral = 0.0 }

[range]
P = [1e5, 4e6]
"""


def test_a_law_of_both_chambers_has_the_pressure_of_each(write, plant):
    """The shipped leakage to the tank has this equation in both chambers: every state agrees to the last bit."""
    write(LEAK)
    own = e.simulate(plant.with_effects("own_law", K_own=1e-12), CURRENT)
    shipped = e.simulate(plant.with_effects("external_leakage", K_e=1e-12), CURRENT)

    assert set(EFFECTS["own_law"].changes) == {"Q_T1", "Q_T2"}
    for state in ("omega", "P_1", "P_2", "v", "x"):
        assert (own[state] == shipped[state]).all()


def test_a_state_has_one_pressure(write):
    """P is that of either chamber, so that a rate must not have it."""
    states = '[states]\nlate = { rate = "(P - late) / 0.1", unit = "Pa", scale = 1e6 }\n'
    path = write(LEAK.replace("-K_own * P", "-K_own * late").replace("P = [1e5, 4e6]\n", "") + states)

    with pytest.raises(e.InputError, match=r"\[states\] late\.rate: has P, which is P_1 or P_2 by the balance"):
        check_definition(path)


@pytest.mark.parametrize(("widest", "beyond"), [(0.5, False), (0.1, True)])
def test_a_run_beyond_the_effort_of_a_law(write, widest, beyond):
    """An effort on a contact is no state: here gravity on the arm, by its closed form m g l sin(theta + offset)."""
    write(LOADED.replace("0.5", str(widest)))
    rig = e.load_plant("xl330_pendulum").with_effects("own_law", k_own=-0.05)
    run = e.simulate(rig, 0.5 * np.sin(6.0 * np.arange(0.0, 2.0, 0.005)))
    gravity = rig["m"] * 9.80665 * rig["l"] * np.sin(run["theta"] + rig["offset"])

    assert np.max(np.abs(gravity)) < 0.5
    assert len(run.extrapolated) == beyond
    for one in run.extrapolated:
        assert one.variable == "T_L"
        np.testing.assert_allclose(one.reached, (gravity.min(), gravity.max()), rtol=1e-12)


def test_a_run_that_ends_with_no_number_still_left_the_range(write, plant):
    """A controller may fail: its last output is in the run."""
    text = DRAG.replace("omega = [-200.0, 200.0]", "current = [-0.5, 0.5]").replace("omega * abs(omega)", "current")
    write(text.replace('"N m s2"', '"N m/A"'))
    run = e.simulate(plant.with_effects("own_law", k_own=1e-6), np.full(20, 2.0))
    run = replace(run, current=np.append(run.current[:-1], np.nan))

    assert [one.variable for one in run.extrapolated] == ["current"]
