"""`ehsa-ctrl new`: what it writes is valid as it stands, and teaches."""

import json
import re
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from ehsa_ctrl.cli.definitions import controller_toml, plant_toml, reference_kinds, scenario_of_kind, scenario_toml
from ehsa_ctrl.cli.template import FOLDER, KeyLine, sections, template
from ehsa_ctrl.core.catalogue import controllers, plants, scenarios
from ehsa_ctrl.core.definition import In, Second, validate
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS, ControllerFile, ControllerKind
from ehsa_ctrl.design.specification import starting_definition
from ehsa_ctrl.plant.file import LOAD_SYMBOLS, PlantFile
from ehsa_ctrl.plant.load import load_plant
from ehsa_ctrl.scenario.definition import ScenarioFile
from ehsa_ctrl.scenario.metrics import METRICS

#: Templates with the model that validates them; a kind of controller may do without one.
FORMS = {
    **{
        f"controller_{name}": kind.file
        for name, kind in CONTROLLER_KINDS.items()
        if (FOLDER / f"controller_{name}.toml").exists()
    },
    "scenario": ScenarioFile,
    "plant": PlantFile,
}


def text_of(name):
    """A template as it is used: controllers have the stages behind the keys of their kind."""
    text = template(name, "controller_stages") if name.startswith("controller") else template(name)
    return text.replace("UNIT", "1")


def tables(schema, table, path=""):
    """Dotted name and keys of each table of a JSON schema; the tables of free names as CHANNEL."""
    if "$ref" in table:
        word = table["$ref"].rpartition("/")[2]
        table = {} if word == "Quantity" else schema["$defs"][word]
    for part in (*table.get("anyOf", ()), *table.get("oneOf", ()), table.get("items")):
        if part:
            yield from tables(schema, part, path)
    if table.get("properties"):
        yield path, list(table["properties"])
        for name, inner in table["properties"].items():
            yield from tables(schema, inner, f"{path}.{name}".lstrip("."))
    elif isinstance(table.get("additionalProperties"), dict):
        yield from tables(schema, table["additionalProperties"], f"{path}.CHANNEL")


@pytest.mark.parametrize("name", FORMS)
def test_a_template_has_every_key_of_its_form(name):
    """In its table, or in words where keys exclude each other or the table is written in one line."""
    text, schema = text_of(name), FORMS[name].model_json_schema()
    parts = sections(text)
    for path, known in tables(schema, schema):
        rows = {row.key for part in parts if part.name == path for row in part.rows if isinstance(row, KeyLine)}
        inner = {part.name.removeprefix(f"{path}.").partition(".")[0] for part in parts}
        in_words = {key for key in known if re.search(rf"^#.*\b{key}\b|{{.*\b{key} = ", text, re.MULTILINE)}

        assert set(known) <= rows | inner | in_words, path


def test_every_template_is_tested():
    """A template for a new kind of controller is picked up by its name."""
    assert {file.stem for file in FOLDER.glob("*.toml")} == {*FORMS, "controller_stages"}


@pytest.mark.parametrize("name", FORMS)
def test_a_template_is_valid(name):
    """No key that the form does not have: as it stands, and with each switched-off table instead of its rivals."""
    text = text_of(name)
    content = tomllib.loads(text)
    validate(content, FORMS[name], name)
    for block in re.findall(r"^#\[(?:.+\n)+", text, re.MULTILINE):
        table = tomllib.loads(re.sub(r"^#(?! )", "", block, flags=re.MULTILINE))
        rest = {key: item for key, item in content.items() if not {key, *table} <= {"design", "tuning", "gains"}}
        validate({**rest, **table}, FORMS[name], block, {"folder": scenarios.slow_sine.parent})


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
    assert tomllib.loads(text)["title"] == f"mine, started from {path.stem}"


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
        if table == "#[feedforward.adaptation]":
            content["feedforward"] |= {"coulomb": "0.5 A"}
        if table == "#[rest.knocker]":
            content["rest"] |= {"band": "40 um"}
        if (word := table.strip("#[]")) in ("design", "tuning", "gains"):
            content = {key: item for key, item in content.items() if key not in {"design", "tuning", "gains"} - {word}}
        validate(content, CONTROLLER_KINDS[kind].file, table)
        tried += 1

    assert tried >= 2 or not template(f"controller_{kind}"), "a kind's template has the stages behind its own tables"


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


def test_keys_of_the_registries_are_in_the_file():
    """Metrics of a scenario that are defined there, and parameters of a plant, with their meaning."""
    text = scenario_toml("steps_spring", "mine")
    shown = {name for name in METRICS if re.search(rf"^#?{name} = ", text, re.MULTILINE)}
    assert shown == {name for name, metric in METRICS.items() if metric.requires not in ("force", "cycle")}
    text = plant_toml("ehsa", "mine")
    for word in ("linear", "nonlinear"):
        for kind in load_plant("ehsa", model=word).structure.equations.parameters:
            assert kind.name in LOAD_SYMBOLS.values() or kind.meaning.split(" (")[0] in text, kind.name


def test_the_kinds_of_reference_are_those_of_the_form():
    """A new kind needs its section in the template."""
    schema = ScenarioFile.model_json_schema()

    assert set(reference_kinds()) == set(schema["properties"]["reference"]["discriminator"]["mapping"])


@pytest.mark.parametrize("kind", reference_kinds())
def test_a_scenario_of_each_kind_of_reference_is_found_by_name_and_valid(run, tmp_path, kind):
    """It lands in ./scenarios, with the trajectory that it needs, and `check` has nothing to say."""
    status, out, _ = run("new", "scenario", "mine", "--kind", kind)

    assert status == 0
    assert "ehsa-ctrl check scenarios/mine.toml" in out
    assert tomllib.loads((tmp_path / "scenarios" / "mine.toml").read_text())["reference"]["kind"] == kind
    assert run("check", "scenarios/mine.toml")[0] == 0
    assert scenario_of_kind(kind) in scenarios


@pytest.mark.parametrize("kind", [kind for kind in CONTROLLER_KINDS if kind != "scheduled_pid"])
def test_a_controller_of_each_kind_is_found_by_name_and_valid(run, kind):
    """`check` designs it."""
    assert run("new", "controller", "--kind", kind)[0] == 0

    assert run("check", f"controllers/my_{kind}.toml")[0] == 0


class OwnFile(ControllerFile):
    """Form of a kind that has neither an example nor a template."""

    kind: Literal["own"] = Field(description="type of feedback law")
    gain: Annotated[float, In("A/m")] = Field(gt=0, description="current per position error")
    filter_time: Second = Field(default=0.01, description="time constant of the filter")


def test_a_kind_without_example_gets_one_from_its_form(run, tmp_path, monkeypatch):
    """Required keys with placeholders, the others switched off; `design` names that command, then starts from it."""
    kind = ControllerKind("own", "proportional", OwnFile, lambda name, file, system: None)
    monkeypatch.setitem(CONTROLLER_KINDS, "own", kind)

    assert "write one by `ehsa-ctrl new controller NAME --kind own`" in run("design", "ehsa", "--kind", "own")[2]
    assert run("new", "controller", "mine", "--kind", "own")[0] == 0
    text = (tmp_path / "controllers" / "mine.toml").read_text()
    assert 'gain = "1 A/m"  # current per position error [A/m]; required' in text
    assert '#filter_time = "0.01 s"  # time constant of the filter [s]; default 0.01 s' in text
    assert "#[dither]" in text and text.count("schema = 1") == 1
    validate(tomllib.loads(text), OwnFile, "mine.toml")
    assert starting_definition("own") == (kind, tmp_path / "controllers" / "mine.toml")
    again = controller_toml("mine", "next")
    assert 'gain = "1 A/m"  # current per position error [A/m]; required' in again


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
        (["plant", "a/b"], "is not a valid name"),
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

    assert status == 0 and "now hides the shipped" in err
