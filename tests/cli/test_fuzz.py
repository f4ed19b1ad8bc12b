"""Whatever is wrong with a definition, a result, a log or an argument: one sentence, soon, and never a traceback.

The cases are drawn with a fixed seed, so that a run can be repeated; what a case finds is mended where its class is.
"""

import copy
import inspect
import json
import math
import random
import shutil
import signal
import tomllib
import warnings
from contextlib import contextmanager

import numpy as np
import pandas
import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import ehsa_ctrl as e
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core import catalogue
from ehsa_ctrl.core.result import plain
from ehsa_ctrl.report.results import results_in, write_overview
from ehsa_ctrl.scenario.prepare import check_definition

SHIPPED = [path for kind in catalogue.KINDS for path in catalogue.shipped(kind).values()]
#: Their design takes seconds.
SLOW = ("pid_tuned", "pid_scheduled", "cascade_friction")
#: What stands where a value was.
VALUES = [
    True, False, 0, -1, 1, 2**63 - 1, -(2**63), 0.0, -0.0, 1e300, -1e300, 1e-300, 5e-324, math.inf, -math.inf, math.nan,
    "", " ", "x", "0", "1", "1e999", "nan", "inf", "0 m", "-1 m", "1e300 m", "1e-300 m", "3 furlong", "3 m**9**9**9",
    "3 (", "3 m/0", "3 pi", "__import__('os')", "1e300 A", "1e-300 A", "0 A", "-5 A", "1e30 rad/s", "1e-30 rad/s",
    "0 deg", "180 deg", "-60 deg", "1e300 s", "1e-300 s", "0 s", "0 Hz", "-1 Hz", "1e300 Hz", "1e300 N", "1e308 Pa",
    "1e-308 Pa", "0 %", "1e300 %", "\n", "ü", "..", "../..", "/", "/dev/null", "/etc", "a" * 300, "a\0b", "ehsa",
    "emps", "linear", "none", "K_T", [], [1], ["pid"], ["1 m", "2 m"], [[]], [True], [1e300, -1e300], ["0 s"] * 500, {},
    {"x": 1}, {"value": 1}, {"value": 1.0, "unit": "m", "source": "assumed"}, {"max": "1 mm"}, [{}], [{"kind": "lost"}],
]  # fmt: skip


class TooLong(BaseException):
    """Not an Exception, so that nothing takes it for a mistake of the user's."""


@contextmanager
def within(seconds):
    """Raise TooLong in what takes longer."""

    def stop(*_):
        raise TooLong(f"took more than {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def places(content, at=()):
    """Paths of all values in nested tables and arrays, tables themselves included."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from places(value, (*at, key))


def mutated(content, draw):
    """The content with one value replaced, dropped, scaled or put in twice, or a key added."""
    content = copy.deepcopy(content)
    *above, key = draw.choice(list(places(content)))
    table = content
    for step in above:
        table = table[step]
    match draw.choice(["replace"] * 4 + ["size"] * 3 + ["drop", "add", "repeat", "scale", "unit"]):
        case "drop":
            del table[key]
        case "add":
            if isinstance(table, dict):
                table[draw.choice(["x", "", "value", "kind", "ünit", "a.b", "K_T", "max"])] = draw.choice(VALUES)
        case "repeat":
            table[key] = [table[key], table[key]]
        case "scale" if isinstance(table[key], int | float):
            table[key] = table[key] * draw.choice([1e30, -1, 1e-30, 1e6, 1e-6])
        case "size" if isinstance(table[key], str):
            unit = table[key].partition(" ")[2]
            table[key] = f"{draw.choice(['1e300', '1e-300', '1e30', '1e-30', '1e9', '1e-9', '0', '-1'])} {unit}"
        case "unit" if isinstance(table[key], str):
            number = table[key].partition(" ")[0]
            table[key] = f"{number} {draw.choice(['', 'm', 's', 'A', 'Pa', 'rpm', '%', 'Nm', '1/0', '(', 'm^999'])}"
        case _:
            table[key] = draw.choice(VALUES)
    return content


def cut(raw, draw):
    """The bytes of a file cut, or with others in between."""
    at = draw.randrange(len(raw))
    odd = [b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"[" * 3000, b"\n[[", b"= ", b'"', b"\r", b"9" * 5000, b"#", b"{" * 500]
    return raw[:at] + draw.choice([b"", *(part + raw[at:] for part in odd)])


def said(error):
    """The sentence of an error; it is one, and no longer than a person reads."""
    text = str(error)
    assert text and "\n" not in text.strip() and len(text) < 1500, text
    assert "Traceback" not in text and "pydantic" not in text
    return text


def answered(call, *arguments, seconds=10.0, **kwargs):
    """What a call gives, or its sentence; anything else is raised, a numpy warning too."""
    with within(seconds), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return call(*arguments, **kwargs)
        except e.EhsaError as error:
            return said(error)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Copies of the shipped files, as a user's project has them."""
    root = tmp_path_factory.mktemp("project")
    for kind in catalogue.KINDS:
        shutil.copytree(catalogue.shipped_folder(kind), root / kind)
    return root


def mutant(path, folder, seed):
    """A shipped definition with something wrong, beside the others in the project's folder."""
    draw = random.Random(f"{path.name} {seed}")
    raw = path.read_bytes()
    if draw.random() < 0.15:
        raw = cut(raw, draw)
    else:
        content = mutated(tomllib.loads(raw.decode()), draw)
        raw = tomlkit.dumps(content).encode("utf-8", "surrogateescape")
    file = folder / path.parent.name / "mutant.toml"
    file.write_bytes(raw)
    return file


@pytest.mark.parametrize("path", SHIPPED, ids=[f"{path.parent.name}-{path.stem}" for path in SHIPPED])
def test_a_wrong_definition_is_a_sentence_that_names_its_file(path, folder):
    """What check does not refuse is a definition of the kind that it was; nothing takes long."""
    for seed in range(1 if path.stem in SLOW else 8):
        found = answered(check_definition, mutant(path, folder, seed))
        assert found in ("plant", "controller", "scenario") or "mutant.toml" in found, found


@pytest.mark.parametrize("command", ["check", "run", "montecarlo", "analyse"])
def test_a_command_says_the_same_of_a_wrong_definition(command, folder, run):
    """Status 2 and one sentence where check refuses; what is refused is refused before anything is computed."""
    for path in catalogue.shipped("plants" if command == "analyse" else "scenarios").values():
        file = mutant(path, folder, 1)
        sentence = answered(check_definition, file)
        # analyse does not need the controller under which logs were recorded.
        if sentence in ("plant", "scenario") or (command == "analyse" and "[log.controller]" in sentence):
            continue
        status, out, err = run(command, file)
        assert status == 2 and err.count("\n") == 1 and "Traceback" not in err + out
        if command != "analyse":
            assert " ".join(sentence.splitlines()) in err


@pytest.fixture(scope="module")
def results():
    """What commands write: file -> content."""
    found = e.run("steps_spring").to_dict()
    grounds = {"files": {"a.toml": "0123"}, "assumed": [], "command": "ehsa-ctrl run"}
    contents = {"results.json": {"passed": True, "scenarios": [found], "files": ["report.html"], "rests_on": grounds}}
    for name, call in (("analysis", "analyse ehsa --controller pid_position"), ("design", "design ehsa --kind pid")):
        contents[f"{name}.json"] = json.loads(CliRunner().invoke(app, [*call.split(), "--json"]).stdout)
    return {name: json.dumps(plain(content)).encode() for name, content in contents.items()}


def test_a_corrupt_result_is_a_sentence(results, tmp_path):
    """Whatever a JSON in a folder has become, report shows it or says that it is none."""

    def page(root):
        sections, wrong = results_in(root)
        assert all(said(e.InputError(sentence)) for sentence in wrong)
        return write_overview(sections, root, "x")

    assert results
    for name, raw in results.items():
        for seed in range(40):
            draw = random.Random(f"{name} {seed}")
            odd = raw if draw.random() < 0.7 else cut(raw, draw)
            if odd is raw:
                odd = json.dumps(mutated(json.loads(raw), draw)).encode()
            (tmp_path / name).write_bytes(odd)
            answered(page, tmp_path)
            (tmp_path / name).unlink()


def test_a_result_reads_and_writes_nothing_outside_its_folder(results, tmp_path):
    """It may name "..", an absolute path or a folder: nothing there is shown, changed or removed."""
    secret = tmp_path / "secret.svg"
    secret.write_text("<svg>secret</svg>")
    root = tmp_path / "run"
    root.mkdir()
    content = json.loads(results["results.json"])
    content["files"] = ["..", "../secret.svg", str(secret), "."]
    content["scenarios"][0]["scenario"], content["scenarios"][0]["controller"] = "../sec", "ret"
    (tmp_path / "sec-ret.svg").write_text("<svg>secret</svg>")
    (root / "results.json").write_text(json.dumps(content))

    sections, _ = results_in(root)
    page = write_overview(sections, root, "x").read_text()

    assert ">secret<" not in page
    assert secret.read_text() == "<svg>secret</svg>"


def log_text(draw):
    """A CSV of a log with something wrong."""
    rows = [["t", "current", "speed", "p1", "p2", "position"]]
    rows += [[f"{0.004 * k:.3f}", "1.5", f"{k % 7}", "2e6", "2.1e6", f"{1e-4 * (k % 9):.5f}"] for k in range(40)]
    for _ in range(draw.randint(1, 3)):
        row = draw.choice(rows)
        match draw.choice(["cell", "drop", "more", "swap", "empty", "wide", "same"]):
            case "cell":
                row[draw.randrange(len(row))] = str(draw.choice(VALUES))
            case "drop":
                del row[draw.randrange(len(row))]
            case "more":
                row.insert(draw.randrange(len(row)), draw.choice(["", "1", "x", "1e999", '"', "1,5"]))
            case "swap":
                draw.shuffle(row)
            case "empty":
                row.clear()
                row.append("")
            case "wide":
                row += ["0"] * draw.choice([3, 10_000])
            case "same":
                row[:] = rows[0]
    return "\n".join(draw.choice([",", ",", ";", "\t", " "]).join(row) for row in rows).encode("utf-8", "replace")


def test_a_wrong_log_is_a_sentence(tmp_path):
    """As compare, identify and diagnose read it."""
    plant, path = e.load_plant("ehsa"), tmp_path / "log.csv"
    for seed in range(120):
        draw = random.Random(seed)
        raw = log_text(draw)
        path.write_bytes(cut(raw, draw) if seed % 3 == 0 else raw)
        found = answered(e.read_plant_log, path, plant)
        assert isinstance(found, e.Log) or "log.csv" in found


#: What no argument is.
NONSENSE = [
    None, True, -1, 2.5, 10**400, 1e300, math.inf, math.nan, 1j, "", "x", "a\0b", "a" * 300, "\udcff", b"x", [], ["x"],
    [None], [[1], [2, 3]], [1j], [True], {"x": 1}, {1: 2}, (1, 2), set(), object(), object, len, np.array([]),
    np.array(1.0), np.zeros((2, 2, 2)), np.array(["a", "b"]), np.array([1j, 2]), np.array([None, 1]),
    np.full(50, np.nan), np.full(50, 1e300), np.array([True]), pandas.DataFrame(),
    pandas.Series(dtype=float), range(5), Exception("x"),
    np.int64(2), np.datetime64("2020-01-01"),
]  # fmt: skip
#: They compute for minutes with what is no nonsense; their arguments are those of others.
LONG = (
    "simulate_reference", "design_experiment", "identify", "diagnose", "diagnose_many", "replay_closed_loop",
    "what_changed", "monte_carlo", "run", "profile", "analyse_fleet", "learn_reference",
)  # fmt: skip


def calls():
    """Public functions and constructors by name, with the arguments that are tried."""
    known = {name: getattr(e, name) for name in e.__all__ if inspect.isfunction(getattr(e, name)) and name not in LONG}
    known |= {"SteppedRun": e.SteppedRun, "Log.from_pandas": e.Log.from_pandas, "Preparation": e.Preparation}
    known |= {"advance": e.SteppedRun("ehsa").advance, "Structure": e.Structure, "Log": e.Log}
    kept = ("path", "folder", "jobs", "plants")
    for name, function in known.items():
        yield name, function, [p for p in inspect.signature(function).parameters.values() if p.name not in kept]


@pytest.fixture(scope="module")
def fitting():
    """What fits, by the name of the argument."""
    plant = e.load_plant("ehsa")
    system, time = e.three_state("ehsa"), 0.004 * np.arange(50)
    channels = {"current": np.sin(time), "speed": np.cos(time)}
    log = e.Log(time, channels)
    return {
        "plant": plant, "log": log, "system": system, "systems": {},
        "controller": e.load_controller("pid_position", system),
        "time": time, "parameters": plant.vector[None], "reference": np.zeros((50, 3)), "measured": time,
        "simulated": time, "current": time, "name": "ehsa", "path": "no.fmu", "n": 1, "required": (), "result": None,
        "folder": ".", "distance": 0.01, "current_limit": 6.0, "frame": log.to_pandas(), "channels": channels,
        "force": 0.0, "duration": 0.004, "plants": [], "logs": [log],
        "x": time, "drive": time, "outputs": {"speed": time}, "sample_time": 0.004, "text": "select 1",
    }  # fmt: skip


@pytest.mark.parametrize("name", [name for name, _, _ in calls()])
def test_nonsense_in_a_call_is_a_sentence(name, fitting, tmp_path, monkeypatch):
    """In every argument of every public function that does not compute for long."""
    monkeypatch.chdir(tmp_path)
    function, parameters = next((f, p) for known, f, p in calls() if known == name)
    own = {"sensitivities": {"parameters": ["K_T"]}, "advance": {"current": 0.0}}.get(name, {})
    required = inspect.signature(function).parameters.values()
    required = [p.name for p in required if p.default is p.empty and p.kind is not p.VAR_POSITIONAL]
    for parameter in parameters:
        others = {key: (fitting | own)[key] for key in required if key != parameter.name and key in fitting}
        for value in NONSENSE:
            answered(function, **others, **{parameter.name: value})


def test_nonsense_as_a_key_is_a_sentence(plant):
    """A symbol, a channel."""
    log = e.Log(np.arange(3.0), {"current": np.zeros(3)})
    for value in NONSENSE:
        assert isinstance(answered(plant.__getitem__, value), str)
        assert isinstance(answered(log.__getitem__, value), str)


@given(
    st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=5), lambda one: st.lists(one, max_size=4))
)
@settings(max_examples=60, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_value_is_a_current_or_a_sentence(plant, value):
    """Nested lists, texts, nothing."""
    found = answered(e.simulate, plant, value)
    assert isinstance(found, str) or found.time.size == len(value)


@pytest.mark.parametrize("text", ["[" * 100_000, '{"campaign": ' + "9" * 5000 + "}", "null", "\0", "{}\n[[["])
def test_a_kept_campaign_that_is_none_is_a_sentence(text, tmp_path):
    """A file to be continued is not taken for one, and stays as it was."""
    path = tmp_path / "runs.jsonl"
    path.write_text(text)

    found = answered(e.monte_carlo, "steps_spring", runs=1, file=path)

    assert isinstance(found, str) and "runs.jsonl" in found
    assert path.read_text() == text
