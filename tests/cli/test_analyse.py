"""`ehsa-ctrl analyse` with many plants and a review."""

import json
import re

import pytest

import ehsa_ctrl as e


def test_the_worst_plant_is_named(run):
    """Draws and springs with two controllers: one entry each."""
    status, out, _ = run(
        "analyse", "ehsa", "--controller", "pid_position,lqr_position", "--draws", "4", "--stiffness", "0,50 kN/m",
        "--json",
    )  # fmt: skip
    found = json.loads(out)

    assert status == 0
    assert [loop["controller"] for loop in found["loops"]] == ["pid_position", "lqr_position"]
    assert found["loop"] == found["loops"][0]
    for one, name in zip(found["robust"], ("pid_position", "lqr_position"), strict=True):
        worst = one["worst"]["disk_margin"]
        assert one["controller"] == name and one["plants"] == 6 and one["stable"]
        assert "K_S (load.stiffness) = " in worst["plant"]
        assert worst["value"] < next(loop["disk_margin"] for loop in found["loops"] if loop["controller"] == name)


@pytest.mark.slow
def test_figures_and_a_table_are_written(run, tmp_path):
    """Bode, loop, Nyquist, the bands, and every plant's margins."""
    status, out, _ = run("analyse", "ehsa", "--controller", "pid_position", "--draws", "2", "--json", "--out", "a")
    table = (tmp_path / "a" / "robustness.csv").read_text().splitlines()

    assert status == 0
    for name in ("bode", "loop", "nyquist", "robustness"):
        assert (tmp_path / "a" / f"{name}.png").is_file()
    assert len(table) == 4 and table[0].startswith("plant,stable,crossover,Ms")
    assert json.loads((tmp_path / "a" / "analysis.json").read_text()) == json.loads(out)


def test_a_review_is_printed(run):
    """With what friction does, from the plant's nonlinear set."""
    status, out, _ = run("analyse", "ehsa", "--controller", "pid_position", "--review")

    assert status == 0
    assert "review of pid_position" in out and "1.08 A" in out and "stick band" in out
    assert "disk margin" in out


def test_a_single_spring_is_a_condition(run):
    """The loop is designed on the plant as it is, and tried with the spring."""
    status, out, _ = run("analyse", "ehsa", "--controller", "pid_position", "--stiffness", "100 kN/m", "--json")
    (robust,) = json.loads(out)["robust"]

    assert status == 0
    assert robust["worst"]["Ms"]["plant"] == "K_S (load.stiffness) = 100 kN/m"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--draws", "5"], "analyse a loop; name its controller with --controller"),
        (["--controller", "pid_position", "--stiffness", "5 kg"], "--stiffness '5 kg'"),
        (["--controller", "pid_position", "--covariance", "x.json"], "give their number with --draws"),
        (["--controller", "pid_position", "--draws", "2", "--covariance", "x.json"], "x.json: no such file"),
        (["--controller", "pid_positon"], "did you mean 'pid_position'"),
        (
            ["--controller", "pid_position", "--draws", "2", "--spread", "0"],
            "no parameter of ehsa (linear) has an uncertainty",
        ),
    ],
)
def test_wrong_input_is_one_sentence(run, arguments, says):
    """On standard error, status 2."""
    status, out, err = run("analyse", "ehsa", *arguments)

    assert status == 2 and out == ""
    assert says in err and len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("plant", "says"),
    [
        ("emps", "from F_M"),
        ("xl330_pendulum", "from goal"),
        ("mbari_pto", "from the current"),
    ],
)
def test_a_plant_without_a_linear_set_is_linearised(run, tmp_path, plant, says):
    """Its nonlinear set while sliding; the page and the Bode plot name its drive."""
    status, out, err = run("analyse", plant, "--out", tmp_path / plant)

    assert status == 0, err
    assert says in out and "linearised" in out
    assert (tmp_path / plant / "bode.svg").is_file()
    assert says.removeprefix("from ").removeprefix("the ") in (tmp_path / plant / "report.html").read_text()


def test_a_controller_for_another_drive_is_refused(run):
    """Gains in A on a plant that has a force; and a plant whose controller is part of it."""
    assert "the drive of this plant is in N" in run("analyse", "emps", "--controller", "pid_position")[2]
    assert "is the firmware's" in run("analyse", "xl330_pendulum", "--controller", "pid_position")[2]


def test_the_loop_of_a_carriage(run, tmp_path):
    """P over P: at low frequency the compliance under force is 1 / (kp kv), and the units are those of a force."""
    file = tmp_path / "pv.toml"
    file.write_text(
        'schema = 1\nkind = "pid"\ntitle = "t"\nsample_time = "1 ms"\ncurrent_limit = "300 N"\n'
        '[gains]\nform = "velocity"\nkp = "160 1/s"\nkv = "8500 N s/m"\nT_f = "0.5 ms"\n'
    )

    loop = json.loads(run("analyse", "emps", "--controller", file, "--json")[1])["loop"]

    assert loop["stable"] and loop["static_compliance"] == pytest.approx(-1.0 / (160.0 * 8500.0), rel=1e-6)


def test_the_page_to_open_is_named(run, tmp_path):
    """With --out, the last line names a page that is there."""
    status, out, _ = run("analyse", "ehsa", "--out", "linear")

    assert status == 0 and out.splitlines()[-1] == "written to linear (open linear/report.html)"
    assert (tmp_path / "linear" / "report.html").is_file()


@pytest.mark.parametrize(
    "words", [["design", "FILE", "--kind", "pid"], ["analyse", "FILE"], ["check", "FILE"]], ids=lambda words: words[0]
)
def test_a_plant_without_a_model_is_one_sentence(run, tmp_path, words):
    text = e.plants["ehsa"].read_text(encoding="utf-8")
    parts = re.split(r"(?m)^(?=\[)", text)
    file = tmp_path / "none.toml"
    file.write_text("".join(part for part in parts if not part.startswith(("[linear", "[nonlinear"))), encoding="utf-8")
    status, out, err = run(*[file if word == "FILE" else word for word in words])

    assert status != 0
    assert "has neither a [linear] nor a [nonlinear] model" in out + err
    assert "Traceback" not in out + err
