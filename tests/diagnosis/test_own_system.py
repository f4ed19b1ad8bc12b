"""A motor with a flywheel: a system of a user's own project, with channel names of its own."""

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core import registry
from ehsa_ctrl.simulation.sensors import Sensors

SYSTEM = '''
"""A motor with a flywheel: torque balance with friction, without hydraulics."""

from ehsa_ctrl.physics import residuals
from ehsa_ctrl.plant.system import Balance, Contact, Entry, ParameterKind, State, System


def torque(motor_current: float, K_T: float) -> float:
    """K_T I."""
    return K_T * motor_current


def net_torque(T_M: float, T_D: float) -> float:
    """Torque without friction; T_D acts against the motor."""
    return T_M - T_D


def acceleration(T_net: float, T_FM: float, J_M: float) -> float:
    """d omega/dt."""
    return (T_net - T_FM) / J_M


def balance(T_M: float, T_D: float, T_FM: float, J_M: float, omega_rate: float) -> float:
    """What is left of the torque."""
    return T_M - T_D - T_FM - J_M * omega_rate


SHAFT = Contact("shaft", "omega", "T_net", "T_FM", "d_M", "FM", "N m", "rad", 0.1, State("z_M", "rad", 1e-3))

system = System(
    name="flywheel",
    title="motor with a flywheel",
    states=(State("omega", "rad/s", 10.0),),
    inputs=("motor_current", "T_D"),
    drives={"motor_current": "drive_amps"},
    outputs={"wheel": "omega"},
    units={"drive_amps": "A", "wheel": "rad/s"},
    contacts=(SHAFT,),
    equations=(("T_M", torque), ("T_net", net_torque), ("omega_dot", acceleration)),
    parameters=(
        ParameterKind("J_M", "kg m2", "inertia", 0.0, lower_open=True, prior=0.1),
        ParameterKind("K_T", "N m/A", "torque constant", 0.0, lower_open=True, prior=0.05),
    ),
    balances=(
        Balance(
            "torque", "N m", (balance,), ("T_M",), contacts=("shaft",), entries=(Entry("motor_current", ("K_T",)),)
        ),
    ),
)
'''
PLANT = """
schema = 1
title = "Motor with a flywheel"
system = "flywheel"

[parameters]
J_M = { value = 0.02, unit = "kg m2", source = "datasheet" }
K_T = { value = 0.5, unit = "N m/A", source = "datasheet" }

[nonlinear]
shaft_friction = "coulomb"
free = ["J_M", "A_FM", "B_FM"]

[nonlinear.parameters]
A_FM = { value = 0.2, unit = "N m", source = "assumed" }
B_FM = { value = 0.002, unit = "N m s/rad", source = "assumed" }

[sampling]
period = { value = 4, unit = "ms", source = "datasheet" }

[sensors.wheel]
noise = { value = 0.05, unit = "rad/s", source = "assumed" }

[sensors.drive_amps]
noise = { value = 0.001, unit = "A", source = "assumed" }
"""


@pytest.fixture
def flywheel(tmp_path, monkeypatch):
    """The plant of a project with a system of its own."""
    for folder, name, text in (("systems", "flywheel.py", SYSTEM), ("plants", "wheel.toml", PLANT)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_PROJECTS", [])
    return e.load_plant(tmp_path / "plants" / "wheel.toml")


def logged(plant, seconds=12.0):
    """A log at 250 Hz of a current that reverses the shaft at several speeds."""
    time = np.arange(0.0, seconds, 0.004)
    current = 2.0 * np.sin(2.0 * np.pi * 0.5 * time) + np.sign(np.sin(2.0 * np.pi * 0.17 * time))
    run = e.simulate(plant, current, sample_time=0.004)
    speed = run["omega"] + 0.05 * np.random.default_rng(0).standard_normal(time.size)
    return e.Log(time, {"drive_amps": current, "wheel": speed})


def test_its_channels_are_simulated_and_read(flywheel, tmp_path):
    """A simulated log has the system's channels, and a file with these columns is read without a mapping."""
    run = e.simulate(flywheel, np.ones(400), sample_time=0.004)
    log = e.Log(run.time, Sensors.of(flywheel, noise=False).log(run))

    log.write(tmp_path / "log.csv")
    read = e.read_plant_log(tmp_path / "log.csv", flywheel)

    assert set(read.channels) == {"drive_amps", "wheel"} and read["drive_amps"][-1] == 1.0
    np.testing.assert_allclose(read["wheel"], run["omega"], atol=1e-6)


@pytest.mark.slow
def test_effects_of_the_catalogue_are_found_in_it(flywheel):
    """Those that change its signals or its parameters: a wrong inertia by its id, with its place and size."""
    assert e.diagnose(flywheel, logged(flywheel)).verdict == "no_gap"

    found = e.diagnose(flywheel, logged(flywheel.set(J_M=0.026)))

    assert [cause.id for cause in found.effects] == ["rotor_inertia"], str(found)
    assert found.where[0][0] == "torque" and set(found.gap["nominal"]) == {"wheel", "total"}
    assert {place for place, share in found.where if share > 0.0} <= {"torque", "drive", "sensor"}
    assert found.effects[0].parameters["J_M"].value == pytest.approx(0.026, rel=0.02)
    assert found.gap["with_effects"]["total"] < 0.03
