"""An identified plant as a file."""

import pytest

import ehsa_ctrl
from ehsa_ctrl import InputError
from ehsa_ctrl.identification.write import plant_toml, write_plant


def test_what_was_written_is_what_was_identified(found, tmp_path):
    """Values, deviations and source come back; everything else of the file, its comments too, stays as it was."""
    path = write_plant(tmp_path / "rig.toml", found.plant)

    again, linear = ehsa_ctrl.load_plant(path), ehsa_ctrl.load_plant(path, model="linear")
    for name, parameter in found.plant.parameters.items():
        assert again[name] == pytest.approx(parameter.value, rel=1e-5), name
    assert again.parameters["A_FR"].source == "identified"
    assert again.parameters["A_FR"].sd == pytest.approx(found["A_FR"].sd, rel=1e-2)
    assert linear.values == ehsa_ctrl.load_plant("ehsa", model="linear").values
    assert "The paper does not print K_T" in path.read_text()
    assert again.free == found.plant.free


def test_what_was_believed_for_the_run_is_written_too(tmp_path):
    """A setting is part of what was identified: it goes into the file, in the file's unit and marked as assumed."""
    plant = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": 5e4, "A": "15 cm2", "delay.p1": "2 ms"})

    again = ehsa_ctrl.load_plant(write_plant(tmp_path / "rig.toml", plant))

    assert (again["K_S"], again["A"], again.sensors["p1"].delay) == (5e4, pytest.approx(15e-4), 0.002)
    assert again.parameters["A"].source == "assumed" and again.parameters["A"].written == "15 cm2"


def test_plants_of_two_files_are_refused(found):
    """One text can't hold two plants."""
    with pytest.raises(InputError, match="one TOML file"):
        plant_toml([found.plant, ehsa_ctrl.load_plant("emps")])
