"""A folder is a registry: every module in it that defines the wanted object is a member, and nothing else is listed."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any


def members(package: ModuleType, attribute: str) -> dict[str, Any]:
    """Collect `attribute` of every public module of `package`, keyed by the object's own `name`.

    Raises TypeError at once, not at first use, for a module that lacks the attribute or takes a name twice: both are
    mistakes of the person who adds a file, and the message says which file.
    """
    found: dict[str, Any] = {}
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda item: item.name):
        if info.name.startswith("_"):
            continue
        module = importlib.import_module(f"{package.__name__}.{info.name}")
        if not hasattr(module, attribute):
            raise TypeError(f"{module.__file__}: a module of {package.__name__} must define `{attribute}`")
        member = getattr(module, attribute)
        if member.name in found:
            raise TypeError(f"{module.__file__}: the name {member.name!r} is taken by another module of this folder")
        found[member.name] = member
    return found
