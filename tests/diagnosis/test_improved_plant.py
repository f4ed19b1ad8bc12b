"""The corrected plant says of each number where it comes from: only what was fitted is called identified."""

import math

import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.improved_plant import improved_plant
from ehsa_ctrl.physics.effects import EFFECTS, CandidateEffect, LawFile, effect_of, law_candidate, with_extended


@pytest.fixture(scope="module")
def plant():
    return ehsa_ctrl.load_plant("ehsa")


def candidate(name):
    return (CandidateEffect(EFFECTS[name], (), ()),)


def test_typical_numbers_of_an_effect_are_not_identified(plant, tmp_path):
    """A check valve's opening was fitted; how much it lets through was not. The file says so, and is read again."""
    better = improved_plant(plant, candidate("anti_cavitation"), {"P_open": -1e4, "K_L": 5e-13}, {"P_open": 900.0})
    again = ehsa_ctrl.load_plant(ehsa_ctrl.write_plant(tmp_path / "better.toml", better))

    for each in (better, again):
        assert each["P_open"] == -1e4 and each.parameters["P_open"].sd == 900.0
        assert each.parameters["P_open"].source == each.parameters["K_L"].source == "identified"
        assert each.parameters["P_open"].note == "cause found by a diagnosis"
        assert each.parameters["K_L"].note == "refitted by a diagnosis"
        for name in ("K_check", "P_lam"):
            assert each.parameters[name].source == "assumed" and each.parameters[name].sd is None
            assert each.parameters[name].note == "typical value of anti_cavitation, not fitted"
            assert each[name] == next(p.typical for p in EFFECTS["anti_cavitation"].parameters if p.name == name)
    untouched = [name for name in plant.parameters if name != "K_L"]
    assert all(better.parameters[name] == plant.parameters[name] for name in untouched)


@pytest.mark.parametrize("name", sorted(n for n, e in EFFECTS.items() if e.wired and e.parameters))
def test_of_every_effect_only_its_size_is_identified(plant, name):
    """Fitted was the size alone; everything else keeps the value at which the search held it."""
    first, *others = EFFECTS[name].parameters
    size = first.typical if first.typical not in (first.neutral, float("inf")) else 0.5 * (first.neutral or 1.0)
    better = improved_plant(plant, candidate(name), {first.name: size}, {first.name: 0.1 * abs(size)})

    assert better.structure.effects == (*plant.structure.effects, *with_extended([name]))
    assert better.parameters[first.name].source == "identified" and better[first.name] == size
    for parameter in others:
        assert better.parameters[parameter.name].source != "identified"
        assert "not fitted" in better.parameters[parameter.name].note
        assert better[parameter.name] == parameter.neutral


def test_what_a_plant_has_of_an_effect_stays(plant):
    """A valve whose flow the modeller knows keeps it when the diagnosis moves its opening."""
    known = plant.with_effects("anti_cavitation", K_check=5e-6, P_open=-2e4)
    better = improved_plant(known, candidate("anti_cavitation"), {"P_open": -1e4}, {})

    assert better["K_check"] == 5e-6 and better.parameters["K_check"] == known.parameters["K_check"]
    assert better["P_open"] == -1e4 and better.parameters["P_open"].source == "identified"


@pytest.mark.parametrize("known", [{}, {"tau_I": 2e-3}], ids=["catalogue", "own"])
def test_a_negligible_effect_is_written_as_absent(plant, known):
    """Also where the plant has it: a lag of 1 us was not simulated, and would make the corrected plant stiff."""
    nominal = plant.with_effects("drive_lag", **known) if known else plant
    better = improved_plant(nominal, candidate("drive_lag"), {"tau_I": 1e-6, "b_I": 1.0}, {})

    assert better["tau_I"] == 0.0


def test_bristles_are_found_by_their_softness(plant):
    """Stiffness is its inverse, with the same relative deviation; a damping that was not fitted is assumed."""
    values, sd = {"softness_FR": 2e-8, "C_FR": 150.0}, {"softness_FR": 2e-9, "C_FR": 10.0}
    better = improved_plant(plant, candidate("presliding"), values, sd)
    damped = improved_plant(plant, candidate("presliding"), values | {"sigma_1_FR": 4e3}, sd | {"sigma_1_FR": 300.0})

    assert better.structure.rod_friction == "lugre"
    assert better["sigma_0_FR"] == pytest.approx(5e7)
    assert better.parameters["sigma_0_FR"].sd == pytest.approx(5e6)
    assert better["sigma_1_FR"] == pytest.approx((plant["M"] * 5e7) ** 0.5)
    assert better.parameters["sigma_1_FR"].source == "assumed"
    assert damped["sigma_1_FR"] == 4e3 and damped.parameters["sigma_1_FR"].source == "identified"
    assert "softness_FR" not in better.parameters


def test_a_law_that_was_just_found_is_in_the_plant(plant):
    """It is known by its name only, not listed in the catalogue."""
    definition = {
        "schema": 1, "status": "proposed", "summary": "cubic drag", "adds_to": "force", "expression": "c_x * v**3",
        "parameters": {"c_x": {"value": 4e5, "unit": "N s3/m3", "neutral": 0.0}},
    }  # fmt: skip
    effect = effect_of("cubic_drag", LawFile.model_validate(definition), "a test")
    EFFECTS.keep("cubic_drag", effect)
    improved = improved_plant(plant, (law_candidate(effect, plant.values),), {"c_x": 3e5}, {"c_x": 1e4})

    assert improved.structure.effects == ("cubic_drag",) and improved["c_x"] == 3e5


def test_a_number_of_which_the_logs_show_nothing_has_no_deviation(plant, tmp_path):
    """The file can be read again."""
    values = {"P_open": -1e4, "bias.speed": 0.1}
    better = improved_plant(plant, candidate("anti_cavitation"), values, {"P_open": math.inf, "bias.speed": math.inf})
    again = ehsa_ctrl.load_plant(ehsa_ctrl.write_plant(tmp_path / "better.toml", better))

    for each in (better, again):
        assert each.parameters["P_open"].sd is None and each.parameters["P_open"].source == "identified"
        assert each.sensors["speed"].bias == 0.1
