"""`ehsa-ctrl compare` as a user meets it."""

import json

import numpy as np
import pandas
import pytest

from ehsa_ctrl import excitation, load_plant, record


@pytest.fixture
def log(tmp_path):
    """Four seconds of the unloaded bench: log.csv in the current folder, and the log."""
    time, current = excitation("steps", amplitude=3.0, duration=4.0)
    log, _ = record(load_plant("ehsa"), time, current)
    log.write(tmp_path / "log.csv")
    return log


def test_both_models_are_compared_with_the_log(run, log):
    """A table, how each run starts, no complaint on standard error (an engine may be compiled), exit status 0."""
    status, out, err = run("compare", "log.csv", "--plant", "ehsa")

    assert status == 0 and "ehsa-ctrl:" not in err
    assert "linear   nonlinear" in out
    assert "nonlinear starts at rest, as the plant" in out
    cells = next(line for line in out.splitlines() if line.startswith("speed")).split()
    assert float(cells[2]) > 98.0 > float(cells[1])


@pytest.mark.slow
def test_what_is_wrong_outside_the_stretch_does_no_harm(run, log, tmp_path):
    """A gap in time and an empty cell after --to: refused as a whole, compared up to there."""
    table = pandas.read_csv(tmp_path / "log.csv")
    table.loc[table.index[-5], "speed"] = np.nan
    table.drop(index=range(800, 820)).to_csv(tmp_path / "bad.csv", index=False)

    assert run("compare", "bad.csv", "--plant", "ehsa")[0] == 2
    status, out, err = run("compare", "bad.csv", "--plant", "ehsa", "--to", "3")
    assert status == 0 and "segment from 0 to 3 s" in out and "ehsa-ctrl:" not in err


def test_a_column_that_is_mapped_and_not_there_is_named(run, log, tmp_path):
    """Left out it would be missed in silence."""
    (tmp_path / "plants").mkdir()
    assert run("new", "plant", "rig")[0] == 0
    file = tmp_path / "plants" / "rig.toml"
    file.write_text(file.read_text() + '\n[log]\nspeed = { column = "n" }\np1 = { column = "pX", scale = 1e5 }\n')
    table = pandas.read_csv(tmp_path / "log.csv").rename(columns={"speed": "n", "p1": "pY"})
    table.to_csv(tmp_path / "log.csv", index=False)

    status, _, err = run("compare", "log.csv", "--plant", "rig")

    assert status == 0
    said = " ".join(err.split())
    assert "log.csv: has no column 'pX', where the plant's [log] looks for p1; did you mean 'pY'?" in said


@pytest.mark.slow
def test_the_result_is_in_json_csv_and_figures(run, log, tmp_path):
    """The same figures everywhere; an existing result stays unless --force is said."""
    call = ("compare", "log.csv", "--plant", "ehsa", "--from", "1", "--zero", "p1,p2", "--out", "out", "--json")
    status, out, _ = run(*call)
    result = json.loads(out)
    table = pandas.read_csv(tmp_path / "out" / "compare.csv")
    fit = result["models"]["nonlinear"]["fit_percent"]["p1"]
    left = np.linalg.norm(table["p1_measured"] - table["p1_nonlinear"])

    assert status == 0
    assert json.loads((tmp_path / "out" / "comparison.json").read_text()) == result
    assert [step["kind"] for step in result["preparation"]] == ["zero", "zero", "segment"]
    assert fit == pytest.approx(100 * (1 - left / np.linalg.norm(table["p1_measured"] - table["p1_measured"].mean())))
    assert {"compare.png", "compare.svg"} <= {path.name for path in (tmp_path / "out").iterdir()}
    assert run(*call)[0] == 2
    assert run(*call, "--force")[0] == 0


def test_a_setting_of_one_model_is_for_that_model(run, log):
    """A_FR is no symbol of the linear model; --model linear says so."""
    assert run("compare", "log.csv", "--plant", "ehsa", "--set", "A_FR=900")[0] == 0
    status, _, err = run("compare", "log.csv", "--plant", "ehsa", "--set", "A_FR=900", "--model", "linear")
    assert status == 2 and "the linear model of ehsa has no such parameter" in err
    status, _, err = run("compare", "log.csv", "--plant", "ehsa", "--set", "A_XX=900")
    assert status == 2 and "no such parameter" in err


def test_a_setting_of_a_sensor_is_for_both_models(run, log):
    """A speed that is believed to be scaled by two is half as fast for either model, so that both fits fall."""

    def fits(*options):
        status, out, _ = run("compare", "log.csv", "--plant", "ehsa", *options)
        assert status == 0
        return [float(cell) for cell in next(row for row in out.splitlines() if row.startswith("speed")).split()[1:]]

    for plain, scaled in zip(fits(), fits("--set", "scale.speed=2"), strict=True):
        assert scaled < plain - 20.0


def test_findings_are_warnings_and_what_is_missing_is_said(run, log, tmp_path):
    """Speed in rpm, no pressures."""
    table = log.to_pandas().drop(columns=["p1", "p2"])
    table["speed"] *= 30 / np.pi
    table.to_csv(tmp_path / "log.csv", index=False)
    status, out, err = run("compare", "log.csv", "--plant", "ehsa", "--model", "nonlinear")

    assert status == 0
    assert "warning: speed varies" in err and "probably in rpm" in err
    assert "warning: without p1 the log does not show" in err and "without force" not in out + err


def test_somebody_elses_log_is_mapped_by_the_plant(run, log, tmp_path):
    """Columns, units and a sign of their own; the fit is that of the plain log."""
    plain = json.loads(run("compare", "log.csv", "--plant", "ehsa", "--json")[1])
    table = log.to_pandas()
    other = pandas.DataFrame(
        {
            "ms": 1e3 * table["t"],
            "I": table["current"],
            "n_rpm": -table["speed"] * 30 / np.pi,
            "pA_bar": table["p1"] / 1e5,
        }
    )
    other.to_csv(tmp_path / "other.csv", index=False)
    text = (load_plant("ehsa").path).read_text()
    mapping = """
[log]
t = { column = "ms", scale = 1e-3 }
current = { column = "I" }
speed = { column = "n_rpm", scale = -0.10471975511965977 }
p1 = { column = "pA_bar", scale = 1e5 }
"""
    (tmp_path / "rig.toml").write_text(text + mapping)
    status, out, _ = run("compare", "other.csv", "--plant", "rig.toml", "--json")

    assert status == 0
    fits = json.loads(out)["models"]["nonlinear"]["fit_percent"]
    assert set(fits) == {"speed", "p1"}
    for channel, fit in fits.items():
        assert fit == pytest.approx(plain["models"]["nonlinear"]["fit_percent"][channel], abs=1e-3)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ('pressure = { column = "x" }', "[log] pressure: unknown channel; "),
        ('p1 = { column = "x", scale = 0 }', "[log] p1: scale = 0: must be a finite number other than 0"),
        ('p1 = { colum = "x" }', "colum"),
    ],
)
def test_a_wrong_mapping_is_one_sentence(run, log, tmp_path, line, says):
    """With file and key."""
    (tmp_path / "rig.toml").write_text(load_plant("ehsa").path.read_text() + f"\n[log]\n{line}\n")
    status, _, err = run("compare", "log.csv", "--plant", "rig.toml")

    assert status == 2
    assert says in err and "rig.toml" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nothing.csv",), "nothing.csv: no such file"),
        (("log.csv", "--model", "cubic"), "not one of 'linear', 'nonlinear', 'both'"),
        (("log.csv", "--from", "9"), "the log runs from 0 to 4 s"),
        (("log.csv", "--zero", "p3"), "no zero of 'p3'"),
        (("log.csv", "--zero", "p1=0"), "--zero 'p1=0': 'p1=0' is not a channel name; expected names separated"),
        (("log.csv", "--zero", "p1 p2"), "as in --zero p1,p2: it shifts each channel to its value at rest"),
        (("log.csv", "--zero", "0:0.5"), "--rest 0:0.5 gives the time of that rest"),
        (("log.csv", "--align", "speed=3"), "as in --align p1,p2: it shifts each channel in time by its delay"),
        (("log.csv", "--rest", "abc"), "--rest 'abc': expected two times"),
        (("log.csv", "--resample", "-1"), "the rate must be a number greater than 0"),
        (("log.csv", "--align", "force"), "no alignment of 'force'"),
    ],
)
def test_a_wrong_call_is_one_sentence(run, log, arguments, says):
    """Exit status 2, no traceback."""
    status, _, err = run("compare", *arguments, "--plant", "ehsa")

    assert status == 2
    assert says in err and err.count("\n") == 1


def test_a_log_of_another_program_gives_the_same_fit(run, log, tmp_path):
    """Semicolons, decimal commas, a row of units, Latin-1: said on standard error and in the JSON, the fit the same."""
    plain = json.loads(run("compare", "log.csv", "--plant", "ehsa", "--model", "nonlinear", "--json")[1])
    table = log.to_pandas().round({"current": 5, "speed": 4, "p1": 1, "p2": 1, "position": 7})
    table["p1"] /= 1e5
    table["position"] *= 1e3
    head, _, rest = table.to_csv(index=False, sep=";", decimal=",").partition("\n")
    units = ";".join({"t": "s", "current": "A", "p1": "bar", "position": "mm"}.get(name, "-") for name in table)
    (tmp_path / "other.csv").write_text(f"# Prüfstand\n{head}\n{units}\n{rest}", encoding="latin-1")
    status, out, err = run("compare", "other.csv", "--plant", "ehsa", "--model", "nonlinear", "--json")
    result = json.loads(out)

    assert status == 0
    for channel, fit in plain["models"]["nonlinear"]["fit_percent"].items():
        assert result["models"]["nonlinear"]["fit_percent"][channel] == pytest.approx(fit, abs=1e-3)
    assert [step["kind"] for step in result["preparation"]] == ["read", "read"]
    assert "note: other.csv: read with ';' between columns, decimal commas, Latin-1 text" in err
    assert "note: other.csv: converted by its row of units: p1 from bar, position from mm" in err


def test_columns_of_another_name_come_with_their_lines(run, log, tmp_path):
    """One sentence that can be pasted into a TOML; what is only missing is mentioned and the log is used."""
    log.to_pandas().rename(columns={"current": "I [A]", "p1": "p_1"}).to_csv(tmp_path / "other.csv", index=False)
    status, _, err = run("compare", "other.csv", "--plant", "ehsa")
    assert status == 2 and err.count("\n") == 1
    assert 'write current = { column = "I [A]" }, p1 = { column = "p_1" } under [log] in the plant\'s TOML' in err

    log.to_pandas().rename(columns={"p1": "p_1"}).to_csv(tmp_path / "other.csv", index=False)
    status, _, err = run("compare", "other.csv", "--plant", "ehsa", "--model", "nonlinear")
    assert status == 0 and 'write p1 = { column = "p_1" } under [log]' in err


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        (
            "P_0=20",
            "P_0 = 20 Pa is 1/1e+05 of the file's 20 bar; a number without a unit is in Pa; if bar is meant, "
            "write P_0='20 bar'",
        ),
        ("P_0=20 bar", ""),
        ("K_T=5", "K_T = 5 N m/A lies outside 0.87 to 1.6 N m/A"),
        ("K_L=4e-12", ""),
        (
            "A=15",
            "A = 15 m2 is 9.82e+03 times the file's 15.2681 cm2; a number without a unit is in m2; if cm2 is meant, "
            "write A='15 cm2'",
        ),
        ("load.stiffness=50e3", ""),
        ("P_0=0", ""),
    ],
)
def test_a_value_of_another_unit_is_warned_of(run, setting, says):
    """A thousand times too small or large is a unit that was left out; from nothing to something is none."""
    status, _, err = run("analyse", "ehsa", "--set", setting)

    assert status == 0
    assert says in err and ("warning" in err) == bool(says)


def test_time_in_minutes_is_refused(run, log, tmp_path):
    """A fit over the wrong time says nothing."""
    table = log.to_pandas()
    table["t"] /= 60
    table.to_csv(tmp_path / "log.csv", index=False)
    status, out, err = run("compare", "log.csv", "--plant", "ehsa", "--model", "nonlinear")

    assert status == 2 and out == ""
    assert err.startswith("ehsa-ctrl: log.csv: column 't'") and "probably in minutes" in err


def test_a_part_that_is_left_out_is_not_warned_of(run, log, tmp_path):
    """A spike of 900 bar at 3 s, and --to 2."""
    table = log.to_pandas()
    table.loc[750, "p1"] = 9e7
    table.to_csv(tmp_path / "log.csv", index=False)

    assert "p1 jumps to 9e+07 Pa at 3 s" in run("compare", "log.csv", "--plant", "ehsa", "--model", "nonlinear")[2]
    assert run("compare", "log.csv", "--plant", "ehsa", "--model", "nonlinear", "--to", "2")[2] == ""
