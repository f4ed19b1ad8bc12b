"""Results are written completely or not at all, and never over a user's files."""

import errno
import hashlib
import json
import os
from pathlib import Path

import pytest

from ehsa_ctrl.core.checkpoint import open_checkpoint
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.files import atomic_write, refuse_existing, write_text
from ehsa_ctrl.core.result_folder import ResultFolder

FULL = OSError(errno.ENOSPC, "No space left on device")


def write(folder, files, owner="bench", **options):
    with ResultFolder(folder, owner, **options).draft() as draft:
        for name, text in files.items():
            write_text(draft / name, text)


def seen(folder):
    """Every visible file below a folder with its text, and every hidden name."""
    files = {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}
    return {name: text for name, text in files.items() if not name.startswith(".")}, {n for n in files if n[0] == "."}


def test_a_result_is_in_its_folder_with_a_list_of_its_files(tmp_path):
    """One hidden JSON of names and hashes beside the files; folders are made where they are missing."""
    write(tmp_path / "a/b", {"x.json": "1", "sub/y.c": "2"})

    assert seen(tmp_path / "a/b") == ({"x.json": "1", "sub/y.c": "2"}, {".ehsa_ctrl-bench.json"})
    assert json.loads((tmp_path / "a/b/.ehsa_ctrl-bench.json").read_text())["files"].keys() == {"x.json", "sub/y.c"}


def test_an_earlier_result_is_replaced_only_with_force(tmp_path):
    """With force, obsolete files and empty folders are removed; the user's files stay."""
    write(tmp_path, {"x": "1", "sub/y": "2"})
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(InputError, match=r"x: is part of an earlier result; choose another folder or use --force$"):
        ResultFolder(tmp_path, "bench").check("x")
    write(tmp_path, {"x": "new"}, force=True)

    assert seen(tmp_path)[0] == {"x": "new", "notes": "mine"}
    assert not (tmp_path / "sub").exists()


def test_files_that_the_new_result_lacks_can_stay(tmp_path):
    """Kept files still belong to the command and may be replaced later."""
    write(tmp_path, {"a": "1"})
    write(tmp_path, {"b": "2"}, force=True, keep=True)
    write(tmp_path, {"a": "3"}, force=True, keep=True)

    assert seen(tmp_path)[0] == {"a": "3", "b": "2"}


@pytest.mark.parametrize("force", [False, True])
def test_a_users_file_is_refused_by_name(tmp_path, force):
    """With or without force, and before the work if the name is known."""
    (tmp_path / "x").write_text("mine")
    with pytest.raises(InputError, match="x: is not listed as written by bench; move it away or choose another folder"):
        ResultFolder(tmp_path, "bench", force).check("x")

    assert seen(tmp_path) == ({"x": "mine"}, set())


def test_an_edited_file_is_the_users(tmp_path):
    """It is refused where it would be replaced, and stays where it would only be removed."""
    write(tmp_path, {"x": "1", "y": "2"})
    (tmp_path / "y").write_text("edited")
    with pytest.raises(InputError, match=r"y: was edited since bench wrote it; move it away"):
        ResultFolder(tmp_path, "bench", force=True).check("x", "y")
    write(tmp_path, {"x": "new"}, force=True)

    assert seen(tmp_path)[0] == {"x": "new", "y": "edited"}


def test_two_commands_do_not_replace_each_others_files(tmp_path):
    """Both may write to a folder as long as their names differ."""
    write(tmp_path, {"x": "1"}, owner="one")
    write(tmp_path, {"y": "2"}, owner="two")
    with pytest.raises(InputError, match="x: belongs to the result of one in this folder; choose another folder"):
        ResultFolder(tmp_path, "two", force=True).check("x")
    write(tmp_path, {"y": "3"}, owner="two", force=True)

    assert seen(tmp_path)[0] == {"x": "1", "y": "3"}


def test_a_result_that_is_refused_after_the_work_is_not_lost(tmp_path):
    """If an unexpected file is in the way, the new result goes to a separate folder, which the message names."""
    (tmp_path / "late").write_text("mine")
    for place in ("bench-new", "bench-new-2"):
        with pytest.raises(InputError, match=rf"late: is not listed .* \(the new result is kept in \S+{place}\)"):
            write(tmp_path, {"x": "1", "late": "2"})
        assert seen(tmp_path / place)[0] == {"x": "1", "late": "2"}
    assert (tmp_path / "late").read_text() == "mine" and not (tmp_path / "x").exists()


@pytest.mark.parametrize("stop", [FULL, KeyboardInterrupt(), RuntimeError()], ids=type)
@pytest.mark.parametrize("moved", range(8))
def test_a_result_that_breaks_off_leaves_the_old_one_whole(tmp_path, monkeypatch, stop, moved):
    """Wherever the swap is interrupted, the old files are unchanged and no draft is left."""
    write(tmp_path, {"x": "1", "y": "2", "z": "3"})
    before, replace, count = seen(tmp_path), Path.replace, 0

    def stopping(self, target):
        nonlocal count
        # Drafts of single files are replaced too.
        count += self.parent == tmp_path or Path(target).parent == tmp_path
        if count == moved + 1:
            count += 1
            raise stop
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", stopping)
    with pytest.raises((InputError, KeyboardInterrupt, RuntimeError)) as raised:
        write(tmp_path, {"x": "new", "y": "new", "w": "new"}, force=True)

    assert seen(tmp_path) == before
    if stop is FULL:
        words = f"{tmp_path}: can't be written (No space left on device); its earlier content is unchanged"
        assert str(raised.value) == words


def test_a_full_disk_while_writing_leaves_nothing_new(tmp_path, monkeypatch):
    """Neither folder nor draft; the sentence names the folder that was asked for, whoever wrote the file."""

    def full(*_, **__):
        raise FULL

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(InputError) as raised:
        write(tmp_path / "a/b", {"x": "1"})

    assert str(raised.value) == f"{tmp_path / 'a/b'}: can't be written (No space left on device)"
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_is_said_before_the_work(tmp_path):
    """A file in its place, or above it."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file: is a file; give a folder"):
        ResultFolder(tmp_path / "file", "bench").check("x")
    with pytest.raises(InputError, match=r"below: can't be created or written to: .*file is not a folder"):
        ResultFolder(tmp_path / "file" / "below", "bench").check("x")


@pytest.mark.parametrize("listed", ["../outside", "/etc/hostname"])
def test_a_manifest_does_not_reach_beyond_its_folder(tmp_path, listed):
    """Any content of a manifest is harmless; an invalid one lists no file."""
    outside = tmp_path / "outside"
    outside.write_text("mine")
    write(tmp_path / "in", {"x": "1"})
    manifest = tmp_path / "in" / ".ehsa_ctrl-bench.json"
    content = json.loads(manifest.read_text())
    content["files"][listed] = hashlib.sha256(b"mine").hexdigest()
    manifest.write_text(json.dumps(content))
    write(tmp_path / "in", {"x": "2"}, force=True)
    assert outside.read_text() == "mine" and (tmp_path / "in" / "x").read_text() == "2"

    manifest.write_text("no json")
    with pytest.raises(InputError, match="x: is not listed as written by bench"):
        ResultFolder(tmp_path / "in", "bench", force=True).check("x")


@pytest.mark.parametrize("stop", [FULL, KeyboardInterrupt()], ids=type)
def test_a_single_file_is_replaced_whole_or_not_at_all(tmp_path, stop):
    """Existing files stay; a folder created for the result is removed."""

    def broken(path):
        with atomic_write(path) as draft:
            draft.write_text("ne")
            raise stop

    (tmp_path / "x.toml").write_text("old")
    for path in (tmp_path / "x.toml", tmp_path / "new" / "x.toml"):
        with pytest.raises((InputError, KeyboardInterrupt)):
            broken(path)

    assert seen(tmp_path) == ({"x.toml": "old"}, set())
    assert not (tmp_path / "new").exists()


@pytest.mark.skipif(os.name != "posix", reason="links as Unix has them")
def test_a_link_stays_a_link(tmp_path):
    """The target of the link is replaced."""
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "there")
    write_text(tmp_path / "link", "new")

    assert (tmp_path / "link").is_symlink() and (tmp_path / "there").read_text() == "new"


def test_a_named_file_is_replaced_only_with_force(tmp_path):
    """A file named by the user is replaced even if edited; a folder never is."""
    (tmp_path / "x").write_text("")
    with pytest.raises(InputError, match="x: already exists; choose another name or use --force"):
        refuse_existing(tmp_path / "x", force=False)
    refuse_existing(tmp_path / "x", force=True)
    with pytest.raises(InputError, match="is a folder"):
        refuse_existing(tmp_path, force=True)


def kept(path, *, anew=False, mark=1):
    return open_checkpoint(path, "numbers", mark, int, anew=anew, none="is none", other="is another", wrong="is wrong")


def test_kept_results_are_replaced_when_there_is_a_new_one(tmp_path):
    """anew keeps the old results until the first new one, and never replaces another kind of file."""
    file = tmp_path / "kept"
    kept(file).append(["1", "2"])
    new = kept(file, anew=True, mark=2)
    assert new.results == [] and kept(file).results == [1, 2]
    new.append([])
    assert kept(file).results == [1, 2]
    new.append(["3"])
    new.append(["4"])
    assert kept(file, mark=2).results == [3, 4]

    (tmp_path / "mine").write_text("mine")
    with pytest.raises(InputError, match="mine: is none"):
        kept(tmp_path / "mine", anew=True)


def test_a_full_disk_loses_no_kept_result(tmp_path, monkeypatch):
    """A truncated line is removed when the file is continued, atomically."""
    file = tmp_path / "kept"
    kept(file).append(["1", "2"])
    with file.open("a") as end:
        end.write('"cut')
    before = file.read_text()

    def full(*_, **__):
        raise FULL

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", full)
        with pytest.raises(InputError, match="can't be written"):
            kept(file)
    assert file.read_text() == before
    again = kept(file)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", full)
        with pytest.raises(InputError, match="finished results are kept"):
            again.append(["3"])
    assert kept(file).results == [1, 2]
