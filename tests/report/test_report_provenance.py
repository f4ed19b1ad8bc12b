"""What a page says of its origin: date, command, versions and files, and neither user nor machine."""

import shutil
import sys
from pathlib import Path

import pytest

import ehsa_ctrl as e
from ehsa_ctrl.cli.output import command_line
from ehsa_ctrl.report.kinds import kinds
from ehsa_ctrl.report.provenance import date, hashes, local_name
from ehsa_ctrl.report.results import write_result_page


@pytest.mark.parametrize("name", sorted(kinds()))
def test_every_page_states_date_command_and_versions(tree, tmp_path, name, monkeypatch):
    """Of each kind of result, in its own page."""
    folder = tmp_path / "one"
    shutil.copytree(tree / name.removesuffix(".json"), folder)

    page = write_result_page(folder, name).read_text(encoding="utf-8")

    assert page.count("2026-05-04 12:30 UTC") == 2
    assert "ehsa-ctrl &lt;do&gt; it" in page
    assert "<dt>python</dt>" in page and "<dt>ehsa_ctrl</dt>" in page
    assert "plants/ehsa.toml" in page and str(Path(e.__file__).parents[1]) not in page


def test_the_date_is_utc_and_can_be_fixed(monkeypatch):
    """1777897800 s after 1970 is noon and a half of 4 May 2026; nonsense in the variable is no date."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1777897800")
    assert date() == "2026-05-04 12:30 UTC"
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    assert date() != "2026-05-04 12:30 UTC"


def test_files_are_named_without_the_folders_of_the_user(tmp_path, monkeypatch):
    """Relative to the current folder; from elsewhere the last two parts; a shipped plant by its name."""
    (tmp_path / "work" / "rig").mkdir(parents=True)
    (tmp_path / "elsewhere" / "bench").mkdir(parents=True)
    inside, outside = tmp_path / "work" / "rig" / "log.csv", tmp_path / "elsewhere" / "bench" / "log.csv"
    for file in (inside, outside):
        file.write_text("t\n")
    monkeypatch.chdir(tmp_path / "work")

    names = [name for name, _ in hashes([inside, outside, "rig/log.csv", e.plants["ehsa"], None])]

    assert names == ["rig/log.csv", "bench/log.csv", "plants/ehsa.toml"]
    assert local_name("rig/log.csv") == "rig/log.csv"


def test_the_command_line_has_no_folder_of_the_user(tmp_path, monkeypatch):
    """Paths in the current folder and in the home folder; the latter still works in a shell."""
    home, work = tmp_path / "anna", tmp_path / "work"
    home.mkdir(), work.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(work)
    monkeypatch.setattr(
        sys, "argv", ["x", "diagnose", f"{work}/a b.csv", "--plant", f"{home}/rig.toml", "--set", "A=1 N"]
    )

    assert command_line() == "ehsa-ctrl diagnose 'a b.csv' --plant ~/rig.toml --set 'A=1 N'"
