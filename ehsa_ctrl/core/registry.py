"""Registries: each module of a folder adds what it defines; nothing else lists the members.

A module defines one member (`effect = ...`), or several as a tuple under the plural (`effects = (..., ...)`).

Members also come from a user's project (`effects/` beside `plants/`) and from installed packages (entry points). The
code of a project runs only if the project is the working directory, or if one of its plants is loaded by path. Files
that have changed are executed again when the next plant is loaded, so that a notebook need not be restarted.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import logging
import os
import pkgutil
import sys
from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from .errors import InputError

log = logging.getLogger(__name__)

T = TypeVar("T")

#: Projects outside the working directory from which a plant was loaded by path.
_PROJECTS: list[Path] = []
#: Counts loaded plants: each registry looks for changed files once for each count.
_loads = 0


def add_project(plant: Path) -> None:
    """Add the project of a plant's or effect's file: the parent of `plants/` or `effects/`, else the file's folder.

    Registries then look for new and changed files in all projects.
    """
    global _loads
    _loads += 1
    folder = plant.resolve().parent
    project = folder.parent if folder.name in ("plants", "effects") else folder
    if project not in _PROJECTS:
        _PROJECTS.append(project)


def members(package: ModuleType, attribute: str) -> dict[str, Any]:
    """Name -> object, from the `attribute` of each public module of `package`.

    Raises TypeError for a module without the attribute, and for a name used twice.
    """
    found: dict[str, Any] = {}
    for info in sorted(pkgutil.iter_modules(package.__path__), key=lambda item: item.name):
        if info.name.startswith("_"):
            continue
        module = importlib.import_module(f"{package.__name__}.{info.name}")
        defined = _defined(module, attribute)
        if not defined:
            raise TypeError(f"{module.__file__}: a module of {package.__name__} must define `{attribute}`")
        for member in defined:
            if member.name in found:
                raise TypeError(f"{module.__file__}: the name {member.name!r} is taken by another member")
            found[member.name] = member
    return found


def _defined(module: Any, attribute: str) -> tuple[Any, ...]:
    """The members that a module defines: one object, or a tuple under the plural; empty for none."""
    several = getattr(module, f"{attribute}s", None)
    if isinstance(several, tuple):
        return several
    return (getattr(module, attribute),) if hasattr(module, attribute) else ()


class Registry(Mapping[str, T], Generic[T]):
    """Name -> member, from the package, installed packages, the working directory's project and other projects in use.

    package: its modules define the shipped members. attribute: name that each module defines. kind: its type.
    folder: folder in a project; "ehsa_ctrl." and this name is the group of entry points. read: of a TOML file in that
    folder, for members that need no code.
    """

    def __init__(
        self,
        package: ModuleType,
        attribute: str,
        kind: type[T],
        folder: str,
        read: Callable[[Path], T] | None = None,
    ) -> None:
        self._shipped: dict[str, T] = dict(sorted(members(package, attribute).items()))
        self._attribute, self._kind, self._folder, self._read = attribute, kind, folder, read
        #: Members that are found by their names, but not listed.
        self._kept: dict[str, T] = {}
        #: Folder of a project -> (file, time of its last change, size) of each of its files, and its members.
        self._known: dict[Path, tuple[list[tuple[Path, int, int]], dict[str, T]]] = {}
        #: Number of loads, projects and working directory at the last merge, and all members.
        self._merged: tuple[tuple[int, tuple[Path, ...], str], dict[str, T]] = ((-1, (), ""), self._shipped)

    def members(self) -> Mapping[str, T]:
        """All members, as they are now: a look-up in it is faster than in the registry."""
        state = _loads, tuple(_PROJECTS), os.getcwd()  # noqa: PTH109 - called at every look-up, and ten times as fast
        if self._merged[0] != state:
            everywhere = self._shipped | self._installed
            found = dict(everywhere)
            # Later projects override earlier ones; the working directory comes last.
            for project in (*_PROJECTS, Path.cwd()):
                own = self._of(project / self._folder)
                if taken := set(own) & set(everywhere):
                    raise InputError(
                        f"{project / self._folder}: the name {min(taken)!r} is already in use; choose another"
                    )
                found |= own
            self._merged = (state, found)
        return self._merged[1]

    def _of(self, folder: Path) -> dict[str, T]:
        """Members of a project's folder; its modules are executed once, and again after a change."""
        kinds = ("*.py",) if self._read is None else ("*.py", "*.toml")
        files = [file for kind in kinds for file in sorted(folder.glob(kind))] if folder.is_dir() else []
        state = [(file, file.stat().st_mtime_ns, file.stat().st_size) for file in files]
        if folder not in self._known or self._known[folder][0] != state:
            found: dict[str, T] = {}
            for file in files:
                for member in () if file.name.startswith("_") else self._load(file):
                    if member.name in found:  # type: ignore[attr-defined]
                        raise InputError(f"{file}: the name {member.name!r} is taken by another member of this folder")  # type: ignore[attr-defined]
                    found[member.name] = member  # type: ignore[attr-defined]
            if found:
                log.info("%s of this project: %s (from %s)", self._folder, ", ".join(found), folder)
            self._known[folder] = (state, found)
        return self._known[folder][1]

    def _load(self, file: Path) -> tuple[T, ...]:
        if file.suffix == ".toml":
            assert self._read is not None
            return (self._read(file),)
        spec = importlib.util.spec_from_file_location(f"ehsa_ctrl_project_{self._folder}_{file.stem}", file)
        assert spec is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module
        try:
            # Not the loader's cache of compiled code, which misses a second change within one second.
            exec(compile(file.read_bytes(), file, "exec"), vars(module))
        except Exception as error:
            raise InputError(f"{file}: can't be run: {type(error).__name__}: {error}") from error
        return tuple(self._checked(member, str(file)) for member in _defined(module, self._attribute) or (None,))

    def _checked(self, member: Any, where: str) -> T:
        if not isinstance(member, self._kind):
            raise InputError(f"{where}: must define `{self._attribute}`, of type {self._kind.__name__}")
        return member

    @cached_property
    def _installed(self) -> dict[str, T]:
        group = f"ehsa_ctrl.{self._folder}"
        points = importlib.metadata.entry_points(group=group)
        found = [self._checked(point.load(), f"entry point {point.name} of {group}") for point in points]
        return {member.name: member for member in found}  # type: ignore[attr-defined]

    def keep(self, name: str, member: T) -> None:
        """Make a member known by its name, for one that is being tried: it is not listed, nor is it in `members`."""
        self._kept[name] = member

    def __getitem__(self, name: str) -> T:
        found = self.members()
        return found[name] if name in found else self._kept[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.members())

    def __len__(self) -> int:
        return len(self.members())

    # One look-up for all members; those of Mapping would look up each one.

    def values(self) -> ValuesView[T]:
        return self.members().values()

    def items(self) -> ItemsView[str, T]:
        return self.members().items()
