"""Mistakes that check refuses; run, montecarlo and design refuse them with the same message."""

import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core import catalogue
from ehsa_ctrl.scenario.prepare import check_definition
from ehsa_ctrl.simulation.fmu.export import identifier

STROKE = 'stroke = { value = 200, unit = "mm", source = "datasheet", note = "Table 1; x = 0 at mid-stroke" }'
TITLE = 'title = "'
KEPT = 'SteadyStateError = { max = "200 um" }'


def edited(tmp_path, kind, name, old, new):
    """A copy of a shipped file with one text replaced, as a user's own."""
    text = catalogue.shipped(kind)[name].read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("kind", "name", "old", "new", "says"),
    [
        ("plants", "ehsa", STROKE, STROKE.replace("200", "inf"), r"\[limits\] stroke = inf m: must be greater than 0"),
        ("plants", "ehsa", STROKE, STROKE.replace("200", "-1"), r"\[limits\] stroke = -0.001 m: must be greater"),
        ("plants", "ehsa", "value = 1.2,", "value = true,", r"\[parameters.K_T\] value = true; expected a number"),
        ("plants", "ehsa", "value = 1.2,", 'value = "1.2",', r"\[parameters.K_T\] value = '1.2'; expected a number"),
        ("plants", "ehsa", "value = 1.2,", "value = 1e-300,", "K_T.* = 1e-300 N m/A"),
        ("plants", "ehsa", "bounds = [0.87, 1.60]", "bounds = [0.87]", r"\[parameters.K_T"),
        ("controllers", "pid_position", 'kind = "pid"', 'kind = ["pid"]', "kind = a list; .*known: .*cascade"),
        ("controllers", "pid_position", '"60 deg"', '"0 deg"', r"\[design\] phase_margin: 0 deg; expected .* 180 deg"),
        ("controllers", "pid_position", '"6 A"', '"60 A"', r"60 A exceeds the rating of the plant ehsa, 13\.42 A"),
        ("controllers", "pid_position", '"6 A"', "true", "current_limit: True is not a quantity"),
        ("controllers", "pid_position", '"6 A"', '"1e300 A"', "current_limit: .*1e300 A.* is out of range"),
        ("controllers", "pid_position", "schema = 1", "schema = true", "schema = true; expected the whole number 1"),
        ("scenarios", "steps_spring", KEPT, KEPT.replace("200 um", "1e999 um"), "SteadyStateError.max: .* too large"),
        ("scenarios", "steps_spring", KEPT, KEPT.replace("max", 'min = "1 mm", max'), "no value satisfies both"),
        ("scenarios", "steps_spring", KEPT, "SteadyStateError = 3", "SteadyStateError = 3; expected"),
    ],
)  # fmt: skip
def test_what_cannot_be_meant_is_refused_where_it_is_read(tmp_path, kind, name, old, new, says):
    """With the file and the key, what was got and what was expected."""
    path = edited(tmp_path, kind, name, old, new)

    with pytest.raises(e.InputError, match=says) as caught:
        check_definition(path, plant="ehsa" if kind == "controllers" else None)

    assert str(path) in str(caught.value)
    if kind == "scenarios":
        for refused in (e.run, e.monte_carlo):
            with pytest.raises(e.InputError) as again:
                refused(path)
            assert str(caught.value) in str(again.value)
    if kind == "controllers":
        with pytest.raises(e.InputError, match=says):
            e.run("steps_spring", controller=path)


def test_estimation_refuses_a_negative_cutoff(tmp_path):
    """A window must have a width."""
    for word, value in (("cutoff", "-5 Hz"), ("parallel", "0 Hz"), ("width", "0 s")):
        path = edited(tmp_path, "plants", "ehsa", "[nonlinear]", f'[nonlinear]\nestimation = {{ {word} = "{value}" }}')

        with pytest.raises(e.InputError, match=f"{word} = .*; expected more than 0"):
            check_definition(path)


def test_a_lag_as_long_as_the_run_is_refused(tmp_path):
    """A lag as long as the run would leave no current."""
    path = edited(tmp_path, "scenarios", "slow_sine", "[reference]", "[sensors]\nlag = 50\n\n[reference]")
    lines = path.read_text().splitlines()
    path.write_text("\n".join('duration = "0.06 s"' if line.startswith("duration") else line for line in lines))

    with pytest.raises(e.InputError, match=r"lag = 50 samples is as long as the run|event of the scenario is at"):
        check_definition(path)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"x = " + b"[" * 200_000, "is not valid TOML: brackets are nested too deeply"),
        (b'kind = "pid"\nx = ' + b"9" * 5000, "is not valid TOML: it contains an integer of more than 64 bits"),
        (b'kind = "pid"\nx = ' + b"9" * 30, "is not valid TOML: it contains an integer of more than 64 bits"),
        (b'title = "\xff"', r"is not valid UTF-8 \(byte 10\)"),
        (b"", "is neither a plant .* nor a controller .* nor a scenario"),
    ],
)
def test_what_is_no_definition_is_a_sentence(tmp_path, content, says):
    """Deep nesting, integers beyond 64 bits, other encodings, empty files."""
    path = tmp_path / "mine.toml"
    path.write_bytes(content)

    with pytest.raises(e.InputError, match=says):
        check_definition(path)


def test_a_byte_order_mark_is_no_mistake(tmp_path):
    """A byte order mark is accepted."""
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + catalogue.shipped("controllers")["pid_position"].read_bytes())

    assert check_definition(path) == "controller"


@pytest.mark.parametrize("name", ["a" * 300, "a" * 300 + ".toml", "a\0b.toml", "a\0b", "\udcff.toml", ".", "/"])
def test_a_name_that_no_file_has_is_a_sentence(name, tmp_path, monkeypatch):
    """Paths that are too long, contain a zero byte or no valid text, and folders."""
    monkeypatch.chdir(tmp_path)
    for load in (e.load_plant, e.load_scenario, lambda text: e.read_log(text, ["current"])):
        with pytest.raises(e.InputError):
            load(name)


@pytest.mark.parametrize("word", ["class", "None", "print", "3 rigs", "", "PlantSlave", "rüg"])
def test_an_fmu_is_a_class_whatever_its_plant_is_called(word):
    """Messages contain no Python types."""
    name = identifier(word)

    assert name.isidentifier() and name.isascii()
    compile(f"class {name}(PlantSlave): pass", "slave", "exec")
    assert name not in ("class", "None", "print", "PlantSlave")
