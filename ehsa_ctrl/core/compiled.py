"""From the text of a module to compiled functions, whose machine code is kept on disk between starts.

numba's own cache knows a function by the one file that it stands in, so that an edit of a function in another file
would go unnoticed, and it runs whatever it finds. Here a file is named by the hash of the whole text that is compiled
and of the versions that compile it, and it begins with the digest of what follows. It is written aside and moved into
place. One that is cut, garbled or not ours is deleted and compiled again; the text itself is never read from the disk.
The digest finds damage. Against others there is the folder: nobody else may write to it.
"""

from __future__ import annotations

import hashlib
import linecache
import logging
import os
import pickle
import stat
import sys
import tempfile
import uuid
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

log = logging.getLogger(__name__)

Function = TypeVar("Function", bound=Callable[..., Any])

#: Bytes of the digest at the beginning of a file.
DIGEST = hashlib.sha256().digest_size
#: A process that waits longer for another one to compile does it itself [s].
PATIENCE = 600.0


def cache_folder() -> Path | None:
    """Where machine code is kept: EHSA_CTRL_CACHE, else the user's cache folder; where that can't be used a private
    one among the temporary files; None where that can't be used either.

    A folder is used if it belongs to the user, is no link, and nobody else may write to it. One that is not there is
    made, for the user alone. The log says once why a folder is not used.
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


@cache
def load_compiled(text: str, title: str) -> ModuleType:
    """The module with this text, whose functions carry `cached_njit`. `title` is for the log alone.

    The first call ever for a text compiles what has a signature; later starts load the result.
    """
    from filelock import FileLock

    key = _key(text)
    name = f"ehsa_ctrl_compiled_{key}"
    file = f"<{name}>"
    # Where tracebacks, numba and `cached_njit` look for the source of a function.
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    folder = cache_folder()
    with ExitStack() as stack:
        if folder is not None:
            # Several processes may start cold at once (parallel tests, workers): one compiles, the others wait and
            # load. Without the lock each would compile, which is slow and no harm.
            with suppress(OSError, NotImplementedError):
                stack.enter_context(FileLock(folder / f"{key}.lock", timeout=PATIENCE))
        if folder is None or not any(folder.glob(f"{key}-*.code")):
            log.info("compiling %s: once, 10 s to a minute, longer on a busy machine", title)
        module = ModuleType(name)
        # numba looks the module up by its name while it compiles; unregistered, it would compile everything twice.
        sys.modules[name] = module
        try:
            exec(compile(text, file, "exec"), vars(module))
        except BaseException:
            del sys.modules[name]
            raise
    return module


def cached_njit(*signature: Any, **options: Any) -> Callable[[Function], Function]:
    """numba.njit with these options, whose machine code is kept on disk.

    signature: at most one; it is compiled, or loaded, at once. Without it each combination of types is at its first
    call. The function must depend on nothing but its module's text.
    """
    import numba

    def decorate(function: Function) -> Function:
        dispatcher: Any = numba.njit(**options)(function)
        if dispatcher is function:  # by NUMBA_DISABLE_JIT
            return function
        dispatcher._cache = _Kept(function)
        for each in signature:
            dispatcher.compile(each)
            dispatcher.disable_compile()
        return dispatcher

    return decorate


class _Kept:
    """The machine code of one function on disk, in the shape in which numba's dispatcher asks for a cache."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        code = function.__code__
        text = "".join(linecache.getlines(code.co_filename, function.__globals__))
        self.stem = f"{_key(text)}-{function.__name__}-{code.co_firstlineno}" if text else ""

    def _place(self, signature: Any, target: Any) -> tuple[Path | None, Any]:
        """File of a signature on this processor, and what its content must say of itself."""
        key = self.stem, signature, target.codegen().magic_tuple()
        folder = cache_folder() if self.stem else None
        digits = hashlib.sha256(repr(key).encode()).hexdigest()[:12]
        return (None if folder is None else folder / f"{self.stem}-{digits}.code"), key

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function, None where it is to be compiled."""
        from numba.core.compiler import CompileResult

        target.refresh()
        file, key = self._place(signature, target)
        if file is None or not file.exists():
            return None
        try:
            content = file.read_bytes()
            if hashlib.sha256(content[DIGEST:]).digest() != content[:DIGEST]:
                raise ValueError("damaged")
            known, parts = pickle.loads(content[DIGEST:])
            if known != key:
                raise ValueError("another function")
            return CompileResult._rebuild(target, *parts)
        except Exception as error:
            # Whatever is wrong with it, compiling again mends it.
            log.warning("%s: can't be loaded (%s); compiling again", file, error)
            with suppress(OSError):
                file.unlink()
            return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep a compiled function; where that is not possible the log says so once, and the program goes on."""
        from numba.core.serialize import dumps

        file, key = self._place(signature, compiled.target_context)
        if file is None or compiled.library.has_dynamic_globals:
            return
        content = dumps((key, compiled._reduce()))
        draft = file.with_suffix(f".{uuid.uuid4().hex}.draft")
        try:
            draft.write_bytes(hashlib.sha256(content).digest() + content)
            draft.replace(file)
        except OSError as error:
            why = f"compiled code can't be kept there ({error.strerror}); each start compiles again"
            _warn_once(f"{file.parent}: {why}")
        finally:
            with suppress(OSError):
                draft.unlink(missing_ok=True)

    def flush(self) -> None:
        """Part of numba's shape of a cache; files are named by what they hold, so that none is out of date."""
