"""Files that are written whole or not at all, and never over a user's own.

A result's files are drafted in a hidden folder inside the target, which is on the same file system, and moved into
place when all of them are there. A manifest, `.ehsa_ctrl-COMMAND.json`, lists them with their hashes: these files, as
long as nobody has edited them, are all that a command ever replaces or removes.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError
from .reading import json_of

#: How the names of manifests and of folders of drafts begin.
PREFIX = ".ehsa_ctrl-"
#: How one says that a result may be replaced, on the command line and in Python.
FORCE_OPTION, FORCE_ARGUMENT = "say --force", "say force=True"


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A file beside `path` to be written, which takes its place when the block ends without an error.

    The folder is made where it is missing. After an error or an interrupt the old file is still there, whole.

    Raises InputError for a path that can't be written.
    """
    # A link stays one: what it points to is replaced.
    path = Path(path).resolve() if Path(path).is_symlink() else Path(path)
    made = _missing(path.parent)
    # The ending stays: some writers go by it.
    draft = path.with_name(f"{PREFIX}{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(f"{path}: can't be written ({_reason(error)})") from error
    finally:
        draft.unlink(missing_ok=True)
        _remove_empty(made)


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file as `replacing` does and return its path."""
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return Path(path)


def refuse_existing(path: Path, *, force: bool, how: str = FORCE_OPTION) -> None:
    """For a file that the user names: raise InputError if it is there, unless force is set."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not force:
        raise InputError(f"{path}: is there already; choose another name or {how}")


@dataclass(frozen=True)
class ResultFolder:
    """The place of one command's result in a folder, which may hold other files and other commands' results.

    Attributes
    ----------
    folder: need not exist. owner: the command. force: replace its earlier result.
    keep: files of the earlier result that the new one lacks stay, instead of being removed.
    how: how one asks for `force`, for messages.
    """

    folder: Path
    owner: str
    force: bool = False
    keep: bool = False
    how: str = FORCE_OPTION

    def check(self, *names: str, figures: Iterable[str] = ()) -> ResultFolder:
        """Say before the work what would stop the result at its end.

        names: files that it will have, the main one first. figures: names of its figures, each a .png and an .svg.

        Returns itself. Raises InputError for a path that is no folder or can't be one, an earlier result without
        `force`, a file that is not this command's, or one that was edited since.
        """
        there = next(place for place in (self.folder, *self.folder.absolute().parents) if os.path.lexists(place))
        if there == self.folder and not there.is_dir():
            raise InputError(f"{self.folder}: is a file; give a folder")
        if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
            why = "is no folder" if not there.is_dir() else "can't be written to"
            raise InputError(f"{self.folder}: can't be created or written to: {there} {why}")
        self._refuse([*names, *(f"{figure}.{ending}" for figure in figures for ending in ("png", "svg"))])
        return self

    @contextmanager
    def draft(self) -> Iterator[Path]:
        """A folder to write the result's files to; when the block ends without an error, they replace the old ones.

        After an error, an interrupt or on a full disk the old result is whole and no draft is left. If a file is in the
        way that `check` could not know of, the new result is kept in a folder of its own.

        Raises InputError for that, and for a folder that can't be written to.
        """
        made = _missing(self.folder)
        draft = self.folder / f"{PREFIX}{secrets.token_hex(4)}"
        try:
            draft.mkdir(parents=True)
            yield draft
            self._swap(draft)
        except (OSError, InputError) as error:
            # A file written with `replacing` is named by its place in the draft, which nobody knows.
            cause = error.__cause__ if isinstance(error, InputError) else error
            if not isinstance(cause, OSError):
                raise
            kept = "; what it held before is unchanged" if self.folder not in made else ""
            raise InputError(f"{self.folder}: can't be written ({_reason(cause)}){kept}") from cause
        except KeyboardInterrupt as stopped:
            raise KeyboardInterrupt(str(stopped) or f"the result is not kept, {self.folder} is as it was") from None
        finally:
            shutil.rmtree(draft, ignore_errors=True)
            _remove_empty(made)

    def _swap(self, draft: Path) -> None:
        """Move the drafted files into place and the old ones out; back again if that breaks off."""
        new = {name: _hash(draft / name) for name in _files_in(draft)}
        self._refuse(new, draft)
        old = self._unedited()
        kept = {name: digest for name, digest in old.items() if self.keep and name not in new}
        manifest = f"{PREFIX}{self.owner}.json"
        content = {"command": self.owner, "files": kept | new}
        (draft / manifest).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        away = [name for name in (*old, manifest) if name not in kept and (self.folder / name).exists()]
        moves = [(self.folder / name, draft / PREFIX / name) for name in away]
        moves += [(draft / name, self.folder / name) for name in (*new, manifest)]
        begun = []
        try:
            for source, target in moves:
                target.parent.mkdir(parents=True, exist_ok=True)
                begun.append((source, target))
                source.replace(target)
        except BaseException:
            for source, target in reversed(begun):
                if target.exists() and not source.exists():
                    target.replace(source)
            raise
        _remove_empty({(self.folder / name).parent for name in old} - {self.folder})

    def _refuse(self, names: Iterable[str], draft: Path | None = None) -> None:
        """Raise InputError for the first of these files that must not be replaced; a draft is kept elsewhere."""
        ours = self._unedited()
        for name in names:
            path = self.folder / name
            if not os.path.lexists(path) or (self.force and name in ours):
                continue
            if name in ours:
                why = f"there is a result already; choose another folder or {self.how}"
            else:
                why = self._whose(name)
            if draft is not None:
                place = _free(self.folder / self.owner)
                draft.rename(place)
                why += f" (the new result is kept in {place})"
            raise InputError(f"{path}: {why}")

    def _unedited(self) -> dict[str, str]:
        """The files of this command's earlier result that are as it wrote them, with their hashes."""
        listed = _listed(self.folder / f"{PREFIX}{self.owner}.json")
        return {name: digest for name, digest in listed.items() if _hash(self.folder / name) == digest}

    def _whose(self, name: str) -> str:
        """Why a file that is not an unedited one of ours stays, and what to do."""
        for manifest in sorted(self.folder.glob(f"{PREFIX}*.json")):
            if name in _listed(manifest):
                owner = manifest.stem.removeprefix(PREFIX)
                if owner != self.owner:
                    return f"belongs to the result of {owner} in this folder; choose another folder"
                return f"was edited since {owner} wrote it; move it away or choose another folder"
        return f"is not listed as written by {self.owner}; move it away or choose another folder"


def _listed(manifest: Path) -> Mapping[str, str]:
    """Files that a manifest names; nothing for one that is missing or damaged, or for paths that leave the folder."""
    try:
        files = json_of(manifest.read_text(encoding="utf-8"))["files"].items()
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return {}
    inside = {name: digest for name, digest in files if not Path(name).is_absolute() and ".." not in Path(name).parts}
    return {name: digest for name, digest in inside.items() if isinstance(digest, str)}


def _hash(path: Path) -> str | None:
    """SHA-256 of a file; None for a link, a folder, or nothing."""
    if path.is_symlink() or not path.is_file():
        return None
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def _free(path: Path) -> Path:
    """The first of PATH-new, PATH-new-2 and so on that is not there."""
    number, place = 1, path.with_name(f"{path.name}-new")
    while place.exists():
        number += 1
        place = path.with_name(f"{path.name}-new-{number}")
    return place


def _missing(folder: Path) -> list[Path]:
    """The folder and those above it that are not there, the innermost first."""
    return [place for place in (folder, *folder.parents) if not place.exists()]


def _remove_empty(folders: Iterable[Path]) -> None:
    for place in sorted(folders, key=lambda folder: -len(folder.parts)):
        with suppress(OSError):
            place.rmdir()


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
