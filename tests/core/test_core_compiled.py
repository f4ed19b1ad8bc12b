"""Machine code on disk: private, checked against its digest, compiled again whatever is wrong with it."""

import ctypes
import errno
import gc
import hashlib
import logging
import os
import pickle
import stat
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from math import tanh
from pathlib import Path

import pytest

from ehsa_ctrl.core import compiled
from ehsa_ctrl.core.compiled import DIGEST, cache_folder, load_compiled, load_functions

TEXT = """\
from numba import float64

from ehsa_ctrl.core.compiled import cached_njit

@cached_njit(float64(float64))
def twice(x):
    return 2.0 * x
"""
ASSEMBLY = """\
declare double @tanh(double)

define internal double @half(double %x) nounwind {
  %y = fmul double 0.5, %x
  ret double %y
}

define double @saturated(double %x) nounwind {
  %y = call double @half(double %x)
  %z = call double @tanh(double %y)
  ret double %z
}
"""
needs_owners = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owner here")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The cache, in a folder that is not there yet; temporary files have one beside it."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path / "cache"))
    compiled._warn_once.cache_clear()
    return tmp_path / "cache"


def start(text=TEXT):
    """What a new process would do: the module's answer to 21, and how many functions it compiled."""
    load_compiled.cache_clear()
    module = load_compiled(text, "a doubling")
    return module.twice(21.0), sum(module.twice.stats.cache_misses.values())


def kept(folder):
    (file,) = folder.glob("*.code")
    return file


def test_a_second_start_loads_and_another_text_compiles(folder):
    """The text decides, down to a comment."""
    assert start() == (42.0, 1)
    assert start() == (42.0, 0)
    assert start(TEXT + "# edited") == (42.0, 1)
    assert start(TEXT.replace("2.0", "3.0")) == (63.0, 1)


def saturated(monkeypatch, x, *, store):
    """What a new process would do: the function of the assembly at x, called by its address."""
    monkeypatch.setattr(compiled, "_engines", {})
    address = load_functions(ASSEMBLY, store=store)["saturated"]
    return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(address)(x)


@pytest.mark.parametrize("store", [True, False])
def test_functions_of_assembly_are_stored_if_asked(folder, monkeypatch, store):
    """Stored ones load without the compiler, others leave no file; both call the mathematical library."""
    assert saturated(monkeypatch, 0.6, store=store) == tanh(0.3)
    assert len([*folder.glob("*.code")]) == store
    compile_again = compiled._machine_code
    calls = []
    monkeypatch.setattr(compiled, "_machine_code", lambda *given: calls.append(given) or compile_again(*given))

    assert saturated(monkeypatch, 0.8, store=store) == tanh(0.4)
    assert len(calls) == (not store)


def test_damaged_assembly_is_compiled_again(folder, monkeypatch, caplog):
    """Like the functions of a module."""
    saturated(monkeypatch, 0.6, store=True)
    file = kept(folder)
    whole = file.read_bytes()
    file.write_bytes(whole[:-1])

    assert saturated(monkeypatch, 0.6, store=True) == tanh(0.3)
    assert file.read_bytes() == whole
    assert "compiling again" in caplog.text


def test_an_interrupt_while_code_is_loaded_does_no_harm(folder, monkeypatch):
    """The engine that was begun is deleted with what it owns; the next call begins anew."""
    import llvmlite.binding as llvm

    def interrupted(code):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(llvm.ObjectFileRef, "from_data", interrupted)
        with pytest.raises(KeyboardInterrupt):
            saturated(monkeypatch, 0.6, store=False)
    gc.collect()

    assert saturated(monkeypatch, 0.6, store=False) == tanh(0.3)


def test_threads_that_start_together_compile_once(folder, monkeypatch):
    """Also where nothing is stored."""
    monkeypatch.setattr(compiled, "_engines", {})
    compile_it, calls = compiled._machine_code, []
    monkeypatch.setattr(compiled, "_machine_code", lambda *given: calls.append(given) or compile_it(*given))

    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(lambda _: load_functions(ASSEMBLY, store=False)["saturated"], range(8)))

    assert len(set(found)) == len(calls) == 1


@needs_owners
def test_the_cache_is_private(folder):
    """Nobody else may look into its folder."""
    start()

    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def cut(share):
    return lambda content: content[: int(share * len(content))]


def garbled(at):
    return lambda content: content[:at] + bytes([content[at] ^ 0x55]) + content[at + 1 :]


def other(value):
    """What is whole and not a compiled function."""
    content = value if isinstance(value, bytes) else pickle.dumps(value)
    return lambda _: hashlib.sha256(content).digest() + content


@pytest.mark.parametrize(
    "damage",
    [
        *(cut(share) for share in (0.0, 0.0005, 0.01, 0.5, 0.99)), lambda content: content[:-1],
        lambda content: content[:DIGEST], lambda content: content + b"more",
        *(garbled(at) for at in (0, DIGEST - 1, DIGEST, 1000, -2)),
        other(b""), other(b"no pickle"), other(None), other((1, 2)),
    ],
)  # fmt: skip
def test_a_damaged_file_is_compiled_again(folder, caplog, damage):
    """It is never run; the log says it in one line, and the next start loads again."""
    start()
    file = kept(folder)
    file.write_bytes(damage(file.read_bytes()))
    with caplog.at_level(logging.WARNING):
        after = start()

    assert after == (42.0, 1)
    assert [str(file) in record.message for record in caplog.records] == [True]
    assert start() == (42.0, 0)


def test_the_function_of_another_text_is_not_taken(folder):
    """A file under another's name says what it is."""
    start(TEXT.replace("2.0", "3.0"))
    foreign = kept(folder).read_bytes()
    kept(folder).unlink()
    start()
    kept(folder).write_bytes(foreign)

    assert start() == (42.0, 1)
    assert start() == (42.0, 0)


def test_a_folder_in_the_place_of_a_file_is_no_obstacle(folder):
    """Where a file can't be read, replaced or locked, the function is compiled."""
    start()
    for file in list(folder.iterdir()):
        file.unlink()
        file.mkdir()

    assert start() == start() == (42.0, 1)


def no_folder(folder, _):
    folder.write_text("")


def below_a_file(folder, monkeypatch):
    folder.write_text("")
    monkeypatch.setenv("EHSA_CTRL_CACHE", str(folder / "below"))


def linked(folder, _):
    target = folder.with_name("target")
    target.mkdir(mode=0o700)
    folder.symlink_to(target)


def dangling(folder, _):
    folder.symlink_to(folder.with_name("nowhere"))


def open_to_others(folder, _):
    folder.mkdir()
    folder.chmod(0o770)


def of_somebody_else(folder, monkeypatch):
    # Root may write to every folder: the test simulates the owner, not the permission.
    folder.mkdir(mode=0o700)
    lstat = type(folder).lstat

    def owned(path):
        found = list(lstat(path))
        found[stat.ST_UID] += path == folder
        return os.stat_result(found)

    monkeypatch.setattr(type(folder), "lstat", owned)


def read_only(folder, monkeypatch):
    folder.mkdir(mode=0o700)
    whole = tempfile.TemporaryFile

    def refused(dir):
        if dir == folder:
            raise OSError(errno.EROFS, "Read-only file system")
        return whole(dir=dir)

    monkeypatch.setattr(tempfile, "TemporaryFile", refused)


BAD = [no_folder, below_a_file, linked, dangling, open_to_others, of_somebody_else, read_only]


@needs_owners
@pytest.mark.parametrize("make", BAD)
def test_a_folder_that_can_not_be_trusted_is_not_used(folder, monkeypatch, caplog, make):
    """A private one among the temporary files takes its place, which the log says once."""
    make(folder, monkeypatch)
    first, second = start(), start()
    spare = cache_folder()

    assert (first, second) == ((42.0, 1), (42.0, 0))
    assert spare.parent == folder.with_name("temporary") and stat.S_IMODE(spare.stat().st_mode) == 0o700
    assert not folder.is_dir() or list(folder.iterdir()) == []
    assert sum(str(folder) in record.message for record in caplog.records) == 1
    assert f"kept in {spare}" in caplog.text


@needs_owners
@pytest.mark.parametrize("make", [make for make in BAD if make is not below_a_file])
def test_without_any_folder_nothing_is_kept(folder, monkeypatch, caplog, make):
    """Somebody was quicker to make the temporary folder: everything works, each start compiles."""
    no_folder(folder, monkeypatch)
    make(folder.with_name("temporary") / f"ehsa_ctrl-{os.geteuid()}", monkeypatch)

    assert cache_folder() is None
    assert start() == start() == (42.0, 1)
    assert caplog.text.count("each start compiles again") == 1


@pytest.mark.parametrize("step", ["write_bytes", "replace"])
def test_a_full_disk_is_no_obstacle(folder, monkeypatch, caplog, step):
    """The log says once that nothing is kept, and no half file stays."""

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, step, full)

    assert start() == start() == (42.0, 1)
    assert caplog.text.count("No space left on device") == 1
    assert list(folder.glob("*.code")) == list(folder.glob("*.draft")) == []


def test_an_interrupt_while_writing_leaves_nothing(folder, monkeypatch):
    """The next start compiles and keeps."""

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            start()

    assert list(folder.glob("*.code")) == list(folder.glob("*.draft")) == []
    assert (start(), start()) == ((42.0, 1), (42.0, 0))


def test_a_function_of_the_package_is_known_by_the_text_of_its_file(tmp_path):
    """An edit anywhere in the file counts, the date of the file does not."""
    stems = []
    for text in ("SIZE = 1\ndef f(x):\n    return SIZE * x\n", "SIZE = 2\ndef f(x):\n    return SIZE * x\n"):
        file = tmp_path / f"{len(stems)}.py"
        file.write_text(text)
        names = {}
        exec(compile(text, str(file), "exec"), names)
        stems.append(compiled._Cache(names["f"]).stem)

    assert all(stem.endswith("-f-2") for stem in stems) and stems[0] != stems[1]


PROGRAM = f"""
import os, pathlib, sys
from ehsa_ctrl.core.compiled import load_compiled
if sys.argv[1:] == ["die"]:
    pathlib.Path.replace = lambda *_: os._exit(9)
twice = load_compiled({TEXT!r}, "a doubling").twice
print(twice(21.0), sum(twice.stats.cache_misses.values()))
"""


def process(*arguments):
    return subprocess.Popen([sys.executable, "-c", PROGRAM, *arguments], stdout=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_a_process_that_is_killed_while_it_compiles_does_no_harm(folder):
    """Its lock goes with it, and what it had written is not taken for a function."""
    killed = process("die")
    killed.communicate()
    after = process().communicate()[0]

    assert killed.returncode == 9
    assert after == "42.0 1\n"
    assert process().communicate()[0] == "42.0 0\n"


@pytest.mark.slow
def test_of_processes_that_start_together_one_compiles(folder):
    """The others wait for it and load."""
    started = [process() for _ in range(3)]

    assert sorted(each.communicate()[0] for each in started) == ["42.0 0\n", "42.0 0\n", "42.0 1\n"]


def test_compiling_is_said_once(folder, caplog):
    """A module that uses a function of another module: the next process loads it and says nothing."""
    text = TEXT.replace("def twice", "def twice_moved").replace("2.0 * x", "2.0 * x if move is not None else x")
    text = text.replace("import cached_njit\n", "import cached_njit\nfrom ehsa_ctrl.core.pointers import move\n")
    said = []
    with caplog.at_level(logging.INFO, logger=compiled.__name__):
        for _ in range(2):
            caplog.clear()
            load_compiled.cache_clear()
            assert load_compiled(text, "a doubling").twice_moved(3.0) == 6.0
            said.append([record.getMessage() for record in caplog.records])

    assert said == [["compiling a doubling: once, some seconds, longer on a busy machine"], []]
