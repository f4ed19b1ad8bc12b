"""A proposed law is confirmed on a second log of a rig that has it, and refused where the log can't or doesn't."""

import hashlib
import json
import os
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

import ehsa_ctrl as e
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core import registry
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.diagnosis import Cause
from ehsa_ctrl.diagnosis.law.confirm import _alike, _ranges, _Test
from ehsa_ctrl.diagnosis.law.confirmation import Confirmation, SeenRange
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs
from ehsa_ctrl.physics.effects import EFFECTS, LawFile, LawLog, effect_of

FILE = """\
# Found on the day of the acceptance test.
schema = 1
status = "proposed"
summary = "a valve that lets oil out of chamber 1"
adds_to = "flow_1"
expression = "-k_rig * max(P_1 - P_rig, 0)"  # tank is at 0

[parameters]
k_rig = { value = 6e-13, unit = "m3/(s Pa)", neutral = 0.0, sd = 3e-14 }
P_rig = { value = 1.2e6, unit = "Pa", sd = 2e4 }

[range]
P_1 = [1e6, 1.9e6]
"""


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A project with the file of the law, in its folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_PROJECTS", [])
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "valve.toml").write_text(FILE)
    return tmp_path


def record(project, name, factor=1.0, kind="noise", seed=0, amplitude=3.0):
    """A log of a rig whose valve has this multiple of the size in the file; 0 for a rig without it."""
    rig = e.load_plant("ehsa")
    if factor:
        law = LawFile.model_validate(tomllib.loads(FILE))
        EFFECTS.keep("rig_valve", effect_of("rig_valve", law, "the rig"))
        rig = rig.with_effects("rig_valve", k_rig=6e-13 * factor, P_rig=1.2e6)
    drive = e.excitation(kind, amplitude=amplitude, duration=9.0, sample_time=0.004, seed=seed)
    log, _ = e.record(rig, *drive, centre=True)
    log.write(project / name)


def confirm(*words):
    result = CliRunner().invoke(app, ["effects", "confirm", *words, "--plant", "ehsa"])
    return result.exit_code, result.output


def test_the_log_of_the_proposal_is_no_second_log(project, monkeypatch):
    """Neither under another name nor written again, from whatever folder; the file stays as it is."""
    record(project, "log.csv", seed=1)
    digest = hashlib.sha256((project / "log.csv").read_bytes()).hexdigest()
    known = FILE + f'\n[[logs]]\npath = "log.csv"\nsha256 = "{digest}"\n'
    (project / "effects" / "valve.toml").write_text(known)
    (project / "copy.csv").write_bytes((project / "log.csv").read_bytes())
    (project / "again.csv").write_text((project / "log.csv").read_text().rstrip("\n") + "\n\n")
    header, *rows = (project / "log.csv").read_text().splitlines()
    (project / "cut.csv").write_text("\n".join([header, *rows[200:1800]]) + "\n")

    assert confirm("valve", "copy.csv")[0] == 1
    assert "is a log from which the law was found" in confirm("valve", "copy.csv")[1]
    assert "repeats log.csv, channel by channel" in confirm("valve", "again.csv")[1]
    assert "repeats log.csv, channel by channel" in confirm("valve", "cut.csv")[1]
    (project / "elsewhere").mkdir()
    monkeypatch.chdir(project / "elsewhere")
    file = str(project / "effects" / "valve.toml")
    assert "repeats log.csv, channel by channel" in confirm(file, "../again.csv")[1]
    assert (project / "effects" / "valve.toml").read_text() == known


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["valfe", "log.csv"], "did you mean 'valve'.*; give the file of a proposed law"),
        (["internal_leakage", "log.csv"], "not an effect from a TOML file"),
        (["log.csv", "effects/valve.toml"], "effects/valve.toml: is no log; give the effect's file first"),
    ],
)
def test_wrong_input(project, words, error):
    """The error says what there is, or is to be given, instead."""
    with pytest.raises(e.InputError, match=error):
        CliRunner().invoke(app, ["effects", "confirm", "--plant", "ehsa", *words], catch_exceptions=False)


def test_a_plant_without_what_the_law_needs(project):
    """A carriage has no pressures: the reason, before any log is looked at."""
    with pytest.raises(e.InputError, match=r"valve\.toml: expression: 'P_1' is not known"):
        e.confirm_law(e.load_plant("emps"), "valve", [])


def test_a_file_that_could_not_be_written(project, monkeypatch):
    """Is refused before the logs are read."""
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(e.InputError, match=r"valve\.toml: its folder is not writable"):
        CliRunner().invoke(
            app, ["effects", "confirm", "valve", "missing.csv", "--plant", "ehsa"], catch_exceptions=False
        )


def test_a_stretch_of_a_log_repeats_it():
    """Cut, begun later, sampled otherwise; not with another waveform or in part only."""
    time = 0.004 * np.arange(3000)
    random = np.random.default_rng(0)
    waves = {name: np.cumsum(random.standard_normal(time.size)) for name in ("speed", "p1")}
    log = Log(time, waves)
    cut = Log(time[:2000], {name: wave[700:2700] for name, wave in waves.items()})
    slow = Log(time[::3], {name: wave[::3] for name, wave in waves.items()})
    other = Log(time, {"speed": waves["speed"], "p1": waves["p1"][::-1].copy()})
    begins = np.concatenate([waves["speed"][2000:], np.cumsum(random.standard_normal(2000))])
    tail = Log(time, {"speed": begins, "p1": waves["p1"]})

    assert _alike(log, cut) and _alike(cut, log) and _alike(log, slow)
    assert not _alike(log, other) and not _alike(log, tail)


def numbers_of(refitted, sd, moved):
    """A test of a brake from 3 A on whose law changes a run by 40 %, refitted to other logs."""
    sizes = {"c_1": (0.8, "N m", 0.0), "c_at_1": (3.0, "A", None), "c_width_1": (0.05, "A", None)}
    law = LawFile.model_validate(
        {
            "schema": 1, "status": "proposed", "summary": "brake", "adds_to": "torque",
            "expression": "c_1 * d_M * 0.5 * (1 + tanh((c_at_1 - current) / c_width_1))",
            "parameters": {
                n: {"value": v, "unit": u, "sd": 0.001 * v} | ({} if zero is None else {"neutral": zero})
                for n, (v, u, zero) in sizes.items()
            },
        }
    )  # fmt: skip
    values = {n: one.value for n, one in law.parameters.items()}
    gap = {"nominal": 0.4, "refit": 0.3, "with_law": 0.01, "law_refitted": 0.01}
    gap = {model: {"total": value} for model, value in gap.items()}
    return _Test(None, values, law, values | refitted, dict.fromkeys(values, 0.001) | sd, gap, 0.4, moved, 0.03)


@pytest.mark.parametrize(
    ("refitted", "sd", "moved", "refused"),
    [
        ({"c_width_1": 0.2}, {}, {"c_at_1": 0.0, "c_width_1": 0.002}, []),
        ({"c_at_1": 2.5}, {}, {"c_at_1": 0.2, "c_width_1": 0.0}, ["the size changes: c_at_1 is 2.5"]),
        ({"c_1": 0.9}, {}, {"c_at_1": 0.0, "c_width_1": 0.0}, ["the size changes: c_1 is 0.9"]),
        ({}, {"c_1": np.inf}, {"c_at_1": 0.0, "c_width_1": 0.0}, ["c_1 can't be determined"]),
    ],
)
def test_what_counts_as_a_change(refitted, sd, moved, refused):
    """A width that changes no run is none; a number that no run shows has no size."""
    found = numbers_of(refitted, sd, moved).refusals

    assert len(found) == len(refused)
    assert all(words in one for one, words in zip(found, refused, strict=True))


@pytest.mark.parametrize(("found", "refused"), [(True, False), (False, True)])
def test_a_number_that_its_log_did_not_determine_may_differ(found, refused):
    """A diagnosis leaves out the deviation; a number written by hand, without a log, holds."""
    test = numbers_of({"c_at_1": 2.5}, {}, {"c_at_1": 0.2, "c_width_1": 0.0})
    at = test.law.parameters["c_at_1"].model_copy(update={"sd": None})
    logs = [LawLog(path="log.csv", sha256="0" * 64)] if found else []
    law = test.law.model_copy(update={"parameters": {**test.law.parameters, "c_at_1": at}, "logs": logs})

    assert bool(replace(test, law=law).refusals) == refused


def test_a_run_that_stops_is_no_share():
    """The reason is said; there is no gap in percent."""
    test = numbers_of({}, {}, {})
    (reason,) = replace(test, gap={**test.gap, "with_law": {"total": float("inf")}}).refusals

    assert "stops early there: the log may leave the range" in reason and "inf" not in reason


def test_a_direction_of_motion_has_no_range(plant):
    """Dry friction at a place: the range is that of the place, as in the log."""
    log, _ = e.record(plant, *e.excitation("noise", amplitude=3.0, duration=3.0, sample_time=0.004), centre=True)
    law = {
        **tomllib.loads(FILE), "adds_to": "force", "expression": "A_rig * d_R * abs(x)", "range": {},
        "parameters": {"A_rig": {"value": 1e3, "unit": "N/m", "neutral": 0.0}},
    }  # fmt: skip
    found = _ranges(prepare_logs(plant, [log], None, 0.03, check=False), LawFile.model_validate(law))

    assert found.keys() == {"x"}
    np.testing.assert_allclose(found["x"].seen, (log["position"].min(), log["position"].max()), atol=1e-4)


def test_ranges_grow_together():
    """What both logs show, and how much wider that is."""
    pair = SeenRange((0.0, 2.0), (-1.0, 1.0))

    assert pair.both == (-1.0, 2.0)
    assert pair.beyond == pytest.approx(0.5)
    assert SeenRange(None, (0.0, 1.0)).both == (0.0, 1.0)


@pytest.mark.slow
def test_a_second_log_confirms(project):
    """Another waveform of the same rig: the law as proposed closes the gap, and the file keeps its comments."""
    record(project, "second.csv", kind="multisine", seed=3)
    status, output = confirm("valve", "second.csv", "--json")
    found = json.loads(output[output.index("{") : output.rindex("}") + 1])
    text = (project / "effects" / "valve.toml").read_text()
    content = tomllib.loads(text)

    assert status == 0 and found["confirmed"] and not found["refused"]
    assert found["gap_closed"] > 0.9
    assert found["parameters"]["k_rig"]["overlaps"] and found["parameters"]["P_rig"]["overlaps"]
    assert content["status"] == "confirmed" and content["logs"][0]["path"] == "second.csv"
    assert content["range"]["P_1"][0] < 1e6 < 1.9e6 < content["range"]["P_1"][1]
    assert "# Found on the day of the acceptance test." in text and "# tank is at 0" in text
    assert confirm("valve", "second.csv")[0] == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "amplitude", "words"),
    [
        (2.5, 3.0, "the size changes: k_rig"),
        (-1.0, 3.0, "the law gains nothing"),
        (0.0, 3.0, "the nominal plant has no gap"),
    ],
)
def test_refusals(project, factor, amplitude, words):
    """A rig whose valve is larger, one that feeds oil in instead, and one without it; the file stays as it is."""
    record(project, "other.csv", factor, seed=2, amplitude=amplitude)
    status, output = confirm("valve", "other.csv")

    assert status == 1, output
    assert words in output
    assert (project / "effects" / "valve.toml").read_text() == FILE


def test_a_refused_law_is_not_written(tmp_path):
    """Its file stays as it is."""
    file = tmp_path / "drag.toml"
    file.write_text('status = "proposed"\n')
    law = LawFile.model_validate(
        {
            "schema": 1, "status": "proposed", "summary": "cubic drag", "adds_to": "force",
            "expression": "c_1 * v**3", "parameters": {"c_1": {"value": 4e5, "unit": "N s3/m3", "neutral": 0.0}},
        }
    )  # fmt: skip

    with pytest.raises(InputError, match="drag is not confirmed: nothing moves"):
        Confirmation("drag", file, law, (), ("nothing moves",)).write()
    assert file.read_text() == 'status = "proposed"\n'


def test_a_diagnosis_that_names_the_law_does_not_refuse_it():
    """There its numbers are refitted, so that it closes more than as proposed; another effect would be a reason."""
    own = SimpleNamespace(gap={"with_law": {"total": 0.07}, "nominal": {"total": 1.0}})
    found = SimpleNamespace(effects=(Cause("drag", None, "force", 0.9, {}),), explained=0.98, verdict="effect")

    assert _Test.closed_by(own, found, "drag") == ()
    assert "drag of the catalogue closes more: 98 % against 93 %" in _Test.closed_by(own, found, "other")[0]
