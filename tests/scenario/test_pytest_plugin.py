"""`pytest scenarios/` in a user's own project."""

import pytest

from ehsa_ctrl.scenario.run import run as run_scenario

pytest_plugins = ["pytester"]

LIMIT = '\n[limits]\nMaxError = { max = "3 mm" }\n'
BROKEN = '\n[limits]\nMaxError = { max = "1 um" }\n'


@pytest.fixture(autouse=True, scope="module")
def _modules_are_loaded(tmp_path_factory):
    """Import what a scenario needs before pytester does, which forgets modules after each run: NumPy can't be imported
    twice.
    """
    from .conftest import SHORT

    file = tmp_path_factory.mktemp("loaded") / "short.toml"
    file.write_text(SHORT)
    run_scenario(file)


@pytest.fixture
def run(pytester, monkeypatch):
    """Run pytest in a folder with these scenarios (name -> what stands below the short move)."""
    from .conftest import SHORT

    folder = pytester.mkdir("scenarios")

    def call(*arguments, **scenarios):
        for name, add in scenarios.items():
            (folder / f"{name}.toml").write_text(SHORT + add if add is not None else SHORT.replace("title", "titel"))
        return pytester.runpytest_inprocess("scenarios", "-p", "no:cacheprovider", "-rs", *arguments)

    return call


def test_every_toml_of_the_folder_is_a_test(run):
    """Pass, fail and untested; a failure is its sentences, not a traceback, and says why the scenario is there."""
    result = run(good=LIMIT, bad=BROKEN, idle="")

    result.assert_outcomes(passed=1, failed=1, skipped=1)
    result.stdout.fnmatch_lines(
        ["*scenario bad failed:*", "*MaxError * (at most 0.001 mm)*", "*untested: idle.toml sets no limit*"]
    )
    result.stdout.fnmatch_lines(["*Tests need a run that takes little time.*"])
    result.stdout.no_fnmatch_line("*Traceback*")


def test_a_mistake_in_a_file_is_one_sentence(run):
    """File and key."""
    result = run(wrong=None)

    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*wrong.toml: titel: unknown key; did you mean 'title'?*"])
    result.stdout.no_fnmatch_line("*Traceback*")


def test_other_controllers_are_tests_of_their_own(run, pytester):
    """One test for each name; a controller of the project beside the scenarios is found."""
    from ehsa_ctrl.core.catalogue import controllers

    pytester.mkdir("controllers").joinpath("mine.toml").write_text(controllers["pid_position"].read_text())
    result = run("--ehsa-controller", "pid_position,mine", "-v", good=LIMIT)

    result.assert_outcomes(passed=2)
    result.stdout.fnmatch_lines(["*good?pid_position? PASSED*", "*good?mine? PASSED*"])


def test_a_controller_of_another_drive_is_skipped(run):
    """One in N does not fit a plant whose drive is in A."""
    result = run("--ehsa-controller", "carriage_pid", good=LIMIT)

    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*good.toml has a plant with another drive than that of carriage_pid*"])


@pytest.mark.slow
def test_baselines_are_recorded_with_a_reason_and_then_hold(run, pytester):
    """Recorded, kept, left by another plant with the figure and the table of it, recorded anew."""
    result = run("--ehsa-update-baselines", "--ehsa-reason", "first look", good=LIMIT)
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(["*baselines recorded*", "good", "*recorded for the first time*"])
    run().assert_outcomes(passed=1)

    other = LIMIT + '\n[settings]\nA_FR = "1300 N"\n'
    result = run("--ehsa-out", "seen", good=other)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*x leaves its tube by*", "*because: first look; changed since then: *"])
    seen = {path.name for path in (pytester.path / "seen").iterdir()}
    assert {"good-pid_position.png", "good-pid_position-baseline.png", "good-pid_position-baseline.csv"} < seen

    result = run("--ehsa-update-baselines", "--ehsa-reason", "stiffer seal")
    result.assert_outcomes(passed=1)
    result.stdout.fnmatch_lines(["*RMSError (nonlinear) was * and is *"])


def test_baselines_are_not_changed_without_a_reason(run):
    """A usage error with what to do, before anything is run."""
    result = run("--ehsa-update-baselines", good=LIMIT)

    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(["*needs --ehsa-reason TEXT*"])


def test_other_tomls_are_left_alone(pytester):
    """A scenario lies in a folder of that name and has the form of one; other projects have such folders too."""
    from .conftest import SHORT

    pytester.makefile(".toml", settings="a = 1", elsewhere=SHORT)
    folder = pytester.mkdir("scenarios")
    (folder / "game.toml").write_text('title = "level 1"\nduration = 30\n[[enemy]]\nkind = "troll"\n')
    (folder / "broken.toml").write_text("[[[")
    (folder / "bytes.toml").write_bytes(b"\xff\xfe\x00")

    assert pytester.runpytest_inprocess("-p", "no:cacheprovider").ret == pytest.ExitCode.NO_TESTS_COLLECTED
