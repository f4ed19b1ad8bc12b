"""The catalogues of definitions: plants, controllers and scenarios, one TOML file each.

The folders `plants/`, `controllers/` and `scenarios/` of the working directory take precedence over the package's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError, choices, shown

KINDS = ("plants", "controllers", "scenarios")

_PACKAGE = Path(__file__).resolve().parent.parent


def shipped_folder(kind: str) -> Path:
    """Folder of the shipped definitions: inside the wheel, or beside the package in a checkout."""
    inside = _PACKAGE / "catalogue" / kind
    return inside if inside.is_dir() else _PACKAGE.parent / kind


def shipped(kind: str) -> dict[str, Path]:
    """Name -> file of the shipped definitions."""
    return {path.stem: path for path in sorted(shipped_folder(kind).glob("*.toml"))}


def is_shipped(kind: str, path: Path) -> bool:
    """Whether this is a shipped definition."""
    return path.resolve() in {file.resolve() for file in shipped(kind).values()}


@dataclass(frozen=True)
class Catalogue(Mapping[str, Path]):
    """Definitions of one kind: a mapping from name to file. Names are also attributes, for tab completion."""

    kind: str

    @property
    def folders(self) -> tuple[Path, ...]:
        own = Path.cwd() / self.kind
        shipped = shipped_folder(self.kind)
        return (own, shipped) if own.is_dir() and own.resolve() != shipped.resolve() else (shipped,)

    def _files(self) -> dict[str, Path]:
        files: dict[str, Path] = {}
        for folder in reversed(self.folders):
            files.update({path.stem: path for path in sorted(folder.glob("*.toml"))})
        return files

    def __getitem__(self, name: str) -> Path:
        try:
            return self._files()[name]
        except KeyError:
            raise KeyError(f"no {self.kind[:-1]} {name!r}; {choices(name, self._files())}") from None

    def __getattr__(self, name: str) -> Path:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._files()))

    def __len__(self) -> int:
        return len(self._files())

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]

    def titles(self) -> dict[str, str]:
        """Name -> title of every definition."""
        from .files import read_toml

        return {name: str(read_toml(self[name]).get("title", "")) for name in self}

    def __repr__(self) -> str:
        rows = [f"  {name:<24} {title}" for name, title in self.titles().items()]
        return "\n".join([f"{self.kind}:", *rows])

    def find(self, name: str | Path, *, beside: Path | None = None) -> Path:
        """The file of a definition given by name or by path.

        Parameters
        ----------
        beside: the TOML file that refers to this definition. A path is tried relative to its folder first, and a name
            in its project first, so that the files of a project find each other from any working directory.

        Raises InputError, with the closest name, if there is none.
        """
        text = str(name)
        if text.endswith(".toml") or "/" in text or "\\" in text:
            places = [Path(text)] if beside is None else [beside.parent / text, Path(text)]
            for path in places:
                with suppress(OSError, ValueError):
                    # A path may be too long for the file system or contain a zero byte.
                    if path.is_file():
                        return path
            raise InputError(f"{places[0]}: no such file; give a {self.kind[:-1]}'s name or the path of a TOML file")
        files = self._files()
        if beside is not None:
            project = beside.resolve().parent.parent / self.kind
            if project.is_dir() and project != shipped_folder(self.kind).resolve():
                files |= {path.stem: path for path in sorted(project.glob("*.toml"))}
        if text not in files:
            raise InputError(f"no {self.kind[:-1]} {shown(text)}; {choices(text, files)}")
        return files[text]


plants = Catalogue("plants")
controllers = Catalogue("controllers")
scenarios = Catalogue("scenarios")
