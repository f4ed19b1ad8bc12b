"""The exported plant in another tool's hands, FMPy's, against our own engine."""

import subprocess
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl import InputError, export_fmu, load_plant, simulate

fmpy = pytest.importorskip("fmpy")

#: Run in a process of its own: pythonfmu's binary may abort the process that loaded it when that ends.
PROGRAM = """
import os, sys
import numpy as np
from fmpy import extract, read_model_description, simulate_fmu
path, out = sys.argv[1:]
kept = {}
{body}
np.savez(out, **kept)
os._exit(0)
"""


def in_fmpy(path, body, tmp_path):
    """Variables that `body` puts into the dictionary `kept`."""
    out = tmp_path / "kept.npz"
    program = PROGRAM.replace("{body}", body)
    done = subprocess.run([sys.executable, "-c", program, path, out], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    return dict(np.load(out)), done.stdout


SIGNALS = """
time = 0.004 * np.arange(201)
current = np.where(time < 0.2, 1.6, np.where(time < 0.5, -1.6, 0.0))
force = np.where(time > 0.6, 900.0, 0.0)
rows = np.array(list(zip(time, current, force)), dtype=[("time", "f8"), ("current", "f8"), ("F_D", "f8")])
"""
RUN = """
found = simulate_fmu(path, input=rows, stop_time=0.8, step_size={step}, output_interval={step}, start_values={values})
kept.update({{name: found[name] for name in found.dtype.names}})
"""
STATES = ("speed", "p1", "p2", "velocity", "position")


def own_run(plant):
    given = {}
    exec(SIGNALS, {"np": np}, given)
    return simulate(plant, given["current"], force=given["force"])


@pytest.mark.slow
def test_fmpy_gives_what_the_engine_gives(plant, tmp_path):
    """A spring load, a plant with an effect, a symbol set by the tool: all states, and when shaft and rod stick."""
    loaded = plant.set(K_S=5e4).with_effects("entrained_air")
    path = export_fmu(loaded, tmp_path / "rig.fmu")
    found, _ = in_fmpy(path, SIGNALS + RUN.format(step=0.004, values={"K_T": 1.1}), tmp_path)
    run = own_run(loaded.set(K_T=1.1))

    for name, state in zip(STATES, ("omega", "P_1", "P_2", "v", "x"), strict=True):
        assert np.max(np.abs(found[name] - run[state])) < 1e-9 * np.ptp(run[state]), name
    for contact in ("shaft", "rod"):
        assert np.array_equal(found[f"{contact}_sticks"].astype(bool), run.sticks(contact))
    assert run.sticks("rod")[10:].any()


@pytest.mark.slow
def test_a_master_with_other_steps_comes_to_the_same(plant, tmp_path):
    """1 ms steps of an input that changes every 4 ms."""
    path = export_fmu(plant, tmp_path / "rig.fmu")
    fine = "fine = np.repeat(rows[:-1], 4); fine['time'] = 0.001 * np.arange(fine.size); rows = fine\n"
    found, _ = in_fmpy(path, SIGNALS + fine + RUN.format(step=0.001, values={}), tmp_path)
    run = own_run(plant)

    assert np.max(np.abs(found["position"][::4] - run["x"])) < 1e-4 * np.ptp(run["x"])
    assert np.max(np.abs(found["speed"][::4] - run["omega"])) < 1e-4 * np.ptp(run["omega"])


@pytest.mark.slow
def test_its_state_can_be_set_back_also_from_bytes(plant, tmp_path):
    """Same inputs after going back, same end; a symbol that comes too late is refused in words."""
    path = export_fmu(plant, tmp_path / "rig.fmu")
    body = """
from fmpy.fmi2 import FMU2Slave
about = read_model_description(path)
place = {v.name: v.valueReference for v in about.modelVariables}
fmu = FMU2Slave(guid=about.guid, unzipDirectory=extract(path), modelIdentifier="ehsa", instanceName="one")
fmu.instantiate(loggingOn=True)
fmu.setupExperiment(tolerance=1e-8)
fmu.enterInitializationMode()
fmu.setReal([place["P_0"]], [30e5])
kept["p1"] = fmu.getReal([place["p1"]])
fmu.exitInitializationMode()
def go(current):
    fmu.setReal([place["current"]], [current])
    for k in range(25):
        fmu.doStep(0.004 * k, 0.004)
    return fmu.getReal([place[name] for name in ("speed", "position")])
go(1.6)
state = fmu.getFMUState()
text = fmu.serializeFMUState(state)
kept["first"] = go(-1.6)
fmu.setFMUState(state)
kept["again"] = go(-1.6)
fmu.setFMUState(fmu.deSerializeFMUstate(text))
kept["read"] = go(-1.6)
try:
    fmu.setReal([place["K_T"]], [1.0])
except Exception as error:
    print(error)
"""
    found, said = in_fmpy(path, body, tmp_path)

    assert found["p1"] == 30e5
    assert np.array_equal(found["first"], found["again"]) and np.array_equal(found["first"], found["read"])
    assert "set it before the initialisation ends" in said


def test_the_description_is_valid_and_says_units_and_meanings(plant, tmp_path):
    """FMPy finds nothing wrong; every symbol of the plant is a parameter with its value, unit and range."""
    from fmpy import read_model_description
    from fmpy.validation import validate_fmu

    path = str(export_fmu(plant, tmp_path / "rig.fmu"))
    described = {variable.name: variable for variable in read_model_description(path).modelVariables}

    assert validate_fmu(path) == []
    for name, parameter in plant.parameters.items():
        if np.isinf(parameter.value):
            # A switched-off limit, such as the gap of a load that is attached, is no number of the description.
            assert name not in described
            continue
        variable = described[name]
        assert (float(variable.start), variable.unit) == (parameter.value, parameter.unit)
        assert variable.causality == "parameter" and parameter.source in variable.description
    assert float(described["J_M"].min) == 0.0
    assert (described["current"].causality, described["F_D"].unit) == ("input", "N")
    assert {v.name for v in described.values() if v.causality == "output"} == {
        *STATES,
        "force",
        "shaft_sticks",
        "rod_sticks",
    }
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    (torque,) = [unit for unit in root.iterfind("UnitDefinitions/Unit") if unit.get("name") == "N m/A"]
    assert torque[0].attrib == {"kg": "1", "m": "2", "s": "-2", "A": "-1"}


@pytest.mark.parametrize("name", ["emps", "mbari_pto"])
def test_other_systems_can_be_exported_too(name, tmp_path):
    """Their own inputs, and a description without faults."""
    from fmpy import read_model_description
    from fmpy.validation import validate_fmu

    plant = load_plant(name)
    path = str(export_fmu(plant, tmp_path / f"{name}.fmu"))
    inputs = [v.name for v in read_model_description(path).modelVariables if v.causality == "input"]

    assert validate_fmu(path) == []
    assert inputs == list(plant.structure.system.inputs)


def test_the_plant_inside_is_the_plant_to_the_last_digit(plant, tmp_path):
    """Structure, effects and values are those that were exported, whatever the file on disk says."""
    from ehsa_ctrl.simulation.fmu.exported import read_exported

    odd = plant.with_effects("relief_valve", P_crack=1.23456789012345e7).set(K_T=1.0 / 3.0)
    with zipfile.ZipFile(export_fmu(odd, tmp_path / "rig.fmu")) as archive:
        archive.extractall(tmp_path / "unzipped")
    again, version = read_exported(tmp_path / "unzipped" / "resources")

    assert (again.values, again.structure, version) == (odd.values, odd.structure, ehsa_ctrl.__version__)


def test_what_cannot_be_written_is_a_sentence(plant, tmp_path, monkeypatch):
    """Another ending, a file that is there, and a machine without pythonfmu."""
    with pytest.raises(InputError, match=r"ends in \.fmu"):
        export_fmu(plant, tmp_path / "rig.zip")
    (tmp_path / "rig.fmu").write_text("mine")
    with pytest.raises(InputError, match="already exists"):
        export_fmu(plant, tmp_path / "rig.fmu")
    monkeypatch.setitem(sys.modules, "pythonfmu.builder", None)
    with pytest.raises(InputError, match=r'pip install "ehsa_ctrl\[fmu\]"'):
        export_fmu(plant, tmp_path / "other.fmu")
