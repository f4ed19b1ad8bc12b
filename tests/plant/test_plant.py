"""Plants from TOML: every mistake is one sentence with file and key."""

import shutil

import pytest

from ehsa_ctrl import InputError, Structure, load_plant
from ehsa_ctrl.core.catalogue import plants
from ehsa_ctrl.core.parameter import SOURCES
from ehsa_ctrl.physics.effects import EFFECTS

TEXT = plants["ehsa"].read_text()


@pytest.fixture
def edited(tmp_path):
    """A copy of the paper's plant with one piece of text replaced."""

    def edit(old, new):
        assert old in TEXT
        path = tmp_path / "rig.toml"
        path.write_text(TEXT.replace(old, new, 1))
        return path

    return edit


@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_every_number_has_unit_and_source(model):
    """Every number of the catalogue has unit and source."""
    plant = load_plant("ehsa", model=model)

    for parameter in [*plant.parameters.values(), *plant.limits.values()]:
        assert parameter.source in SOURCES, parameter
        assert parameter.unit, parameter


def test_table_2_is_what_the_paper_prints(plant, linear):
    """A few entries of Table 2, and Table 1 in SI units."""
    assert plant["J_M"] == 3.312e-4 and linear["J_M"] == 3.652e-4
    assert plant["A_FR"] == 854 and plant["C_FR"] == 213
    assert plant["D"] == pytest.approx(5.8887e-7, rel=1e-4)
    assert plant["A"] == pytest.approx(1.52681e-3, rel=1e-4)
    assert plant.limits["pump_speed"].value == pytest.approx(471.2, rel=1e-3)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("M = { value = 16.52, unit", "M = { value = -16.52, unit", r"\[nonlinear.parameters\] M = -16.52 kg: must be"),
        ('value = 854, unit = "N"', 'value = 854, unit = "bar"', r"A_FR: unit 'bar' does not fit: expected .* 'N'"),
        ("A_FR = {", "A_FS = {", r"A_FS: unknown parameter .* did you mean 'A_FR'"),
        ("[limits]\npump_speed", "[limits]\npump_sped", r"pump_sped: unknown limit; did you mean 'pump_speed'"),
        ("[limits]", "[limit]", r"limit: unknown key; did you mean 'limits'"),
        ('rod_friction = "stribeck"', 'rod_friction = "stribek"', r"rod_friction = 'stribek'.*did you mean 'stribeck'"),
        (
            'source = "datasheet", note = "Table 1, bid',
            'source = "guess", note = "Table 1, bid',
            r"D\.?\]? ?source = 'guess'",
        ),
        ("bounds = [0.87, 1.60]", "bounds = [1.3, 1.60]", r"K_T.value = 1.2 N m/A: must be at least 1.3"),
        ("schema = 1", "schema = 1 =", r"is not valid TOML"),
        ("V_20 = {", "V_3 = {", r"V_3: unknown parameter"),
    ],
)
def test_a_mistake_in_the_file_is_one_sentence(edited, old, new, says):
    """File, key, what was got and what was expected."""
    path = edited(old, new)

    with pytest.raises(InputError, match=says) as caught:
        load_plant(path)

    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_parameter_is_named(tmp_path):
    """A plant without C_FR can't use the paper's friction law."""
    lines = [line for line in TEXT.splitlines() if not line.startswith("C_FR")]
    path = tmp_path / "rig.toml"
    path.write_text("\n".join(lines))

    with pytest.raises(InputError, match=r"C_FR \(static minus Coulomb level, rod, N\) is missing"):
        load_plant(path)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"K_TT": 1.0}, "did you mean 'K_T'"),
        ({"load.stifness": 1.0}, "did you mean 'load.stiffness'"),
        ({"M": -1.0}, "must be greater than 0"),
        ({"M": float("nan")}, "must be greater than 0"),
        ({"load.stiffness": "5 kg"}, "does not fit"),
    ],
)
def test_a_wrong_setting_is_one_sentence(settings, says):
    """--set is checked like a file."""
    with pytest.raises(InputError, match=says):
        load_plant("ehsa", settings=settings)


def test_settings_take_units_and_leave_a_trace():
    """50 kN/m equals 50e3; the source of the parameter is then "given"."""
    a = load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    b = load_plant("ehsa", settings={"load.stiffness": 50e3})

    assert a["K_S"] == b["K_S"] == 50e3
    assert a.parameters["K_S"].source == "given"


def test_a_sensors_filter_is_read_and_set(edited):
    """From the file with its unit, or for one run."""
    path = edited("[sensors.p1]", '[sensors.p1]\nfilter = { value = 5, unit = "ms", source = "assumed" }')

    assert load_plant(path).sensors["p1"].filter == 0.005
    assert load_plant(path, settings={"filter.p1": "2 ms"}).sensors["p1"].filter == 0.002
    assert load_plant("ehsa").sensors["p1"].filter == 0.0


@pytest.mark.parametrize("value", ["-1", "inf", "nan"])
def test_an_impossible_filter_is_one_sentence(edited, value):
    """In the file and as a setting."""
    path = edited("[sensors.p1]", f'[sensors.p1]\nfilter = {{ value = {value}, unit = "s", source = "assumed" }}')

    with pytest.raises(InputError, match=r"\[sensors.p1\] filter.* must be"):
        load_plant(path)
    with pytest.raises(InputError, match=r"^filter.p1.* must be"):
        load_plant("ehsa", settings={"filter.p1": value})


def test_what_cant_be_estimated_is_not_free_unless_asked_for(edited):
    """Identified symbols are free, except a dead time and infinite values."""
    symbols = """K_relief = { value = 1e-7, unit = "m3/(s Pa^0.5)", source = "identified" }
P_crack = { value = inf, unit = "Pa", source = "identified" }
T_d = { value = 4, unit = "ms", source = "identified" }
A_FR = {"""
    path = edited("A_FR = {", symbols)
    path.write_text(path.read_text().replace("[nonlinear]", '[nonlinear]\neffects = ["drive_delay", "relief_valve"]'))

    free = set(load_plant(path).free)

    assert free == {*load_plant("ehsa").free, "K_relief"}


def test_the_users_own_folder_comes_first(tmp_path, monkeypatch):
    """A plant in ./plants wins over a shipped one of the same name; others are still found."""
    (tmp_path / "plants").mkdir()
    (tmp_path / "plants" / "ehsa.toml").write_text(TEXT.replace("value = 16.52", "value = 20.0"))
    shutil.copy(plants["ehsa"], tmp_path / "plants" / "mine.toml")
    monkeypatch.chdir(tmp_path)

    assert load_plant("ehsa")["M"] == 20.0
    assert load_plant("mine")["M"] == 16.52
    assert "mine" in plants and "mine" in dir(plants)


def test_an_unknown_plant_offers_the_nearest():
    """The message lists the known names."""
    with pytest.raises(InputError, match="no plant 'ehsb'; did you mean 'ehsa'"):
        load_plant("ehsb")


WIRED = {name: effect for name, effect in EFFECTS.items() if effect.wired}


@pytest.mark.parametrize("effect", WIRED.values(), ids=WIRED)
def test_an_effect_can_be_switched_on_by_name(plant, effect):
    """Every effect with equations has typical parameters within its own bounds."""
    with_effect = plant.with_effects(effect.name)

    for parameter in effect.parameters:
        assert with_effect[parameter.name] == parameter.typical
        assert parameter.lower <= parameter.typical <= parameter.upper


def test_a_structure_that_needs_more_says_what(plant):
    """LuGre without its bristle stiffness is refused with the symbol and its meaning."""
    with pytest.raises(InputError, match=r"sigma_0_FR \(bristle stiffness, rod\)"):
        plant.with_structure(Structure(rod_friction="lugre"))


def test_an_effect_of_friction_needs_a_law_that_has_its_symbol(plant):
    """A tight spot is a share of A_FR, so a plant without A_FR is refused."""
    with pytest.raises(InputError, match="'position_dependent_friction' needs A_FR, which rod_friction = 'viscous'"):
        plant.with_structure(Structure("stribeck", "viscous")).with_effects("position_dependent_friction")
