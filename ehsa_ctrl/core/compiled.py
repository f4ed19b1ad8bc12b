"""From the text of a module to compiled functions, kept on disk between starts.

numba's own cache looks at the date of one file, so that an edit of a function in another file would go unnoticed.
Here the whole text that is compiled goes into a folder that is named by the hash of that text and of the versions
that compile it: an edited equation is another text, hence another folder.
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

log = logging.getLogger(__name__)


def cache_folder() -> Path:
    """Where compiled modules are kept: EHSA_CTRL_CACHE, else the user's cache folder, else a temporary one."""
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
def load_compiled(text: str, title: str) -> ModuleType:
    """The module with this text, whose functions carry numba's decorators with cache=True.

    The first call ever for a text compiles; later starts load the result. `title` is for the log alone.
    """
    import numba
    from filelock import FileLock

    versions = f"{numba.__version__} {sys.version} {sys.platform}"
    key = hashlib.sha256(f"{versions}\n{text}".encode()).hexdigest()[:20]
    folder = cache_folder() / key
    name = f"ehsa_ctrl_compiled_{key}"
    file = folder / f"{name}.py"
    folder.mkdir(exist_ok=True)
    # Several processes may start cold at once (parallel tests, workers): one compiles, the others wait and load.
    with FileLock(folder / "lock"):
        if not file.is_file():
            draft = file.with_suffix(".tmp")
            draft.write_text(text, encoding="utf-8")
            draft.replace(file)
        if not any(folder.glob("**/*.nbi")):
            log.info("compiling %s: once, 10 s to a minute, longer on a busy machine", title)
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
