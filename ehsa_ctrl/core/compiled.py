"""Compile functions and cache their machine code on disk.

numba's own cache identifies a function by its own source file only, so it misses edits of functions in other files,
and it runs any file that it finds. Here the name of a cache file contains the hash of all compiled source and of the
compilers' versions, and the file begins with the SHA-256 of its content. Files are written under another name and then
renamed. A damaged file is deleted and compiled again. The digest detects damage; the permissions of the folder protect
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
from typing import Any, cast

log = logging.getLogger(__name__)

#: Prefix of the names of modules made from generated source.
PREFIX = "ehsa_ctrl_compiled_"
#: Bytes of the digest at the beginning of a file.
DIGEST = hashlib.sha256().digest_size
#: Longest wait for another process that compiles [s]. Engineering judgement: ten times what a busy machine takes.
LOCK_TIMEOUT = 600.0


def cache_folder() -> Path | None:
    """Folder of the cache: EHSA_CTRL_CACHE or else the user's cache folder, then a private temporary folder, then None.

    A folder must belong to the user, must not be a link and must not be writable by others. A missing one is created
    with private access. If a folder can't be used, a warning gives the reason once.
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
    """Reason why a folder can't hold compiled code; empty if it can."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode):
            return "is a link; give the folder itself"
        if hasattr(os, "geteuid"):
            if found.st_uid != os.geteuid():
                return "belongs to another user, who could change what is run"
            if found.st_mode & 0o022:
                return f"is writable by other users, who could change what is run; chmod go-w '{folder}'"
        # Permissions alone do not tell: the disk may be read-only or full, and to root they mean nothing.
        tempfile.TemporaryFile(dir=folder).close()
    except FileExistsError:
        return "is not a folder"
    except OSError as error:
        return f"can't be used ({error.strerror})"
    return ""


@cache
def _warn_once(sentence: str) -> None:
    log.warning(sentence)


def _key(text: str) -> str:
    import llvmlite
    import numba
    import numpy as np

    versions = f"{numba.__version__} {llvmlite.__version__} {np.__version__} {sys.version} {sys.platform}"
    return hashlib.sha256(f"{versions}\n{text}".encode()).hexdigest()[:20]


@contextmanager
def compile_once(key: str, title: str) -> Iterator[None]:
    """Lock that lets one of several processes compile while the others wait and then load; logs the start.

    Without the lock each process would compile, which is slow but correct.
    """
    from filelock import FileLock

    folder = cache_folder()
    with ExitStack() as stack:
        if folder is not None:
            with suppress(OSError, NotImplementedError):
                stack.enter_context(FileLock(folder / f"{key}.lock", timeout=LOCK_TIMEOUT))
        if folder is None or not ((folder / f"{key}.module").exists() or any(folder.glob(f"{key}-*.code"))):
            log.info("compiling %s: once, some seconds, longer on a busy machine", title)
        yield


@cache
def load_compiled(text: str, title: str) -> ModuleType:
    """The module with this source, whose functions carry `cached_njit`. title: for the logged message.

    The first call for a source compiles the functions that have a signature; later processes load the result.
    """
    key = _key(text)
    name = f"{PREFIX}{key}"
    file = f"<{name}>"
    # Tracebacks, numba and `cached_njit` look here for the source of a function.
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    with compile_once(key, title):
        module = ModuleType(name)
        # While compiling, numba looks up the module by its name; without this entry it would compile everything twice.
        sys.modules[name] = module
        try:
            exec(compile(text, file, "exec"), vars(module))
        except BaseException:
            del sys.modules[name]
            raise
        folder = cache_folder()
        if folder is not None:
            # The names of its functions' files depend on source of other modules too, which `compile_once` does not
            # know: this file tells the next process that nothing is to be compiled.
            with suppress(OSError):
                (folder / f"{key}.module").touch(mode=0o600)
    return module


def load_functions(text: str, *, store: bool = True) -> Mapping[str, int]:
    """Compile LLVM assembly; returns the address of each function that it defines, except internal ones.

    The first call for a text compiles, which takes some tenths of a second; if it is stored, later processes load
    the result.
    """
    import llvmlite.binding as llvm
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    # numba works with the same context of LLVM, which is not safe for threads.
    with global_compiler_lock:
        if text in _engines:
            return _engines[text][0]
        codegen = cpu_target.target_context.codegen()
        compiler = "".join(linecache.getlines(__file__))
        place = _CacheFile(f"{_key(text + compiler)}-object" if store else "", codegen)
        # Not kept for the next text: the engine owns its target machine, and deletes it.
        target = _target_machine(*codegen.magic_tuple())
        code = place.load(bytes)
        if code is None:
            code = _machine_code(text, target)
            place.save(code)
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target)
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        names = re.findall(r"^define double @(\w+)\(", text, re.MULTILINE)
        _engines[text] = {name: engine.get_function_address(name) for name in names}, engine
        return _engines[text][0]


#: Text -> addresses of its functions, and the engine that has their code, as long as the process lives.
_engines: dict[str, tuple[Mapping[str, int], Any]] = {}


def _machine_code(text: str, target: Any) -> bytes:
    """Object file of LLVM assembly.

    Of LLVM's optimisations only the inlining that the text asks for is done. The text computes hardly anything twice:
    the others took a third of the time, and runs of the shipped plants are as fast without them, and the same to the
    bit.
    """
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(text)
    builder = llvm.create_pass_builder(target, llvm.create_pipeline_tuning_options(speed_level=0))
    builder.getModulePassManager().run(module, builder)
    return cast(bytes, target.emit_object(module))


def _target_machine(triple: str, cpu: str, features: str) -> Any:
    """Target machine for the processor that numba compiles for; NUMBA_CPU_NAME may set another one than this.

    Level 1 of its code generator is as good as 3 for this code. Level 0 makes runs half as long again.
    """
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    target = llvm.Target.from_triple(triple)
    reloc = "static" if target.name.startswith("x86") else "default"
    return target.create_target_machine(
        cpu=cpu, features=features, opt=1, reloc=reloc, codemodel="jitdefault", jit=True
    )


def cached_njit(*signature: Any, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator: numba.njit with these options and the cache of this module.

    signature: at most one; the function is compiled or loaded for it at once. Without it, this happens at the first
    call with each combination of types. The function may depend only on its module's source and on other functions
    with this decorator.
    """
    import numba

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = numba.njit(**options)(function)
        if dispatcher is function:  # by NUMBA_DISABLE_JIT
            return function
        dispatcher._cache = _Cache(function)
        # `load_compiled` already holds the lock and has logged a message.
        own_lock = not function.__module__.startswith(PREFIX)
        for each in signature:
            with compile_once(dispatcher._cache.stem, f"the {function.__name__}") if own_lock else nullcontext():
                dispatcher.compile(each)
            dispatcher.disable_compile()
        return dispatcher

    return decorate


class _Cache:
    """Cache of one function, with the interface that numba's dispatcher expects."""

    cache_path = None

    def __init__(self, function: Callable[..., Any]) -> None:
        text = "".join(_sources(function).values())
        self.stem = f"{_key(text)}-{function.__name__}-{function.__code__.co_firstlineno}" if text else ""

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled function; None if it is not in the cache."""
        from numba.core.compiler import CompileResult

        target.refresh()
        place = _CacheFile(self.stem, target.codegen(), signature)
        return place.load(lambda parts: CompileResult._rebuild(target, *parts))

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Store a compiled function; a failure is only logged, once."""
        if not compiled.library.has_dynamic_globals:
            _CacheFile(self.stem, compiled.target_context.codegen(), signature).save(compiled._reduce())

    def flush(self) -> None:
        """Required by numba. Does nothing: file names contain the hash of the source, so no file is out of date."""


def _sources(function: Callable[..., Any], found: dict[str, str] | None = None) -> dict[str, str]:
    """Path -> source of the function's file and of all files whose compiled functions it uses."""
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
    """Cache file with the machine code of one function signature, or one LLVM text, for this processor."""

    def __init__(self, stem: str, codegen: Any, signature: Any = None) -> None:
        self.key = stem, signature, codegen.magic_tuple()
        folder = cache_folder() if stem else None
        digits = hashlib.sha256(repr(self.key).encode()).hexdigest()[:12]
        self.file = None if folder is None else folder / f"{stem}-{digits}.code"

    def load(self, rebuild: Callable[[Any], Any]) -> Any:
        """Content of the file after `rebuild`; None if the file is missing or damaged."""
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
            # Whatever is wrong with a file, compiling again repairs it.
            log.warning("%s: can't be loaded (%s); compiling again", self.file, error)
            with suppress(OSError):
                self.file.unlink()
            return None

    def save(self, parts: Any) -> None:
        """Write the file atomically."""
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
