"""`ehsa-ctrl new`: what it writes is valid as it stands, and teaches."""

import json
import re
import tomllib
from pathlib import Path

import pytest

from ehsa_ctrl.cli.template.controller import controller_toml
from ehsa_ctrl.cli.template.plant import plant_toml
from ehsa_ctrl.cli.template.scenario import base_of, reference_kinds, scenario_toml
from ehsa_ctrl.core.catalogue import controllers, plants, scenarios
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.core.described import keys
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.plant.file import PlantFile
from ehsa_ctrl.plant.plant import load_plant
from ehsa_ctrl.scenario.definition import ScenarioFile
from ehsa_ctrl.scenario.metrics import METRICS


def titled(content):
    return {**content, "title": ""}


@pytest.mark.parametrize(
    ("write", "path"),
    [
        *((plant_toml, plants[name]) for name in plants),
        *((controller_toml, controllers[name]) for name in controllers),
        *((scenario_toml, scenarios[name]) for name in scenarios),
    ],
    ids=lambda value: value.stem if isinstance(value, Path) else "",
)
def test_a_template_is_its_base_with_comments(write, path):
    """Nothing but the title is another: what the base passes, the new file passes."""
    text = write(path.stem, "mine")

    assert titled(tomllib.loads(text)) == titled(tomllib.loads(path.read_text()))
    assert tomllib.loads(text)["title"] == f"mine, begun as {path.stem}"


def switched_on(text):
    """Every table that is switched off, with its keys: the whole file with that one on."""
    lines = text.splitlines()
    for i, line in enumerate(lines):
        if not re.match(r"#\[", line):
            continue
        end = next((k for k in range(i + 1, len(lines)) if not lines[k] or lines[k].startswith("[")), len(lines))
        on = [*lines[:i], *(re.sub(r"^#(?! )", "", other) for other in lines[i:end]), *lines[end:]]
        yield line, "\n".join(on)


@pytest.mark.parametrize("kind", CONTROLLER_KINDS)
def test_what_is_switched_off_in_a_controller_can_be_switched_on(kind):
    """Each table with all keys that it offers; the rivals [design], [tuning], [gains] ask that one goes."""
    name = next(name for name in controllers if tomllib.loads(controllers[name].read_text())["kind"] == kind)
    tried = 0
    for table, text in switched_on(controller_toml(name, "mine")):
        content = tomllib.loads(text)
        if table == "#[rest.knocker]":
            content["rest"] |= {"band": "40 um"}
        if (word := table.strip("#[]")) in ("design", "tuning", "gains"):
            content = {key: item for key, item in content.items() if key not in {"design", "tuning", "gains"} - {word}}
        validate(content, CONTROLLER_KINDS[kind].file, table)
        tried += 1

    assert tried >= 2


def test_what_is_switched_off_in_a_scenario_can_be_switched_on():
    """Load, settings, disturbance, each fault, sensors, supervision, baseline, spread."""
    text = scenario_toml("long_move", "mine")
    tables = [table for table, on in switched_on(text) if validate(tomllib.loads(on), ScenarioFile, table)]

    assert {"#[load]", "#[settings]", "#[[disturbance]]", "#[sensors]", "#[supervision]", "#[spread]"} <= set(tables)
    assert tables.count("#[[fault]]") == 3


def test_what_is_switched_off_in_a_plant_can_be_switched_on(tmp_path):
    """The columns of somebody else's log, every number of a sensor, the parameters of an effect with that effect."""
    text = plant_toml("ehsa", "mine")
    for _, on in switched_on(text):
        validate(tomllib.loads(on), PlantFile, "mine.toml")
    path = tmp_path / "mine.toml"
    one = re.sub(r"^#((?:width|step|filter|delay|scale|bias) = { value)", r"\1", text, flags=re.MULTILINE)
    path.write_text(one.replace("[nonlinear]\n", '[nonlinear]\neffects = ["backlash"]\n'))
    plant = load_plant(path)

    assert plant["width"] == 1e-3
    assert plant.sensors["current"].delay == 4e-3
    (_, with_log) = next(item for item in switched_on(text) if item[0] == "#[log]")
    path.write_text(with_log)
    assert load_plant(path).log["p1"].scale == 1e5


def test_every_key_is_in_the_template():
    """Set, switched off, or in words: a user finds out about it without leaving the file."""
    for name in controllers:
        text, form = (
            controller_toml(name, "mine"),
            CONTROLLER_KINDS[tomllib.loads(controllers[name].read_text())["kind"]],
        )
        assert all(re.search(rf"\b{key.name}\b", text) for key in keys(form.file))
    text = scenario_toml("steps_spring", "mine")
    assert all(re.search(rf"\b{key.name}\b", text) for key in keys(ScenarioFile))
    assert all(re.search(rf"^#?{name} = ", text, re.MULTILINE) for name in METRICS)
    text = plant_toml("ehsa", "mine")
    for word in ("linear", "nonlinear"):
        for name, kind in {k.name: k for k in load_plant("ehsa", model=word).structure.equations.parameters}.items():
            assert kind.meaning.split(" (")[0] in text, name


@pytest.mark.parametrize("kind", reference_kinds())
def test_a_scenario_of_each_kind_of_reference_is_found_by_name_and_valid(run, tmp_path, kind):
    """It lands in ./scenarios, with the trajectory that it needs, and `check` has nothing to say."""
    status, out, _ = run("new", "scenario", "mine", "--kind", kind)

    assert status == 0
    assert "ehsa-ctrl check scenarios/mine.toml" in out
    assert tomllib.loads((tmp_path / "scenarios" / "mine.toml").read_text())["reference"]["kind"] == kind
    assert run("check", "scenarios/mine.toml")[0] == 0
    assert base_of(kind) in scenarios


@pytest.mark.parametrize("kind", [kind for kind in CONTROLLER_KINDS if kind != "scheduled_pid"])
def test_a_controller_of_each_kind_is_found_by_name_and_valid(run, kind):
    """`check` designs it."""
    assert run("new", "controller", "--kind", kind)[0] == 0

    assert run("check", f"controllers/my_{kind}.toml")[0] == 0


@pytest.mark.slow
def test_a_project_of_ones_own_runs(run, tmp_path):
    """Plant, controller and scenario by `new`, each referring to the other by name: a scenario that passes."""
    assert run("new", "plant", "rig")[0] == 0
    assert run("new", "controller", "mine", "--kind", "pid")[0] == 0
    assert run("new", "scenario", "steps", "--plant", "rig", "--controller", "mine")[0] == 0

    assert run("check", "plants/rig.toml", "scenarios/steps.toml")[0] == 0
    status, out, _ = run("run", "steps", "--json")
    (result,) = json.loads(out)["scenarios"]
    assert status == 0 and result["controller"] == "mine"


def test_new_refuses_to_overwrite_and_says_what_it_wrote(run, tmp_path):
    """A second call needs --force; --json has the files and the next commands."""
    status, out, _ = run("new", "plant", "--json")
    told = json.loads(out)
    path = tmp_path / told["written"][0]
    assert status == 0 and path == tmp_path / "plants" / "my_ehsa.toml"
    path.write_text("mine")

    status, out, err = run("new", "plant")
    assert status == 2 and "--force" in err and out == "" and path.read_text() == "mine"
    assert run("new", "plant", "--force")[0] == 0
    assert path.read_text() != "mine"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["plant", "a/b"], "is no name"),
        (["plant", "--from", "ehsb"], "did you mean 'ehsa'"),
        (["controller", "--kind", "lqg"], "no such kind of controller"),
        (["controller", "--kind", "lqr", "--from", "pid_position"], "is a 'pid' controller"),
        (["scenario", "--kind", "stairs"], "no such kind of reference"),
        (["scenario", "--kind", "sine", "--from", "steps_spring"], "'steps'"),
        (["scenario", "--plant", "rig"], "no plant 'rig'"),
        (["scenario", "--controller", "none"], "no controller 'none'"),
        (["valve"], "No such command 'valve'"),
    ],
)
def test_wrong_input_writes_nothing(run, tmp_path, arguments, says):
    """One sentence, status 2, no folder."""
    status, out, err = run("new", *arguments)

    assert status == 2 and says in err and out == ""
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_shipped_name_that_is_taken_over_is_said(run):
    """./plants/ehsa.toml is found first from then on."""
    status, _, err = run("new", "plant", "ehsa")

    assert status == 0 and "no longer found from this folder" in err
