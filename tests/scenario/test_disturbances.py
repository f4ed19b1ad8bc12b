"""Faults and supervision from a scenario's TOML to the loop."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.scenario.disturbances import SupervisionSettings, faults_of
from ehsa_ctrl.scenario.prepare import prepare
from ehsa_ctrl.simulation.faults import DriveLimit, Faults, SensorFault

POSITION = 3


def fault(**words):
    return {"fault": [words]}


def test_faults_are_those_of_the_simulation(short):
    """Each kind of the file, in SI units; without a duration they last to the end."""
    found = short(
        fault=[
            {"kind": "stuck", "channel": "position", "start": "0.2 s", "duration": "0.1 s"},
            {"kind": "lost", "channel": "speed", "start": "300 ms"},
            {"kind": "current_limit", "current": "0.5 A", "start": "0.1 s", "duration": "0.4 s"},
        ]
    ).definition.fault
    sensors = (SensorFault("position", "stuck", 0.2, 0.1), SensorFault("speed", "lost", 0.3))

    assert faults_of(found) == Faults(sensors, (DriveLimit(0.5, 0.1, 0.4),))


def test_lost_samples_are_no_numbers_and_are_bridged(short):
    """Supervision tolerates five lost samples: the loop continues."""
    result = ehsa_ctrl.run(short(**fault(kind="lost", channel="position", start="0.2 s", duration="20 ms")))

    assert np.count_nonzero(np.isnan(result.nonlinear.measured[:, POSITION])) == 5
    assert np.isfinite(result.nonlinear.asked).all()
    assert np.isnan(result.metrics["StopTime"][1])


def test_a_position_that_stays_lost_stops_the_loop(short):
    """After the tolerated time the current is zero and the rod comes to rest."""
    lost = fault(kind="lost", channel="position", start="0.2 s")
    result = ehsa_ctrl.run(short(**lost, supervision={"lost": "20 ms"}))
    loop = result.nonlinear
    stop = 0.2 + result.metrics["StopTime"][1]

    assert result.metrics["StopTime"][1] == pytest.approx(0.02)
    assert not np.any(loop.asked[loop.trajectory.time >= stop - 1e-9])
    assert loop.trajectory.sticks("rod")[-1]


def test_a_contradiction_stops_the_loop_and_travel_is_the_plants(short):
    """A stuck position while the shaft turns; D / A comes from the plant, not from the scenario."""
    stuck = fault(kind="stuck", channel="position", start="0.2 s")
    case = prepare(short(**stuck, supervision={"contradiction": "1 mm"}))
    plant = case.nonlinear

    assert case.controller.supervision.travel == plant["D"] / plant["A"]
    assert case.metrics(case.simulate(plant))["StopTime"] < 0.2


def test_supervision_that_is_not_asked_for_changes_nothing(short):
    """Supervision without limits changes no bit."""
    plain, wide = (ehsa_ctrl.run(scenario).nonlinear for scenario in (short(), short(supervision={})))

    assert np.array_equal(plain.trajectory.states, wide.trajectory.states)


def test_supervising_reads_units(plant):
    """bar and mm in, SI out."""
    read = SupervisionSettings(position="95 mm", pressure_max="200 bar").for_plant(plant)

    assert (read.position, read.pressure_max) == (pytest.approx(0.095), pytest.approx(200e5))
