"""A changed plant as a file."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl import InputError
from ehsa_ctrl.core.catalogue import plants
from ehsa_ctrl.core.parameter import Parameter
from ehsa_ctrl.identification.plant_toml import plant_toml, write_plant
from ehsa_ctrl.physics.effects import EFFECTS

TEXT = plants["ehsa"].read_text()
WIRED = [name for name, effect in EFFECTS.items() if effect.wired]


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


def test_values_set_for_the_run_are_written_too(tmp_path):
    """A setting is part of what was identified: it goes into the file, in the file's unit and marked as assumed."""
    plant = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": 5e4, "A": "15 cm2", "delay.p1": "2 ms"})

    again = ehsa_ctrl.load_plant(write_plant(tmp_path / "rig.toml", plant))

    assert (again["K_S"], again["A"], again.sensors["p1"].delay) == (5e4, pytest.approx(15e-4), 0.002)
    assert again.parameters["A"].source == "assumed" and again.parameters["A"].written == "15 cm2"


def test_plants_of_two_files_are_refused(found):
    """One text can't hold two plants."""
    with pytest.raises(InputError, match="one TOML file"):
        plant_toml([found.plant, ehsa_ctrl.load_plant("emps")])


@pytest.mark.parametrize("name", WIRED)
def test_an_effect_that_was_added_is_written(plant, name, tmp_path):
    """Structure and symbols come back with deviation and source, the other model and the file's text stay."""
    rig = plant.with_effects(name)
    found = {
        p.name: replace(rig.parameters[p.name], source="identified", sd=1e-3, note="diagnosed")
        for p in EFFECTS[name].parameters[:1]
    }
    rig = replace(rig, parameters={**rig.parameters, **found})

    path = write_plant(tmp_path / "rig.toml", rig)

    again = ehsa_ctrl.load_plant(path)
    assert again.structure == rig.structure and again.values == rig.values
    assert [(p.sd, p.source) for p in again.parameters.values() if p.name in found] == [(1e-3, "identified")] * len(
        found
    )
    assert ehsa_ctrl.load_plant(path, model="linear").values == ehsa_ctrl.load_plant("ehsa", model="linear").values
    kept = [line for line in path.read_text().splitlines() if line in TEXT.splitlines()]
    assert kept == TEXT.splitlines()


def test_a_new_key_is_not_below_the_comment_of_the_next_table(tmp_path):
    """It follows the last key of its own table; comments keep their order."""
    path = tmp_path / "rig.toml"
    path.write_text(TEXT.replace("[load]", "# What acts on the rod.\n[load]"), encoding="utf-8")

    text = plant_toml([ehsa_ctrl.load_plant(path).with_effects("windage")])

    assert "\n# What acts on the rod.\n[load]" in text
    assert text.index("k_w = ") < text.index("# What acts on the rod.")


@pytest.mark.slow
def test_a_written_plant_runs_as_the_one_that_was_written(plant, tmp_path):
    """All effects at once, and presliding: the simulations are equal to the bit."""
    current = 2.0 * np.sin(np.linspace(0.0, 12.0, 250))
    every = plant.with_effects(*(name for name in WIRED if EFFECTS[name].parameters), T_d=0.005, P_crack=float("inf"))
    bristles = plant.with_structure(replace(plant.structure, rod_friction="lugre"), sigma_0_FR=1e8, sigma_1_FR=0.0)

    for rig in (every, bristles):
        again = ehsa_ctrl.load_plant(write_plant(tmp_path / "rig.toml", rig, force=True))

        assert np.array_equal(ehsa_ctrl.simulate(again, current).states, ehsa_ctrl.simulate(rig, current).states)


def test_another_friction_law_is_written_and_its_symbols_with_it(plant, tmp_path):
    """LuGre has more symbols than (8), viscous friction fewer: these are left out, and come back with the law."""
    bristles = plant.with_structure(replace(plant.structure, rod_friction="lugre"), sigma_0_FR=1e8, sigma_1_FR=0.0)
    smooth = plant.with_structure(replace(plant.structure, rod_friction="viscous"))

    for rig in (bristles, smooth):
        again = ehsa_ctrl.load_plant(write_plant(tmp_path / "rig.toml", rig, force=True))

        assert again.structure == rig.structure and again.values == rig.values
    assert "A_FR" not in again.parameters


def test_a_linear_set_that_got_friction_stays_the_linear_set(linear, tmp_path):
    """It loads as it was made, controllers are still designed on its viscous part, and it can go back."""
    laws = replace(linear.structure, shaft_friction="stribeck", rod_friction="stribeck", effects=("orifice_leakage",))
    friction = {"A_FM": 0.7, "C_FM": 0.1, "tau_FM": 10.0, "A_FR": 800.0, "C_FR": 200.0, "tau_FR": 0.007}
    rig = linear.with_structure(laws, **friction)

    path = write_plant(tmp_path / "rig.toml", rig)

    again = ehsa_ctrl.load_plant(path, model="linear")
    assert again.structure == rig.structure and again.values == rig.values
    assert ehsa_ctrl.load_plant(path).values == ehsa_ctrl.load_plant("ehsa").values
    np.testing.assert_array_equal(ehsa_ctrl.three_state(again).A, ehsa_ctrl.three_state(linear).A)
    assert plant_toml([again.with_structure(linear.structure)]) == TEXT


def test_a_shared_symbol_that_one_model_gave_up_goes_to_the_other(tmp_path):
    """V for both models, until the volumes of one follow the stroke."""
    path = tmp_path / "rig.toml"
    volume = (
        'V = { value = 2.042e-3, unit = "m3", source = "identified", note = "Table 2; only V/beta is meaningful" }\n'
    )
    shared = TEXT.replace(volume, "").replace("[linear]", f"{volume}\n[linear]", 1)
    shared = "".join(line for line in shared.splitlines(True) if not line.startswith(("V_10", "V_20")))
    path.write_text(shared.replace('chambers = "stroke"', 'chambers = "constant"'))
    rig = ehsa_ctrl.load_plant(path)
    rig = rig.with_structure(replace(rig.structure, chambers="stroke"), V_10=2e-3, V_20=2.1e-3)

    path = write_plant(tmp_path / "written.toml", rig)

    assert ehsa_ctrl.load_plant(path).values == rig.values
    assert ehsa_ctrl.load_plant(path, model="linear")["V"] == 2.042e-3


def test_a_written_plant_is_replaced_only_when_told(plant, tmp_path):
    """A file of that name may be a plant that somebody has edited."""
    path = write_plant(tmp_path / "rig.toml", plant)
    path.write_text("mine")

    with pytest.raises(InputError, match=r"rig\.toml: already exists; choose another name or pass force=True"):
        write_plant(path, plant)
    assert path.read_text() == "mine"
    assert ehsa_ctrl.load_plant(write_plant(path, plant, force=True)).values == plant.values


def test_free_symbols_that_are_gone_are_not_named(tmp_path):
    """A file's list of free symbols loses those of a law that was changed, and gains what the plant frees."""
    path = tmp_path / "rig.toml"
    path.write_text(TEXT.replace('chambers = "stroke"', 'chambers = "stroke"\nfree = ["J_M", "A_FR"]'))
    rig = ehsa_ctrl.load_plant(path)
    smooth = rig.with_structure(replace(rig.structure, rod_friction="viscous"))

    for plant, free in ((smooth, ("J_M",)), (replace(rig, free=("J_M", "M")), ("J_M", "M"))):
        assert ehsa_ctrl.load_plant(write_plant(tmp_path / "written.toml", plant, force=True)).free == free


def test_an_effects_own_symbol_never_goes_to_both_models(tmp_path):
    """A symbol that stood at its typical value, unwritten, is set: the linear model must not hear of it."""
    path = tmp_path / "rig.toml"
    path.write_text(TEXT.replace('chambers = "stroke"', 'chambers = "stroke"\neffects = ["torque_ripple"]'))
    rig = ehsa_ctrl.load_plant(path, settings={"n_c": 7.0})

    written = write_plant(tmp_path / "written.toml", rig)

    assert ehsa_ctrl.load_plant(written)["n_c"] == 7.0
    assert "n_c" not in ehsa_ctrl.load_plant(written, model="linear").parameters


def test_sensors_and_loads_are_written_with_what_is_known_of_them(plant, tmp_path):
    """Words of a sensor that state their provenance keep it; symbols of the load go to its table."""
    lag = Parameter("p1 filter", 5e-3, "s", "identified", sd=1e-4, note="diagnosed")
    sensors = {
        **plant.sensors,
        "p1": replace(plant.sensors["p1"], filter=5e-3, bias=1e4, stated=(*plant.sensors["p1"].stated, lag)),
        "current": replace(plant.sensors["current"], scale=1.1, delay=2e-3, filter=1e-3),
    }
    rig = replace(plant.set(k_3=1e6, F_0=200.0, m_L=12.0), sensors=sensors)

    path = write_plant(tmp_path / "rig.toml", rig)

    again = ehsa_ctrl.load_plant(path)
    assert again.sensors == rig.sensors and again.values == rig.values
    stated = next(p for p in again.sensors["p1"].stated if p.name == "p1 filter")
    assert (stated.sd, stated.source, stated.note) == (1e-4, "identified", "diagnosed")
    assert "force = {value = 200.0" in path.read_text()


def test_what_never_happens_is_written_as_infinite(plant, tmp_path):
    """A valve that does not open, in either direction."""
    rig = plant.with_effects("relief_valve", "anti_cavitation", P_crack=float("inf"), P_open=float("-inf"))
    rig = replace(rig, parameters={**rig.parameters, "P_crack": replace(rig.parameters["P_crack"], sd=1e5)})

    again = ehsa_ctrl.load_plant(write_plant(tmp_path / "rig.toml", rig, force=True))

    assert again.values == rig.values
