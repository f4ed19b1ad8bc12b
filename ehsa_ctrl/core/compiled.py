"""Compiled functions with a cache of their machine code on disk.

numba's own cache identifies a function by its one source file, so that an edit of a function in another file goes
unnoticed, and it runs any file that it finds. Here the hash of all source that is compiled, with the versions of the
compilers, names a file, and the file begins with the SHA-256 of its content. Files are written aside and moved into
place. A damaged file is deleted and compiled again. The digest detects damage; the permissions of the folder protect
against other users.
"""

from __future__ import annotations

import hashlib
import linecache
import logging
import os
import pickle
import re
import stat
import sys
import tempfile
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

log = logging.getLogger(__name__)

#: Names of modules made from text.
PREFIX = "ehsa_ctrl_compiled_"
#: Bytes of the digest at the beginning of a file.
DIGEST = hashlib.sha256().digest_size
#: Longest wait for another process that compiles [s].
LOCK_TIMEOUT = 600.0


def cache_folder() -> Path | None:
    """Folder of the cache: EHSA_CTRL_CACHE, else the user's cache folder, else a private temporary folder, else None.

    A folder must belong to the user, must not be a link and must not be writable by others. A missing one is created
    with private access. A warning gives the reason once where a folder is not used.
    """
    import platformdirs

    wanted = Path(os.environ.get("EHSA_CTRL_CACHE") or platformdirs.user_cache_dir("ehsa_ctrl"))
    why = _refusal(wanted)
    if not why:
        return wanted
    spare = Path(tempfile.gettempdir()) / f"ehsa_ctrl-{os.geteuid() if hasattr(os, 'geteuid') else 'user'}"
    why_not_spare = _refusal(spare)
    if not why_not_spare:
        _warn_once(f"{wanted}: {why}; compiled code is kept in {spare}")
        return spare
    _warn_once(f"{wanted}: {why}; {spare}: {why_not_spare}; compiled code is not kept, each start compiles again")
    return None


def _refusal(folder: Path) -> str:
    """Why compiled code can't be kept in a folder; empty where it can."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode):
            return "is a link; give the folder itself"
        if hasattr(os, "geteuid"):
            if found.st_uid != os.geteuid():
                return "belongs to another user, who could change what is run"
            if found.st_mode & 0o022:
                return f"others may write to it, so could change what is run; chmod go-w '{folder}'"
        # Permissions say too little: of a read-only disk, of a file system that takes no files, to root nothing at all.
        tempfile.TemporaryFile(dir=folder).close()
    except FileExistsError:
        return "is no folder"
    except OSError as error:
        return f"can't be used ({error.strerror})"
    return ""


@cache
def _warn_once(sentence: str) -> None:
    log.warning(sentence)


def _key(text: str) -> str:
    import numba
    import numpy as np

    versions = f"{numba.__version__} {np.__version__} {sys.version} {sys.platform}"
    return hashlib.sha256(f"{versions}\n{text}".encode()).hexdigest()[:20]


@contextmanager
def compile_once(key: str, title: str) -> Iterator[None]:
    """Lock under which one of several processes compiles while the others wait, then load; logs the start.

    Without the lock each process would compile, which is slow but correct.
    """
    from filelock import FileLock

    folder = cache_folder()
    with ExitStack() as stack:
        if folder is not None:
            with suppress(OSError, NotImplementedError):
                stack.enter_context(FileLock(folder / f"{key}.lock", timeout=LOCK_TIMEOUT))
        if folder is None or not any(folder.glob(f"{key}-*.code")):
            log.info("compiling %s: once, some seconds, longer on a busy machine", title)
        yield


@cache
def load_compiled(text: str, title: str) -> ModuleType:
    """The module with this text, whose functions carry `cached_njit`. `title` is for the log alone.

    The first call ever for a text compiles what has a signature; later starts load the result.
    """
    key = _key(text)
    name = f"{PREFIX}{key}"
    file = f"<{name}>"
    # Where tracebacks, numba and `cached_njit` look for the source of a function.
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    with compile_once(key, title):
        module = ModuleType(name)
        # numba looks the module up by its name while it compiles; unregistered, it would compile everything twice.
        sys.modules[name] = module
        try:
            exec(compile(text, file, "exec"), vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return module


@cache
def load_functions(text: str) -> Mapping[str, int]:
    """Compile a text for LLVM; returns the address of each function that it defines, internal ones apart.

    The first call ever for a text compiles, which takes some tenths of a second; later starts load the result. The
    names get the hash of the text, since names are shared by all that numba compiles in a process.
    """
    from llvmlite.binding import parse_assembly
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    key = _key(text)
    names = re.findall(r"^define double @(\w+)\(", text, re.MULTILINE)
    codegen = cpu_target.target_context.codegen()
    place = _CacheFile(f"{key}-llvm", codegen)
    with global_compiler_lock:
        library = place.load(codegen.unserialize_library)
        if library is None:
            library = codegen.create_library(f"ehsa_ctrl_{key}")
            library.enable_object_caching()
            unique = re.sub(rf"@({'|'.join(names)})\(", rf"@\1_{key}(", text)
            library.add_llvm_module(parse_assembly(unique))
            library.finalize()
            place.save(library.serialize_using_object_code())
        _loaded.append(library)
        return {name: library.get_pointer_to_function(f"{name}_{key}") for name in names}


#: Libraries whose functions are called by address; they live as long as the process.
_loaded: list[Any] = []


def cached_njit(*signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """numba.njit with these options and the cache of this module.

    signature: at most one; it is compiled, or loaded, at once. Without it each combination of types is at its first
    call. The function must depend on nothing but its module's text and other functions of this kind.
    """
    import numba

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = numba.njit(**options)(function)
        if dispatcher is function:  # by NUMBA_DISABLE_JIT
            return function
        dispatcher._cache = _Cache(function)
        # What `load_compiled` compiles has its lock and its message already.
        own_lock = not function.__module__.startswith(PREFIX)
        for each in signature:
            with compile_once(dispatcher._cache.stem, f"the {function.__name__}") if own_lock else nullcontext():
                dispatcher.compile(each)
            dispatcher.disable_compile()
        return dispatcher

    return decorate


class _Cache:
    """Cache of one function with the interface that numba's dispatcher expects."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        text = "".join(_sources(function).values())
        self.stem = f"{_key(text)}-{function.__name__}-{function.__code__.co_firstlineno}" if text else ""

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function, None where it is to be compiled."""
        from numba.core.compiler import CompileResult

        target.refresh()
        place = _CacheFile(self.stem, target.codegen(), signature)
        return place.load(lambda parts: CompileResult._rebuild(target, *parts))

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Store a compiled function; a failure is logged once and has no other consequence."""
        if not compiled.library.has_dynamic_globals:
            _CacheFile(self.stem, compiled.target_context.codegen(), signature).save(compiled._reduce())

    def flush(self) -> None:
        """Required by numba; file names contain the hash of the source, so no file is ever out of date."""


def _sources(function: Callable[..., Any], found: dict[str, str] | None = None) -> dict[str, str]:
    """Texts of the function's file and of those whose compiled functions this file uses, by path."""
    found = {} if found is None else found
    file = function.__code__.co_filename
    if file not in found:
        found[file] = "".join(linecache.getlines(file, function.__globals__))
        for value in list(function.__globals__.values()):
            inner: Any = getattr(value, "py_func", None) or getattr(value, "_defn", None)
            if hasattr(inner, "__code__"):
                _sources(inner, found)
    return found


class _CacheFile:
    """File of the machine code of one function signature, or one text, for this processor."""

    def __init__(self, stem: str, codegen: Any, signature: Any = None) -> None:
        self.key = stem, signature, codegen.magic_tuple()
        folder = cache_folder() if stem else None
        digits = hashlib.sha256(repr(self.key).encode()).hexdigest()[:12]
        self.file = None if folder is None else folder / f"{stem}-{digits}.code"

    def load(self, rebuild: Callable[[Any], Any]) -> Any:
        """Content after `rebuild`; None without a file or with a damaged one."""
        if self.file is None or not self.file.exists():
            return None
        try:
            content = self.file.read_bytes()
            if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
                raise ValueError("damaged")
            known, parts = pickle.loads(content[DIGEST:])
            if known != self.key:
                raise ValueError("another function")
            return rebuild(parts)
        except Exception as error:
            # Any defect of a file is repaired by compiling again.
            log.warning("%s: can't be loaded (%s); compiling again", self.file, error)
            with suppress(OSError):
                self.file.unlink()
            return None

    def save(self, parts: Any) -> None:
        """Write the file as a whole or not at all."""
        from numba.core.serialize import dumps

        if self.file is None:
            return
        content = dumps((self.key, parts))
        draft = self.file.with_suffix(f".{uuid.uuid4().hex}.draft")
        try:
            draft.write_bytes(hashlib.sha256(content).digest() + content)
            draft.replace(self.file)
        except OSError as error:
            why = f"compiled code can't be kept there ({error.strerror}); each start compiles again"
            _warn_once(f"{self.file.parent}: {why}")
        finally:
            with suppress(OSError):
                draft.unlink(missing_ok=True)
