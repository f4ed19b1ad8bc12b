"""Real machines: records that other people measured, read from the shared folder and skipped where it is absent."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log_reader import read_log
from ehsa_ctrl.identification.balances import estimate_by_balances
from ehsa_ctrl.simulation.engine import simulate

SHARED = Path(__file__).resolve().parents[3] / "shared"


def record(plant, name):
    path = SHARED / "data" / name
    if not path.is_file():
        pytest.skip(f"{name} is not here")
    return read_log(path, list(plant.structure.system.drives.values()), columns=plant.log)


def late(plant, delay):
    """The take-off with the clock of its second computer behind that of the test machine."""
    sensors = {
        channel: replace(sensor, delay=delay if channel in ("speed", "current") else 0.0)
        for channel, sensor in plant.sensors.items()
    }
    return replace(plant, sensors=sensors)


@pytest.fixture
def emps():
    return ehsa_ctrl.load_plant("emps")


@pytest.fixture
def take_off():
    return ehsa_ctrl.load_plant("mbari_pto")


@pytest.mark.parametrize("parallel", [None, 40.0])
def test_the_positioning_system_as_published(emps, parallel):
    """Inverse dynamics with the authors' filter, within two published deviations whichever filter the force has.

    Position filtered at 100 Hz; both sides also at 40 Hz, as if thinned out by ten, comes next to the published error.
    """
    log = record(emps, "emps/train.csv")

    found = estimate_by_balances(
        emps.set(M=50.0, Fv=100.0, Fc=10.0, offset=0.0), log, method="filtered", parallel=parallel
    )

    for name in ("M", "Fv", "Fc", "offset"):
        assert abs(found[name] - emps[name]) < 2 * emps.parameters[name].sd, name
    assert 100 * found.balances[0].relative_error == pytest.approx(4.08, abs=0.5)


def test_the_positioning_system_in_free_run(emps):
    """Drive force in, position out: the published values stay within 2 cm of 25 over 25 s, within 1 cm over 1 s."""
    log = record(emps, "emps/train.csv")
    speed = np.gradient(log["position"], log.sample_time)

    def run(first, last):
        start = np.array([np.mean(speed[first : first + 20]), log["position"][first]])
        return (
            simulate(emps, log["drive_force"][first:last], hold="first_order", start=start)["x"]
            - log["position"][first:last]
        )

    whole = run(0, len(log))
    pieces = np.concatenate([run(first, first + 1000) for first in range(0, len(log) - 1000, 1000)])
    assert np.max(np.abs(whole)) < 0.02
    assert np.sqrt(np.mean(pieces**2)) < 0.003


@pytest.mark.parametrize(("name", "delay"), [("friction_id", 0.38), ("vented_spring", 0.12)])
def test_the_take_off_beside_what_its_makers_believe(take_off, name, delay):
    """Area and displacement ratio come out near the makers' numbers, the torque constant clearly above theirs."""
    log = record(take_off, f"mbari_pto/{name}.csv")
    springs = ["A_S1", "A_S2"] if name == "friction_id" else []
    wanted = ["A", *springs, "A_FR", "B_FR", "D", "K_L", "K_T", "A_FM", "B_FM"]

    found = estimate_by_balances(late(take_off, delay), log, wanted, width=3.0)

    area, ratio = found["A"] / take_off["A"], found["D"] / found["A"] / (take_off["D"] / take_off["A"])
    assert 1.0 < area < 1.1 and 0.98 < ratio < 1.03
    assert 1.05 < found["K_T"] / found["D"] / (take_off["K_T"] / take_off["D"]) < 1.16
    assert 250 < found["A_FR"] < 450 and 0.2 < found["A_FM"] < 0.6
    for spring in springs:
        assert found[spring] == pytest.approx(take_off[spring], rel=0.05)
    error = {fit.name: fit.relative_error for fit in found.balances}
    assert error["force"] < 0.025 and error["torque"] < 0.02 and error["flow"] < 0.08


@pytest.mark.parametrize(("name", "delay"), [("friction_id", 0.38), ("vented_spring", 0.12)])
def test_the_take_off_in_free_run(take_off, name, delay):
    """Current and rod velocity in: the run ends as it should, and speed and pressure difference are followed.

    The pressure level is not: nothing in the model lets oil that the check valves drew in out again.
    """
    log = record(take_off, f"mbari_pto/{name}.csv")
    shift = int(round(delay / log.sample_time))
    samples = len(log) - shift
    current, speed = log["current"][shift:], log["speed"][shift:]
    difference = (log["p1"] - log["p2"])[:samples]
    start = np.array([speed[0], log["p1"][0], log["p2"][0]])

    run = simulate(take_off, current, force=log["velocity"][:samples], hold="first_order", start=start)

    for simulated, measured in ((run["omega"], speed), (run["dP"], difference)):
        assert np.linalg.norm(simulated - measured) < 0.25 * np.linalg.norm(measured - measured.mean())
    assert np.max(np.abs(run.states)) < 1e8
