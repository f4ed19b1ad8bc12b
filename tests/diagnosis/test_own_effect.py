"""An effect of a user's own project, as the documentation writes it, is found, simulated, linearised and diagnosed."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl as e
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core import registry
from ehsa_ctrl.diagnosis.hypothesis_model import inapplicable_effects, with_every_effect
from ehsa_ctrl.physics.effects import EFFECTS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "own-effect.md"
TITLE = 'title="effects/seal_pressure_friction.py"'


@pytest.fixture
def project(tmp_path, monkeypatch):
    """The current folder, with the page's file in effects/."""
    text = re.search(rf"```python {TITLE}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL).group(1)
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "seal_pressure_friction.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_PROJECTS", [])
    return tmp_path


def test_it_is_there_in_its_project_and_nowhere_else(project, tmp_path_factory, monkeypatch):
    """In lists and by name; another folder knows nothing of it."""
    listed = CliRunner().invoke(app, ["list", "effects"]).output
    there = "seal_pressure_friction" in EFFECTS
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))

    assert there and "seal_pressure_friction" in listed
    assert "seal_pressure_friction" not in EFFECTS


def test_one_file_may_hold_several(project, plant):
    """A tuple `effects` adds each of them."""
    text = (project / "effects" / "seal_pressure_friction.py").read_text(encoding="utf-8")
    second = text.replace("seal_pressure_friction", "wiper_friction").replace("k_seal", "k_wiper")
    tail = "\n\neffects = (effect, second)\n"
    both = text + "\n" + second.split("import Effect, EffectParameter")[1].replace("effect = ", "second = ") + tail
    (project / "effects" / "seal_pressure_friction.py").write_text(both, encoding="utf-8")

    assert {"seal_pressure_friction", "wiper_friction"} <= set(EFFECTS)
    assert {"k_seal", "k_wiper"} <= set(plant.with_effects("seal_pressure_friction", "wiper_friction").parameters)


def test_a_plant_that_is_named_brings_its_project(project, tmp_path_factory, monkeypatch):
    """plants/rig.toml of another folder finds the effects/ beside plants/."""
    (project / "plants").mkdir()
    shipped = e.plants.ehsa.read_text(encoding="utf-8")
    wired = shipped.replace('chambers = "stroke"', 'chambers = "stroke"\neffects = ["seal_pressure_friction"]')
    (project / "plants" / "rig.toml").write_text(wired, encoding="utf-8")
    monkeypatch.chdir(tmp_path_factory.mktemp("elsewhere"))

    assert "k_seal" in e.load_plant(project / "plants" / "rig.toml").parameters


def test_neutral_changes_nothing_and_more_holds_the_rod_back(project, plant):
    """As the page prints it; the linearised plant feels it too."""
    current = 1.5 * np.sin(np.linspace(0, 12, 751))
    base = e.simulate(plant, current)
    neutral = e.simulate(plant.with_effects("seal_pressure_friction", k_seal=0.0), current)
    typical = e.simulate(plant.with_effects("seal_pressure_friction", k_seal=5e-5), current)

    assert (neutral["x"] == base["x"]).all()
    assert f"{1e3 * base['x'].max():.1f} mm, with the effect {1e3 * typical['x'].max():.1f} mm" in PAGE.read_text()


def test_a_changed_file_is_read_again(project, plant):
    """By the next plant that is loaded; one that was loaded before keeps its equations, also in another process."""
    file, current = project / "effects" / "seal_pressure_friction.py", np.full(100, 2.0)
    before = plant.with_effects("seal_pressure_friction", k_seal=5e-5)
    found = e.simulate(before, current)["x"]
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("max(0.5", "max(5.0"), encoding="utf-8")
    after = e.load_plant("ehsa").with_effects("seal_pressure_friction", k_seal=5e-5)

    assert "max(0.5" in text
    assert (e.simulate(before, current)["x"] == found).all()
    assert e.simulate(after, current)["x"][-1] < found[-1]
    assert pickle.loads(pickle.dumps(after)).structure.equations is after.structure.equations


def test_projects_may_have_effects_of_one_name(project, plant, tmp_path_factory, monkeypatch):
    """Each plant has the equations of its project."""
    current = np.full(100, 2.0)
    here = e.simulate(plant.with_effects("seal_pressure_friction", k_seal=5e-5), current)["x"]
    text = (project / "effects" / "seal_pressure_friction.py").read_text(encoding="utf-8")
    other = tmp_path_factory.mktemp("other") / "effects"
    other.mkdir()
    (other / "mine.py").write_text(text.replace("max(0.5", "max(5.0"), encoding="utf-8")
    monkeypatch.chdir(other.parent)

    assert e.simulate(plant.with_effects("seal_pressure_friction", k_seal=5e-5), current)["x"][-1] < here[-1]


@pytest.mark.slow
def test_it_is_diagnosed(project, plant):
    """A log of a rig that has it names it, with its size."""
    rig = plant.with_effects("seal_pressure_friction", k_seal=1.5e-4)
    log, _ = e.record(rig, *e.excitation("noise", amplitude=3.0, duration=16.0, sample_time=0.004), centre=True)
    found = e.diagnose(plant, log)

    named = {cause.id for cause in found.effects} | {id for cause in found.effects for id in cause.ambiguous_with}
    assert "seal_pressure_friction" in named, str(found)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("import nothing_of_that_name\n", "can't be run: ModuleNotFoundError"),
        ("effect = 3\n", "must define `effect`, of type Effect"),
        ("def (:\n", "can't be run: SyntaxError"),
        (
            "from ehsa_ctrl.physics.effects import Effect\n"
            "effect = Effect(name='torque_ripple', place='torque', summary='', fingerprint='')\n",
            "the name 'torque_ripple' is already in use",
        ),
    ],
)
def test_a_wrong_file_is_a_sentence(tmp_path, monkeypatch, text, says):
    """Which file, and what is wrong with it."""
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "mine.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    with pytest.raises(e.InputError, match=re.escape(says)):
        len(EFFECTS)


def test_the_command_line_names_the_files_that_it_executes(project):
    """On standard error: a project may be someone else's."""
    result = CliRunner().invoke(app, ["list", "effects"])

    assert f"effects of this project: seal_pressure_friction (from {project / 'effects'})" in result.stderr


def test_an_argument_that_nothing_defines_is_an_error(project, plant):
    """Error of a plant that has it, and warning of a diagnosis: with the file, the name and the nearest known one."""
    file = project / "effects" / "seal_pressure_friction.py"
    text = file.read_text(encoding="utf-8").replace("P_2", "PP_2").replace("seal_pressure_friction", "misspelt")
    file.write_text(text, encoding="utf-8")
    says = rf"{re.escape(str(file))}, function friction, needs 'PP_2'.* did you mean 'P_2'"

    with pytest.raises(e.InputError, match=says):
        _ = plant.with_effects("misspelt").parameters
    assert re.search(says, inapplicable_effects(plant)["misspelt"])


def test_a_name_that_another_effect_has_is_an_error(project, plant):
    """A diagnosis runs all effects in one model, where they would share the number."""
    file = project / "effects" / "seal_pressure_friction.py"
    file.write_text(file.read_text(encoding="utf-8").replace("k_seal", "k_w"), encoding="utf-8")

    with pytest.raises(e.InputError, match=r"'k_w' of '\w+' is also a name in the effect '\w+'; rename one"):
        with_every_effect(plant)


def test_an_effect_with_a_state_is_found(project, plant):
    """The page's example: what it has stored up to the held-out data comes from the log."""
    (text,) = re.findall(
        r'```python title="an effect with a state"\n(.*?)```', PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    (project / "effects" / "warm_leakage.py").write_text(text, encoding="utf-8")
    current = 2.5 * np.sin(np.linspace(0, 12, 751))
    plant = plant.set(K_S="50 kN/m")
    base = e.simulate(plant, current)
    neutral = e.simulate(plant.with_effects("warm_leakage", k_heat=0.0), current)
    felt = e.simulate(plant.with_effects("warm_leakage"), current)

    assert (neutral["x"] == base["x"]).all()
    assert felt["W_pump"][-1] > 100.0
    assert not inapplicable_effects(plant)
