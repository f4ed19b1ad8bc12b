"""Rescaling of a shipped controller's numbers to another plant."""

import tomllib

import pytest
from typer.testing import CliRunner

from ehsa_ctrl import InputError, load_controller, load_plant, three_state
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core.catalogue import controllers, plants
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.load import read_controller
from ehsa_ctrl.design.specification import definition_keys
from ehsa_ctrl.scenario.plant_data import check_controller_limits, ratings
from ehsa_ctrl.scenario.prepare import check_definition, prepare
from ehsa_ctrl.scenario.rescaling import is_for_shipped_ehsa, rescaling_to

EHSA = plants["ehsa"].read_text()
#: Half the stroke, a third of the current, twice the samples.
SMALL = {
    "stroke = { value = 200": "stroke = { value = 100",
    "current_rms = { value = 2.51": "current_rms = { value = 0.8366666666666667",
    "period = { value = 4": "period = { value = 2",
}


@pytest.fixture
def rig(tmp_path):
    """A plant of one's own, copied from the EHSA; call it with pieces of text and what stands there instead."""

    def write(changes):
        text = EHSA
        for old, new in changes.items():
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "rig.toml"
        path.write_text(text)
        return path

    return write


def changes(name, plant):
    content = tomllib.loads(controllers[name].read_text())
    return rescaling_to(plant).changes(content, definition_keys(CONTROLLER_KINDS[content["kind"]].file))


@pytest.mark.parametrize("name", [name for name in controllers if is_for_shipped_ehsa(controllers[name])])
def test_on_the_shipped_plant_every_shipped_number_stays(name):
    """No rescaled number exceeds the plant's limits."""
    path = controllers[name]

    assert changes(name, "ehsa") == {}
    assert check_controller_limits(path, read_controller(path)[1], load_plant("ehsa")) is None


def test_a_shipped_controller_of_another_drive_is_a_base_as_it_is(tmp_path, monkeypatch):
    """Its numbers are not those of the EHSA, so a design for its own plant keeps them."""
    monkeypatch.chdir(tmp_path)
    line = ["design", "emps", "--kind", "pid", "--base", "carriage_pid", "-o", "mine.toml"]
    CliRunner().invoke(app, line, catch_exceptions=False)
    mine, base = (tomllib.loads(path.read_text()) for path in (tmp_path / "mine.toml", controllers["carriage_pid"]))

    assert {key for key in mine if mine[key] != base.get(key)} <= {"title"}


def test_limits_period_and_weights_are_the_same_share_of_another_plant(rig):
    """Half the stroke halves lengths, a third of the current scales currents; the horizon keeps its duration."""
    found = changes("mpc_position", rig(SMALL))
    expected = {
        "sample_time": "2 ms", "current_limit": "2 A", "horizon": 40, "limits.stroke": "47.5 mm",
        "limits.current_rate": "200 A/s", "weights.position": "0.25 mm", "weights.current": "0.333 A",
    }  # fmt: skip

    assert expected.items() <= found.items()
    assert not {"limits.speed", "limits.pressure", "solver.name"} & set(found)


def test_pump_speed_pressure_and_level_are_carried(rig):
    """Each limit follows its own number of the plant's file; the motor is no slower than the pump here."""
    slow = rig(
        {"pump_speed = { value = 4500": "pump_speed = { value = 2250", "value = 210, unit": "value = 105, unit",
         "P_0 = { value = 20": "P_0 = { value = 10"}
    )  # fmt: skip

    assert changes("cascade_position", slow)["position.speed_limit"] == "225 rad/s"
    assert changes("mpc_position", slow)["limits.speed"] == "225 rad/s"
    assert changes("mpc_position", slow)["limits.pressure"] == "75 bar"
    assert changes("pid_scheduled", slow)["schedule.nominal"] == "10 bar"


def test_friction_and_sensors_are_carried(rig):
    """Feed-forward is the current of that plant's friction, the filter's noise that of its sensors, left out or not."""
    noise = 'noise = { value = %d, unit = "kPa"'
    rough = rig({"A_FM = { value = 0.8": "A_FM = { value = 1.6", noise % 15: noise % 30})

    # (1.6 N m + D / A 854 N) / K_T
    assert changes("lqr_friction", rough)["feedforward.coulomb"] == "1.61 A"
    assert changes("lqr_friction", rough)["observer.pressure"] == "30 kPa"


def test_no_current_is_more_than_the_motor_gives(rig):
    """A weak motor of the same continuous current: its torque over K_T bounds the current."""
    weak = rig({"motor_torque = { value = 16.1": "motor_torque = { value = 4.45"})

    assert changes("pid_position", weak)["current_limit"] == "3.7 A"


def test_of_a_motor_with_its_peak_torque_alone_the_current_is_the_same_share(rig):
    """No continuous current is stated: half of the peak is half of the current."""
    rms = next(line + "\n" for line in EHSA.splitlines() if line.startswith("current_rms"))
    peak = rig({rms: "", "motor_torque = { value = 16.1": "motor_torque = { value = 8.05"})

    assert changes("pid_position", peak)["current_limit"] == "3 A"


def test_what_a_plant_does_not_state_stays_and_is_named(rig):
    """Without [limits] currents and strokes are not rescaled."""
    limits = EHSA[EHSA.index("[limits]") : EHSA.index("[sampling]")]
    bare = rig({limits: ""})
    content = tomllib.loads(controllers["mpc_position"].read_text())

    assert changes("mpc_position", bare) == {}
    assert {"current_limit", "limits.stroke", "limits.speed"} <= set(rescaling_to(bare).unknown(content))


@pytest.mark.parametrize(
    ("name", "changed", "says"),
    [
        ("pid_position", {"motor_torque = { value = 16.1": "motor_torque = { value = 5.4"},
         r"current_limit = 6 A exceeds the rating of the plant rig, 4.5 A \(motor_torque / K_T\)"),
        ("cascade_position", {"pump_speed = { value = 4500": "pump_speed = { value = 3000"},
         r"\[position\] speed_limit = 450 rad/s .* 314.2 rad/s \(pump_speed\)"),
        ("mpc_position", {"stroke = { value = 200": "stroke = { value = 100"},
         r"\[limits\] stroke = 0.095 m .* 0.05 m \(stroke / 2\)"),
        ("lqr_position", {"pump_speed = { value = 4500": "pump_speed = { value = 3000"},
         r"\[trajectory\] speed = 0.15 m/s .* 0.1212 m/s"),
    ],
)  # fmt: skip
def test_a_controller_that_asks_for_more_than_its_plant_allows_is_refused(rig, name, changed, says):
    """By run and by check, with both values and the remedy."""
    path = rig(changed)
    says = f"{name}.toml: {says}.*; lower it, or create a controller .* new controller NAME --plant rig"

    with pytest.raises(InputError, match=says):
        prepare("steps_spring", controller=name, plant=path)
    with pytest.raises(InputError, match=says):
        check_definition(controllers[name], plant=path)
    assert check_definition(controllers[name]) == "controller"


def test_ratings_are_read_from_the_plants_limits():
    """Peak current by the torque, the slower of pump and motor, half of the stroke."""
    plant = load_plant("ehsa")
    found = ratings(plant)

    assert found["current"].value == pytest.approx(16.1 / 1.2)
    assert found["speed"].source == "pump_speed"
    assert found["rod_speed"].value == pytest.approx(found["speed"].value * plant["D"] / plant["A"])
    assert found["reach"].value == pytest.approx(0.1) and found["pressure"].value == pytest.approx(210e5)


def test_a_controller_without_a_sample_time_runs_at_the_plants_period(rig, tmp_path):
    """2 ms on that plant; 4 ms without a plant."""
    plant = rig(SMALL)
    mine = tmp_path / "mine.toml"
    mine.write_text(controllers["pid_position"].read_text().replace('sample_time = "4 ms"\n', ""))

    assert prepare("steps_spring", controller=mine, plant=plant).controller.sample_time == 0.002
    assert load_controller(mine, three_state(load_plant(plant, model="linear"))).sample_time == 0.004


def test_a_plant_without_a_linear_set_is_said():
    """Controllers are designed on it."""
    with pytest.raises(InputError, match=r"pendulum.toml: has no \[linear\] model, on which controllers are designed"):
        rescaling_to("xl330_pendulum")
