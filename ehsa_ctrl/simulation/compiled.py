"""From an engine's text to compiled functions, kept on disk between starts.

numba's own cache looks at the date of one file, so that an edit of a physics function in another file would go
unnoticed. Here the whole text of an engine goes into a folder that is named by the hash of that text and of the
versions that compile it: an edited equation is another text, hence another folder.
"""

from __future__ import annotations

import hashlib
import importlib.util
import logging
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from types import ModuleType

from ..plant.structure import Structure
from .kernel_text import kernel_text

log = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Where compiled engines are kept: EHSA_CTRL_CACHE, else the user's cache folder, else a temporary one."""
    import platformdirs

    chosen = os.environ.get("EHSA_CTRL_CACHE")
    folder = Path(chosen) if chosen else Path(platformdirs.user_cache_dir("ehsa_ctrl"))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    fallback = Path(tempfile.gettempdir()) / f"ehsa_ctrl-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    fallback.mkdir(parents=True, exist_ok=True)
    return fallback


@cache
def engine(structure: Structure, part: str = "open_loop") -> ModuleType:
    """The compiled engine of a structure; `part` is one of `kernel_text.PARTS`.

    The first call ever for a structure compiles (some ten seconds); later starts load the result.
    """
    import numba
    from filelock import FileLock

    text = kernel_text(structure, part)
    versions = f"{numba.__version__} {sys.version} {sys.platform}"
    key = hashlib.sha256(f"{versions}\n{text}".encode()).hexdigest()[:20]
    folder = cache_folder() / key
    name = f"ehsa_ctrl_engine_{key}"
    file = folder / f"{name}.py"
    folder.mkdir(exist_ok=True)
    # Several processes may start cold at once (parallel tests, workers): one compiles, the others wait and load.
    with FileLock(folder / "lock"):
        if not file.is_file():
            draft = file.with_suffix(".tmp")
            draft.write_text(text, encoding="utf-8")
            draft.replace(file)
        if not any(folder.glob("**/*.nbi")):
            log.info("compiling the %s engine for %s: once, some ten seconds", part.replace("_", "-"), structure)
        return _load(name, file)


def _load(name: str, file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # numba looks the module up by its name while it compiles; unregistered, it would compile everything twice.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
