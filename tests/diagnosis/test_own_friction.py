"""A friction law of a user's own project, also with a parameter of its own."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl as e
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core import registry
from ehsa_ctrl.physics.friction import LAWS, FrictionLaw, FrictionParameter
from ehsa_ctrl.plant.linearise import linearise

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "own-friction.md"
#: The parameter of the page's second law in a plant's TOML.
DRAG = 'E_FR = { value = 4e4, unit = "N s2/m2", source = "identified", sd = 4e3 }'


@pytest.fixture
def friction_law(tmp_path, monkeypatch):
    """Write a friction law into friction/ of a project, which becomes the current folder."""

    def write(name, symbol, effort):
        folder = tmp_path / "friction"
        folder.mkdir()
        (folder / f"{name}.py").write_text(
            "from ehsa_ctrl.physics.friction import FrictionLaw\n"
            f"def effort(direction: float, speed: float, A: float, {symbol}: float) -> float:\n"
            f"    return {effort}\n"
            f"law = FrictionLaw({name!r}, {effort!r}, effort, sticks=True)\n",
            encoding="utf-8",
        )
        monkeypatch.chdir(tmp_path)

    return write


@pytest.fixture
def drag(tmp_path, monkeypatch):
    """The current folder is a project with the page's law of quadratic drag and a plant `rig` that has it."""
    (text,) = re.findall(r'```python title="friction/drag.py"\n(.*?)```', PAGE.read_text(encoding="utf-8"), re.DOTALL)
    shipped = e.plants.ehsa.read_text(encoding="utf-8")
    head, nonlinear, tail = shipped.partition("[nonlinear]")
    tail = tail.replace('rod_friction = "stribeck"', 'rod_friction = "drag"')
    tail = re.sub(r"(C|tau)_FR = .*\n", "", tail).replace("[nonlinear.parameters]", f"[nonlinear.parameters]\n{DRAG}")
    for file, content in (("friction/drag.py", text), ("plants/rig.toml", head + nonlinear + tail)):
        (tmp_path / file).parent.mkdir()
        (tmp_path / file).write_text(content, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_PROJECTS", [])
    return tmp_path


@pytest.mark.slow
def test_a_law_that_8_does_not_contain_stays_in_a_diagnosis(friction_law, plant):
    """Quadratic instead of viscous friction; the cause is leakage."""
    friction_law("quadratic", "B", "direction * A + B * speed * abs(speed)")
    nominal = plant.with_structure(e.Structure("stribeck", "quadratic")).set(B_FR=1e5, K_S="50 kN/m")
    rig = nominal.set(K_L=4e-12)
    log, _ = e.record(rig, *e.excitation("noise", amplitude=3.0, duration=16.0, sample_time=0.004), centre=True)
    found = e.diagnose(nominal, log)

    assert [cause.id for cause in found.effects] == ["internal_leakage"], str(found)
    assert found.improved.structure.rod_friction == "quadratic"


def test_a_symbol_that_friction_does_not_know_is_an_error(friction_law):
    """With the symbols that there are."""
    friction_law("steep", "n", "direction * A * abs(speed) ** n")

    with pytest.raises(e.InputError, match=r"friction law steep: 'n' is neither .*; declare it in `parameters`"):
        len(LAWS)


def test_a_friction_law_of_a_project_is_taken(friction_law, plant):
    """friction/ beside plants/: a law by its name, compiled as all are."""
    friction_law("steep", "B", "direction * A + B * speed * abs(speed)")
    steep = plant.with_structure(e.Structure("stribeck", "steep"))

    assert "steep" in LAWS
    assert e.simulate(steep, np.full(50, 1.5))["x"][-1] > e.simulate(plant, np.full(50, 1.5))["x"][-1]


def test_an_own_parameter_is_declared(drag):
    """With unit, range and meaning; listed, in the plant's TOML, set for one run, with a value out of range refused."""
    listed = json.loads(CliRunner().invoke(app, ["list", "friction", "--json"]).stdout)["friction"]["drag"]
    rig = e.load_plant("rig")
    (kind,) = (kind for kind in rig.structure.equations.parameters if kind.name == "E_FR")

    assert "E: quadratic drag (N m s2/rad2 or N s2/m2)" in listed
    assert (kind.unit, kind.meaning, kind.lower) == ("N s2/m2", "quadratic drag, rod", 0.0)
    assert rig["E_FR"] == 4e4 and "E_FR" in rig.free
    assert rig.set(E_FR="80 kN s2/m2")["E_FR"] == 8e4
    with pytest.raises(e.InputError, match="E_FR = -1 N s2/m2"):
        rig.set(E_FR=-1.0)
    assert not CliRunner().invoke(app, ["check", "plants/rig.toml"]).exception


def test_an_own_parameter_acts(drag):
    """At its absent value the law is Coulomb and viscous friction; more holds the rod back; the linear model has it."""
    rig, current = e.load_plant("rig"), np.full(100, 2.0)
    plain = e.simulate(rig.with_structure(e.Structure("stribeck", "coulomb")), current)["x"]

    assert (e.simulate(rig.set(E_FR=0.0), current)["x"] == plain).all()
    assert e.simulate(rig, current)["x"][-1] < plain[-1]
    slower = [linearise(rig.set(E_FR=drag), velocity=0.05).A for drag in (0.0, 4e4)]
    v = [s.name for s in rig.structure.equations.states].index("v")
    mass = rig["M"] + rig["m_L"]
    assert slower[1][v, v] - slower[0][v, v] == pytest.approx(-2 * 4e4 * 0.05 / mass, rel=1e-6)


def test_a_law_with_a_state_may_have_its_own_parameters(plant, tmp_path, monkeypatch):
    """Dahl's law with its level and stiffness under own symbols; the linear model is about steady sliding."""
    (tmp_path / "friction").mkdir()
    (tmp_path / "friction" / "dahl.py").write_text(
        "from ehsa_ctrl.physics.friction import FrictionLaw, FrictionParameter\n"
        "def state_rate(speed: float, z: float, F_c: float, s: float) -> float:\n"
        "    return speed - s * abs(speed) * z / F_c\n"
        "def effort(speed: float, z: float, z_dot: float, B: float, s: float) -> float:\n"
        "    return s * z + B * speed\n"
        "own = (FrictionParameter('F_c', '{effort}', 'Coulomb level', lower_open=True),\n"
        "       FrictionParameter('s', '{effort}/{length}', 'stiffness', lower_open=True))\n"
        "law = FrictionLaw('dahl', 's z + B v', effort, sticks=False, state_rate=state_rate, parameters=own)\n",
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    dahl = plant.with_structure(e.Structure("stribeck", "dahl"), F_c_FR=800.0, s_FR=1e7)
    current = np.full(50, 2.0)

    assert LAWS["dahl"].steady_state(-0.05, {"F_c": 800.0, "s": 1e7}) == pytest.approx(-8e-5)
    assert e.simulate(dahl, current)["z_R"][-1] == pytest.approx(8e-5, rel=1e-3)
    assert np.isfinite(linearise(dahl, velocity=0.05).A).all()


@pytest.mark.slow
def test_an_own_parameter_is_identified(drag):
    """From a wrong start, with its standard deviation; --set reads it with a unit."""
    call = ["simulate", "rig", "--excitation", "noise", "--amplitude", "3", "--duration", "12", "--centre"]
    fit = ["identify", "logs/log.csv", "--plant", "rig", "--model", "nonlinear", "--set", "E_FR=15 kN s2/m2"]
    for arguments in ([*call, "--out", "logs"], [*fit, "--out", "results"]):
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 0, result.output
    found = json.loads((drag / "results" / "identification.json").read_text())["parameters"]["E_FR"]

    assert found["unit"] == "N s2/m2" and found["identifiable"]
    assert abs(found["value"] - 4e4) < 4 * found["sd"] < 2e4
    assert e.load_plant(drag / "results" / "rig_identified.toml")["E_FR"] == pytest.approx(found["value"])


def effort(direction: float, speed: float, A: float) -> float:
    """F = A sign(v)."""
    return direction * A


@pytest.mark.parametrize(
    ("parameter", "says"),
    [
        (("A", "{effort}", "again"), "the parameter 'A' is declared already; rename it"),
        (("E", "1", "unused"), "no function uses the parameter 'E'; leave it out"),
        (("z", "1", "state"), "friction parameter 'z': expected a Python name other than direction, speed, z, z_dot"),
        (("E", "1", "range", 2.0, 1.0), "friction parameter E: lower = 2, upper = 1; expected lower < upper"),
    ],
)
def test_a_wrong_declaration_is_an_error(parameter, says):
    """Law or parameter, and what to change."""
    with pytest.raises(TypeError, match=re.escape(says)):
        FrictionLaw("wrong", "A sign(v)", effort, sticks=True, parameters=(FrictionParameter(*parameter),))


def test_a_name_that_the_system_has_is_an_error(plant, tmp_path, monkeypatch):
    """F of a law for the rod would be F_FR, the friction force itself."""
    (tmp_path / "friction").mkdir()
    (tmp_path / "friction" / "clash.py").write_text(
        "from ehsa_ctrl.physics.friction import FrictionLaw, FrictionParameter\n"
        "def effort(direction: float, speed: float, F: float) -> float:\n"
        "    return direction * F\n"
        "own = (FrictionParameter('F', '{effort}', 'level'),)\n"
        "law = FrictionLaw('clash', 'F sign(v)', effort, sticks=True, parameters=own)\n",
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)

    with pytest.raises(e.InputError, match="its parameter 'F' becomes F_FR, which is also a name of the system 'ehsa'"):
        e.Structure("stribeck", "clash")
