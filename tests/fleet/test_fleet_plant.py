"""The fleet's spread in a plant's file, and as prior deviation of a diagnosis."""

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.fleet.fleet_plant import fleet_plant, write_fleet_plant
from ehsa_ctrl.fleet.result import Fleet, FleetParameter


@pytest.fixture
def fleet():
    parameters = (
        FleetParameter("K_T", "N m/A", 1.2, 1.23, 0.01, 0.05, 9.0),
        FleetParameter("A_FM", "N m", 0.8, 0.82, 0.02, 0.005, 9.0),
        FleetParameter("M", "kg", 16.52, 30.0, 9.0, None, 0.2),
    )
    return Fleet("ehsa", 0.05, (), parameters, (), ())


def test_the_file_has_mean_and_spread(plant, fleet, tmp_path):
    """In the file's units; what the logs do not determine stays; a spread below the mean's own sd is that."""
    write_fleet_plant(tmp_path / "fleet_plant.toml", plant, fleet)

    found = e.load_plant(tmp_path / "fleet_plant.toml")

    torque, friction = found.parameters["K_T"], found.parameters["A_FM"]
    assert (torque.value, torque.sd, torque.spread, torque.source) == (1.23, 0.01, 0.05, "identified")
    assert friction.spread == 0.02
    assert found.parameters["M"] == plant.parameters["M"]
    again = tmp_path / "again.toml"
    e.write_plant(again, found)
    assert e.load_plant(again).parameters["K_T"].spread == 0.05


def test_a_wrong_spread_is_a_sentence(plant, fleet, tmp_path):
    path = write_fleet_plant(tmp_path / "rig.toml", plant, fleet)
    path.write_text(path.read_text().replace("spread = 0.05", "spread = -0.05"))

    with pytest.raises(
        InputError, match=r"rig\.toml: \[nonlinear.parameters.K_T\] spread = -0.05; expected a value greater than 0"
    ):
        e.load_plant(path)


def test_a_diagnosis_takes_the_spread_for_its_prior(plant, fleet):
    """Of the parameters that have one; the others keep theirs."""
    time, current = e.excitation("steps", amplitude=3.0, duration=4.0)
    log, _ = e.record(plant, time, current, centre=True)

    def priors(plant):
        prepared = prepare_logs(plant, [log], None, 0.03, check=True)
        objective, _ = objective_of(Segment((prepared.logs[0].record,), "all"), 0.03)
        nominal = objective.nominal
        return dict(zip(nominal.names, np.column_stack([nominal.sd, nominal.typical]).tolist(), strict=True))

    before, after = priors(plant), priors(fleet_plant(plant, fleet))

    assert after["K_T"] == pytest.approx([0.05, 0.05])
    assert after["A_FM"] == pytest.approx([0.02, 0.02])
    assert after["J_M"][1] == before["J_M"][1]
