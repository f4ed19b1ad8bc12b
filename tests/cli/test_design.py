"""`ehsa-ctrl design`: from a specification to a controller's TOML."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.design.analysis.closed_loop import step_response
from ehsa_ctrl.design.analysis.loop import analyse_loop
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.load import build_controller
from ehsa_ctrl.design.specification import definition_keys, full_key, parse_value, starting_definition

CLASSIC = ("design", "ehsa", "--kind", "pid", "--bandwidth", "35 rad/s", "--phase-margin", "60 deg")


@pytest.mark.slow
def test_a_tuned_pid_is_written_and_keeps_what_was_asked_for(run, linear):
    status, out, _ = run(
        "design", "ehsa", "--kind", "pid", "--Ms", "1.4", "--noise-gain", "6000 A/m", "-o", "mine.toml"
    )

    assert status == 0
    assert "written to mine.toml" in out
    text = Path("mine.toml").read_text()
    assert tomllib.loads(text)["tuning"] == {"Ms": 1.4, "noise_gain": "6000 A/m"}
    assert "# Designed by ehsa-ctrl for ehsa: Ms 1.4, noise_gain 6000 A/m." in text
    assert any(line.startswith("#") and "disk margin" in line for line in text.splitlines())
    model = ehsa_ctrl.three_state(linear)
    loop = analyse_loop(model, ehsa_ctrl.load_controller("mine.toml", model))
    assert loop.Ms <= 1.4001
    assert loop.noise_gain["position"] <= 6001


def test_the_file_passes_check_and_is_not_replaced_unasked(run):
    assert run(*CLASSIC, "-o", "mine.toml")[0] == 0
    before = Path("mine.toml").read_text()

    assert run("check", "mine.toml")[0] == 0
    status, _, err = run(*CLASSIC, "-o", "mine.toml", "--title", "another")
    assert status == 2
    assert err == "ehsa-ctrl: mine.toml: already exists; choose another name or use --force\n"
    assert Path("mine.toml").read_text() == before
    assert run(*CLASSIC, "-o", "mine.toml", "--title", "another", "--force")[0] == 0
    assert tomllib.loads(Path("mine.toml").read_text())["title"] == "another"


def test_frozen_gains_are_the_same_controller(run, linear):
    assert run(*CLASSIC, "-o", "spec.toml")[0] == 0
    assert run(*CLASSIC, "--freeze", "-o", "gains.toml")[0] == 0

    assert "gains" in tomllib.loads(Path("gains.toml").read_text())
    model = ehsa_ctrl.three_state(linear)
    specified, given = (ehsa_ctrl.load_controller(name, model) for name in ("spec.toml", "gains.toml"))
    assert given.settings() == pytest.approx(specified.settings(), rel=1e-8)


@pytest.mark.slow
def test_json_and_figures(run):
    status, out, _ = run(*CLASSIC, "--set", "K_T=1.1", "--json", "--out", "result")

    assert status == 0
    result = json.loads(out)
    assert result["loop"]["phase_margin"] == pytest.approx(60, abs=0.1)
    assert result["settings"] == {"K_T": "1.1"}
    assert 0 < result["settling_time"] < 1
    files = {path.name for path in Path("result").iterdir()}
    assert files == {"design.json", "report.html", ".ehsa_ctrl-design.json"} | {
        f"{name}.{end}" for name in ("loop", "nyquist", "step") for end in ("png", "svg")
    }


def test_every_kind_can_be_designed(run):
    """Without a word of specification: each kind has a shipped controller to start from."""
    for kind in CONTROLLER_KINDS:
        name, path = starting_definition(kind)
        assert name.name == kind == tomllib.loads(path.read_text())["kind"]

    status, out, _ = run("design", "ehsa", "--kind", "cascade", "--bandwidth", "20 rad/s", "--phase-margin", "70 deg")

    assert status == 0
    written = tomllib.loads(out)
    assert written["position"]["crossover"] == "20 rad/s"
    assert written["speed"] == tomllib.loads(Path(ehsa_ctrl.controllers["cascade_position"]).read_text())["speed"]


def halved():
    """A plant of one's own: half the stroke and a third of the current of the EHSA, sampled twice as often."""
    text = ehsa_ctrl.plants["ehsa"].read_text()
    for old, new in (("stroke = { value = 200", "stroke = { value = 100"), ("value = 2.51", "value = 0.83667"),
                     ("period = { value = 4", "period = { value = 2")):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    Path("plants").mkdir()
    Path("plants/rig.toml").write_text(text)


def test_limits_and_period_are_those_of_the_plant(run):
    """Said in the file; what is asked for by an option is taken as it is."""
    halved()
    status, out, _ = run("design", "rig", "--kind", "cascade", "--current-limit", "1.5 A")

    assert status == 0
    written = tomllib.loads(out)
    assert (written["sample_time"], written["current_limit"]) == ("2 ms", "1.5 A")
    assert "# Started from cascade_position, a controller of the shipped EHSA; for this plant: sample_time 2 ms" in out


def test_a_tuning_that_is_begun_bounds_the_plants_own_noise(run):
    """A third of the current bears a third of the noise: the default that nobody asked for is carried as well."""
    halved()
    status, out, _ = run("design", "rig", "--kind", "pid", "--Ms", "1.6")

    assert status == 0
    assert tomllib.loads(out)["tuning"] == {"Ms": 1.6, "noise_gain": "3330 A/m"}


def test_a_base_of_ones_own_is_taken_as_it_is(run):
    """Nobody knows for which plant it was made."""
    halved()
    Path("own.toml").write_text(ehsa_ctrl.controllers["cascade_position"].read_text())
    status, out, _ = run("design", "rig", "--kind", "cascade", "--base", "own.toml")

    assert status == 0 and tomllib.loads(out)["sample_time"] == "4 ms"
    assert "Started from" not in out


@pytest.mark.parametrize("kind", ["mpc", "pid"])
def test_a_new_controller_carries_its_plants_numbers(run, kind):
    """Limits, sample time and scales; the examples that are switched off as well; `check` has nothing to say."""
    halved()
    assert run("new", "controller", "mine", "--kind", kind, "--plant", "rig")[0] == 0
    text = Path("controllers/mine.toml").read_text()
    written = tomllib.loads(text)

    assert (written["sample_time"], written["current_limit"]) == ("2 ms", "2 A")
    assert "Limits, sample time and scales are for the plant rig." in text and "4 ms" not in text
    if kind == "mpc":
        assert written["limits"]["stroke"] == "47.5 mm" and written["weights"]["position"] == "0.25 mm"
        # What was said of the old number is not said of the new one.
        assert "of 100 mm to either side" not in text
    assert run("check", "controllers/mine.toml", "--plant", "rig")[0] == 0


def test_a_new_scenario_stays_within_its_plants_stroke(run):
    """Half the stroke, half the way."""
    halved()
    assert run("new", "scenario", "mine", "--from", "long_move", "--plant", "rig")[0] == 0

    assert tomllib.loads(Path("scenarios/mine.toml").read_text())["reference"]["positions"] == ["40 mm"]
    assert run("check", "scenarios/mine.toml")[0] == 0


@pytest.mark.slow
def test_an_lqr_gets_its_bandwidth_from_the_position_weight(run, linear):
    status, out, _ = run(
        "design", "ehsa", "--kind", "lqr", "--bandwidth", "35 rad/s", "--Ms", "1.6", "--weight", "current=2 A", "--json"
    )

    assert status == 0
    result = json.loads(out)
    definition = CONTROLLER_KINDS["lqr"].file.model_validate(result["definition"])
    model = ehsa_ctrl.three_state(linear)
    steps = step_response(model, build_controller("mine", CONTROLLER_KINDS["lqr"], definition, model))
    # Rise from 10 to 90 % of a second-order loop is about 2.2 over its bandwidth.
    rise = np.interp([0.1, 0.9], np.maximum.accumulate(steps.position["reference"]), steps.time)
    assert 1.8 < 35 * np.ptp(rise) < 2.8
    assert result["loop"]["Ms"] <= 1.6
    assert result["definition"]["weights"]["current"] == "2 A"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--kind", "pdi"), "--kind 'pdi': no such kind of controller; did you mean 'pid'?"),
        (("--kind", "pid", "--bandwidth", "200 rad/s"), "no PID controller satisfies"),
        (
            ("--kind", "pid", "--bandwidth", "200 rad/s", "--phase-margin", "60 deg"),
            "lower the crossover or the margin",
        ),
        (("--kind", "pid", "--Ms", "0.5"), "greater than 1"),
        (("--kind", "pid", "--spec", "tunning.Ms=1.5"), "no such key; did you mean 'tuning.Ms'"),
        (("--kind", "pid", "--spec", "crossover='3 rad/s'"), "design.crossover or tuning.crossover"),
        (("--kind", "pid", "--spec", "Ms"), "expected KEY=VALUE, as in --spec"),
        (("--kind", "pid", "--base", "lqr_position"), "--base lqr_position: is a 'lqr' controller"),
        (("--kind", "pid", "--sample-time", "0.5 s", *CLASSIC[4:]), "Nyquist frequency 6.283 rad/s"),
        (("--kind", "cascade", "--freeze"), "--freeze is for kind = 'pid'"),
        (("--kind", "cascade", "--Ms", "1.1"), "Ms = 1.1 .*largest value; the loop of this cascade has 1.3"),
        (("--kind", "pid", "-o", "mine.txt"), "ends in .toml"),
        (("--kind", "pid", "-o", "/proc/mine.toml"), r"/proc/mine\.toml: can't be written"),
        (
            ("--kind", "lqr", "--weight", "force=1"),
            r"--weight force: .* no such key in \[weights\]; .*known: current, .*speed$",
        ),
        (
            ("--kind", "lqr", "--limit", "speed=1"),
            r"--limit speed: this kind of controller has no \[limits\]; leave it out",
        ),
        (("--kind", "mpc", "--limit", "current='1 A'"), r"--limit current: .* did you mean 'current_rate'\? known: "),
        (("--kind", "lqr", "--spec", "a=1"), r"--spec a: .*known: current_limit, dither\.\*, feedforward\.\*, "),
        (("--kind", "mpc", "--spec", "horizon=0"), "horizon = 0; expected a value greater than or equal to 2"),
        (("--kind", "mpc", "--limit", "pressure='-1 bar'"), "pressure = '-1 bar'; expected a value greater than 0"),
        (("--kind", "lqr", "--weight", "position=nan"), "position: nan has no unit"),
        (("--kind", "lqr", "--weight", "current='0 A'"), "current = 0.0; expected a value greater than 0"),
        (("--kind", "scheduled_pid", "--bandwidth", "300 rad/s"), r"\[schedule\] at 2 bar: no PID controller"),
        (("--kind", "cascade", "--bandwidth", "-30 rad/s"), "expected 0 < position < speed"),
        (("--kind", "pid", "--set", "K_T=-1"), "K_T"),
    ],
)
def test_a_wrong_specification_is_one_sentence(run, arguments, sentence):
    import re

    status, out, err = run("design", "ehsa", *arguments)

    assert status == 2
    assert out == ""
    assert re.search(sentence, err, flags=re.MULTILINE)
    assert err.count("\n") == 1 and len(err) < 400


def test_words_are_found_among_a_kinds_keys():
    form = CONTROLLER_KINDS["pid"].file

    assert {"current_limit", "tuning.Ms", "design.phase_margin", "gains.k_p"} <= set(definition_keys(form))
    assert full_key("Ms", form) == "tuning.Ms"
    assert full_key("design.crossover", form) == "design.crossover"
    assert parse_value("1.5") == 1.5
    assert parse_value("30 rad/s") == "30 rad/s"
    assert parse_value("'PI'") == "PI"


def test_tune_keeps_what_is_given_and_the_bounds(run):
    """The other key is chosen; the file says that it was tuned, and holds its numbers."""
    status, out, _ = run("design", "ehsa", "--kind", "adrc", "--tune", "--Ms", "1.4", "--spec", "adrc.observer_ratio=3")

    written = tomllib.loads(out)
    assert status == 0 and written["adrc"]["observer_ratio"] == 3
    assert "tuned" in out.partition("\n\n")[0]
    assert float(re.search(r"# Ms ([\d.]+)", out)[1]) <= 1.401
    assert 30 < float(written["adrc"]["bandwidth"].split()[0]) < 80


def test_tune_of_a_kind_without_tuned_keys_is_one_sentence(run):
    status, _, err = run("design", "ehsa", "--kind", "force", "--tune")

    assert status == 2 and "a force has no keys that are tuned" in err


def test_a_design_starts_from_a_shipped_controller(run):
    """Not from the project's first one of that kind; a file with the shipped one's name takes its place."""
    Path("controllers").mkdir()
    shipped = starting_definition("sliding_mode")[1].read_text()
    Path("controllers/a_first.toml").write_text(shipped.replace("30 rad/s", "20 rad/s"))

    assert starting_definition("sliding_mode")[1].name == "sliding_friction.toml"
    assert starting_definition("sliding_mode", "a_first")[1].name == "a_first.toml"
    Path("controllers/sliding_friction.toml").write_text(shipped)
    assert starting_definition("sliding_mode")[1].resolve() == Path("controllers/sliding_friction.toml").resolve()


def test_keys_of_a_base_are_set_by_their_table(run):
    """--spec base.TABLE.KEY; a base's own message names such a key."""
    line = ("design", "ehsa", "--kind", "repetitive", "-o", "mine.toml", "--spec")

    assert run(*line, "base.speed.crossover=100 rad/s")[0] == 0
    assert tomllib.loads(Path("mine.toml").read_text())["base"]["speed"]["crossover"] == "100 rad/s"
    assert "[base]: foo: unknown key" in run(*line, "base.foo=3", "--force")[2]
    emps = ("design", "emps", "--kind", "repetitive", "--current-limit", "150 N")
    assert "--spec base.position.velocity_limit='0.5 m/s'" in run(*emps)[2]
