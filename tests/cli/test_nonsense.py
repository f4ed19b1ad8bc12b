"""Whatever is wrong with a call, one sentence says it: status 2, nothing on standard output, no traceback."""

import json

import pytest
import typer

from ehsa_ctrl.cli.main import app

#: A call of each command that can't succeed, so that none of its options can make it work for long.
CALLS = {
    "init": ["there", "--from", "no_such"],
    "run": ["no_such"],
    "montecarlo": ["no_such"],
    "simulate": ["no_such", "--excitation", "steps", "--out", "there"],
    "analyse": ["no_such"],
    "design": ["no_such", "--kind", "pid"],
    "excite": ["no_such"],
    "convert": ["no_such.csv", "there.csv"],
    "compare": ["no_such.csv", "--plant", "no_such"],
    "identify": ["no_such.csv", "--plant", "no_such"],
    "diagnose": ["no_such.csv", "--plant", "no_such"],
    "fleet": ["no_such", "--plant", "no_such"],
    "export": ["no_such", "--out", "there"],
    "fmu": ["no_such", "--out", "there"],
    "serve": ["--plant", "no_such"],
    "learn": ["no_such"],
    "new plant": ["no name"],
    "new controller": ["no name"],
    "new scenario": ["no name"],
    "effects confirm": ["no_such", "no_such.csv", "--plant", "ehsa"],
    "report": ["no_such"],
    "frf": ["no_such", "--plant", "ehsa"],
    "list": ["no_such"],
    "check": ["no_such"],
}
#: What a command prints though a file of several is wrong: a line or an entry for each.
TABLES = {"check": "wrong no_such\n"}
NONSENSE = ("", "nix", "-1", "nan", "1e999", "a=b=c", "K_T=nan", "1:2:3", "two\nlines", "9" * 30)


def commands(group, path=()):
    """Name of each command -> what typer knows of it."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, (*path, name))
        else:
            yield " ".join((*path, name)), command


WHOLE = typer.main.get_command(app)
COMMANDS = dict(commands(WHOLE))
OPTIONS = [
    (name, parameter.opts[-1])
    for name, command in COMMANDS.items()
    for parameter in command.params
    if parameter.opts[0].startswith("-") and not getattr(parameter, "is_flag", False)
]


@pytest.fixture(autouse=True)
def built(monkeypatch):
    """Building all commands takes longer than a call: here that is done once."""
    monkeypatch.setattr("typer.main.get_command", lambda _: WHOLE)


def check(answer, *, said="", printed=""):
    """One sentence on standard error, nothing unexpected on standard output."""
    status, out, err = answer

    assert status == 2 and out == printed
    assert err.startswith("ehsa-ctrl") and err.count("\n") == 1 and err.endswith("\n")
    assert "Traceback" not in err and len(err) < 700
    assert said in err


def test_every_command_is_tried():
    """A command that is added needs a call here."""
    assert set(CALLS) == set(COMMANDS)


@pytest.mark.parametrize("name", sorted(CALLS))
def test_a_wrong_argument_is_one_sentence(run, name):
    """For people, and where a program reads: there is no half of a JSON on standard output."""
    call = [*name.split(), *CALLS[name]]

    check(run(*call), printed=TABLES.get(name, ""))
    check(run(*call, "--no-such-option"), said="No such option: --no-such-option")
    if any("--json" in parameter.opts for parameter in COMMANDS[name].params) and name not in TABLES:
        check(run(*call, "--json"))


@pytest.mark.parametrize("name", sorted(n for n, c in COMMANDS.items() if any(p.required for p in c.params)))
def test_a_missing_argument_is_named(run, name):
    """And where help is."""
    check(run(*name.split()), said=f"see ehsa-ctrl {name} --help")


@pytest.mark.parametrize(("name", "option"), OPTIONS, ids=[f"{n} {o}" for n, o in OPTIONS])
def test_nonsense_is_one_sentence(run, name, option, tmp_path):
    """Whatever follows an option; and nothing is left in the folder."""
    for value in NONSENSE:
        check(run(*name.split(), *CALLS[name], f"{option}={value}"), printed=TABLES.get(name, ""))

    assert list(tmp_path.iterdir()) == []


def test_two_mistakes_are_no_two_sentences(run, tmp_path):
    """A file that is no table, a plant that is no plant, and options that contradict each other."""
    (tmp_path / "plant.toml").write_text("schema = [")
    (tmp_path / "log.csv").write_text("nothing\nof,the,kind\n")

    check(run("identify", "log.csv", "--plant", "plant.toml", "--model", "nix"))
    check(run("compare", "log.csv", "--plant", "ehsa", "--from", "9", "--to", "1"))
    check(run("diagnose", "log.csv", "--plant", "ehsa", "--replay"))
    check(run("run", "--plant", "plant.toml", "force_step"))


@pytest.mark.parametrize("name", sorted(CALLS))
def test_an_argument_in_no_encoding_is_one_sentence(run, name):
    """A name in Latin-1, as the shell hands it over."""
    check(run(*name.split(), "r\udcfcg.toml"), said="is not valid UTF-8, which arguments must be; rename the file")


def test_json_is_all_that_is_on_standard_output(run):
    """Where a command does its work, a program can read what it says."""
    for call in (("list", "--json"), ("new", "controller", "mine", "--json"), ("analyse", "ehsa", "--json")):
        status, out, _ = run(*call)

        assert status == 0 and json.loads(out)
