"""Which rig and day a log is of: by folder and name, by fleet.csv, and wrong input in one sentence."""

from datetime import UTC, datetime

import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.fleet.manifest import find_logs


@pytest.fixture
def folder(tmp_path):
    for name in ("b/20260302.csv", "b/run 2026-03-01 14:30.csv", "a/x.parquet"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("t\n")
    return tmp_path


def manifest(folder, *lines):
    (folder / "fleet.csv").write_text("\n".join(lines) + "\n")


def test_the_folder_is_the_rig_and_the_name_has_the_date(folder):
    """In order of rig and time; a file without a date has that of its last change."""
    found = find_logs([folder])

    assert [(log.rig, log.path.name) for log in found] == [
        ("a", "x.parquet"), ("b", "run 2026-03-01 14:30.csv"), ("b", "20260302.csv")
    ]  # fmt: skip
    assert found[1].date == datetime(2026, 3, 1, 14, 30, tzinfo=UTC)
    assert [log.dated for log in found] == ["file time", "name", "name"]


def test_a_manifest_says_it(folder):
    """Its own rigs and dates; only the logs that it lists."""
    manifest(folder, "file,serial,date", "b/20260302.csv,17,2026-01-01", "a/x.parquet,16,2026-01-02T10:00:00+02:00")

    found = find_logs([folder], by="serial")

    assert [(log.rig, log.dated) for log in found] == [("16", "manifest"), ("17", "manifest")]
    assert found[0].date == datetime(2026, 1, 2, 8, 0, tzinfo=UTC)
    assert [log.path for log in find_logs([folder / "fleet.csv"], by="serial")] == [log.path for log in found]
    assert len(find_logs([folder], by="folder")) == 3


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["file,serial", "b/20260302.csv,1"], "has no column 'rig'; "),
        (["name,rig", "b/20260302.csv,1"], "has no column 'file'; "),
        (["file,rig", "b/nix.csv,1"], "lists 1 files that do not exist, such as b/nix.csv; paths are relative to"),
        (["file,rig", "b/20260302.csv,"], "row 2 has no rig; give one"),
        (["file,rig,date", "b/20260302.csv,1,March"], "row 2 has the date 'March'; expected ISO 8601"),
        (["file,rig"], "lists no log"),
        (["file,rig", "b/20260302.csv,1", "b/../b/20260302.csv,2"], "is given twice; give it once"),
    ],
)
def test_a_wrong_manifest_is_a_sentence(folder, lines, said):
    manifest(folder, *lines)

    with pytest.raises(InputError, match=r"fleet\.csv|csv: is given twice") as caught:
        find_logs([folder])
    assert said in str(caught.value)


def test_wrong_paths_are_sentences(folder, tmp_path):
    with pytest.raises(InputError, match="nix: no such file or folder"):
        find_logs([folder / "nix"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: contains no logs; expected files such as"):
        find_logs([tmp_path / "empty"])
    with pytest.raises(InputError, match=r"--by serial: .*fleet.csv does not exist; write it with the columns"):
        find_logs([folder], by="serial")
    with pytest.raises(InputError, match="no log given"):
        find_logs([])


def test_the_files_of_a_store_are_no_logs(folder):
    """A store among the logs, whose tables have the suffixes of logs; a log of its own folder of logs counts."""
    before = [log.path for log in find_logs([folder])]
    for name in ("store/scores/ab/key.parquet", "store/tables/rigs.parquet", "store/rigs.csv", "store/logs/c/1.csv"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("t\n")
    with_files = [log.path.name for log in find_logs([folder])]
    (folder / "store" / "fleet-store.json").write_text("{}")

    assert {"key.parquet", "rigs.parquet", "rigs.csv", "1.csv"} <= set(with_files)
    assert {log.path for log in find_logs([folder])} == {*before, folder / "store/logs/c/1.csv"}


def test_the_usual_column_may_be_named(folder):
    """Without a manifest, the folders name the rigs; a column of another name takes a manifest."""
    assert find_logs([folder], by="rig") == find_logs([folder])
    with pytest.raises(InputError, match="does not exist"):
        find_logs([folder], by="serial")
