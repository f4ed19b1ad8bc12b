"""What commands say of themselves and leave behind."""

import re
import shlex

import numpy as np
import pytest

from ehsa_ctrl.cli.progress import compiling
from ehsa_ctrl.core import compiled
from ehsa_ctrl.identification.comparison import fit_cell


def test_a_group_without_a_command_says_which_there_are(run):
    """Its help, and one sentence with its commands."""
    status, out, err = run("new")

    assert status == 2 and "Usage: ehsa-ctrl new" in out
    assert err == "ehsa-ctrl new: missing command, one of: plant, controller, scenario; see ehsa-ctrl new --help\n"


def test_help_shows_tables_in_brackets(run):
    """Brackets are the name of a table and no markup."""
    _, out, _ = run("design", "--help")

    assert "Key of [weights]: position='0.5 mm'." in out and "Key of [limits]: pressure='150 bar'." in out


def test_a_refusal_leaves_no_folder(run, tmp_path):
    """Neither the folder that was to hold the result nor those above it; one that was there stays."""
    (tmp_path / "mine").mkdir()

    assert run("run", "steps_spring", "--controller", "nix")[0] == 2
    assert run("run", "steps_spring", "--controller", "nix", "--out", "a/b/c")[0] == 2
    assert run("run", "steps_spring", "--controller", "nix", "--out", "mine/b")[0] == 2

    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine"]
    assert list((tmp_path / "mine").iterdir()) == []


@pytest.mark.slow
def test_a_page_has_the_command_as_a_shell_takes_it(run, tmp_path):
    """Arguments with a space stay one argument."""
    (tmp_path / "my folder").mkdir()
    arguments = ["run", "force_step", "--no-assumed", "--out", "my folder/it"]

    run(*arguments)
    (said,) = re.findall(r"<pre><code>(ehsa-ctrl .*?)</code>", (tmp_path / "my folder/it/report.html").read_text())

    assert shlex.split(said.replace("&#39;", "'")) == ["ehsa-ctrl", *arguments]


def test_compiling_is_said_without_python(capsys, tmp_path, monkeypatch):
    """Before it begins, in a line, with how long it takes."""
    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path))
    with compiling():
        compiled.load_compiled("pass\n", "the open loop")

    said = "compiling the open loop: once, some seconds, longer on a busy machine"
    assert capsys.readouterr().err == f"{said}\n"


def test_a_fit_far_off_keeps_its_column():
    """At most ten characters, whatever the number."""
    for percent in (99.99, -123456.789, -1e6, -9.876543e17, 1e300, float("inf"), np.float64(-1e9)):
        assert len(fit_cell(percent)) <= 10
    assert fit_cell(float("nan")) == "-" and fit_cell(-148.288) == "-148.29"
