"""Result folders: written completely or not at all, and never over a user's files.

The files of a result are drafted in a hidden folder inside the target, on the same file system, and moved into place
when all of them are complete. A manifest, `.ehsa_ctrl-COMMAND.json`, lists them with their hashes. A command replaces
and removes only these files, and only if nobody has edited them.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from .errors import InputError
from .files import DRAFT_PREFIX, FORCE_OPTION, missing_folders, parse_json, remove_empty, strerror


@dataclass(frozen=True)
class ResultFolder:
    """The result of one command in a folder, which may contain other files and results of other commands.

    Attributes
    ----------
    folder: need not exist.
    owner: the command.
    force: replace an earlier result of the command.
    keep: keep files of the earlier result that the new one lacks.
    how: how a user sets `force`, for messages.
    """

    folder: Path
    owner: str
    force: bool = False
    keep: bool = False
    how: str = FORCE_OPTION

    def check(self, *names: str, figures: Iterable[str] = ()) -> ResultFolder:
        """Check before a computation that its result can be written.

        names: its files, the main one first. figures: names of its figures, each a .png and an .svg.

        Returns itself. Raises InputError for a path that can't be a folder, an earlier result without `force`, and a
        file that another command or the user wrote or edited.
        """
        there = next(place for place in (self.folder, *self.folder.absolute().parents) if os.path.lexists(place))
        if there == self.folder and not there.is_dir():
            raise InputError(f"{self.folder}: is a file; give a folder")
        if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
            why = "is not a folder" if not there.is_dir() else "is not writable"
            raise InputError(f"{self.folder}: can't be created or written to: {there} {why}; give another folder")
        self._refuse([*names, *(f"{figure}.{ending}" for figure in figures for ending in ("png", "svg"))])
        return self

    @contextmanager
    def draft(self) -> Iterator[Path]:
        """A folder for the new files; when the block ends without an error, they replace the old ones.

        After an error, an interrupt or on a full disk the old result is unchanged and no draft is left.

        Raises InputError for a folder that can't be written to, and if a file that must not be replaced appeared after
        `check`; the new result is then kept in a separate folder.
        """
        made = missing_folders(self.folder)
        draft = self.folder / f"{DRAFT_PREFIX}{secrets.token_hex(4)}"
        try:
            draft.mkdir(parents=True)
            yield draft
            self._swap(draft)
        except (OSError, InputError) as error:
            # The message of `atomic_write` would name a file in the draft, which means nothing to a user.
            cause = error.__cause__ if isinstance(error, InputError) else error
            if not isinstance(cause, OSError):
                raise
            kept = "; its earlier content is unchanged" if self.folder not in made else ""
            raise InputError(f"{self.folder}: can't be written ({strerror(cause)}){kept}") from cause
        except KeyboardInterrupt as stopped:
            raise KeyboardInterrupt(str(stopped) or f"the result is not kept, {self.folder} is unchanged") from None
        finally:
            shutil.rmtree(draft, ignore_errors=True)
            remove_empty(made)

    def _swap(self, draft: Path) -> None:
        """Move the drafted files into place and the old ones out; undo this after an error."""
        new = {name: _hash(draft / name) for name in _files_in(draft)}
        self._refuse(new, draft)
        old = self._unedited()
        kept = {name: digest for name, digest in old.items() if self.keep and name not in new}
        manifest = f"{DRAFT_PREFIX}{self.owner}.json"
        content = {"command": self.owner, "files": kept | new}
        (draft / manifest).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        away = [name for name in (*old, manifest) if name not in kept and (self.folder / name).exists()]
        moves = [(self.folder / name, draft / DRAFT_PREFIX / name) for name in away]
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
        remove_empty({(self.folder / name).parent for name in old} - {self.folder})

    def _refuse(self, names: Iterable[str], draft: Path | None = None) -> None:
        """Raise InputError for the first of these files that must not be replaced; move the draft to a new folder."""
        ours = self._unedited()
        for name in names:
            path = self.folder / name
            if not os.path.lexists(path) or (self.force and name in ours):
                continue
            if name in ours:
                why = f"is part of an earlier result; choose another folder or {self.how}"
            else:
                why = self._reason(name)
            if draft is not None:
                place = _free(self.folder / self.owner)
                draft.rename(place)
                why += f" (the new result is kept in {place})"
            raise InputError(f"{path}: {why}")

    def _unedited(self) -> dict[str, str]:
        """The unchanged files of this command's earlier result, with their hashes."""
        listed = _read_manifest(self.folder / f"{DRAFT_PREFIX}{self.owner}.json")
        return {name: digest for name, digest in listed.items() if _hash(self.folder / name) == digest}

    def _reason(self, name: str) -> str:
        """Reason why a file can't be replaced, and what to do."""
        for manifest in sorted(self.folder.glob(f"{DRAFT_PREFIX}*.json")):
            if name in _read_manifest(manifest):
                owner = manifest.stem.removeprefix(DRAFT_PREFIX)
                if owner != self.owner:
                    return f"belongs to the result of {owner} in this folder; choose another folder"
                return f"was edited since {owner} wrote it; move it away or choose another folder"
        return f"is not listed as written by {self.owner}; move it away or choose another folder"


def _read_manifest(manifest: Path) -> Mapping[str, str]:
    """Files of a manifest that lie inside the folder; empty if the manifest is missing or damaged."""
    try:
        files = parse_json(manifest.read_text(encoding="utf-8"))["files"].items()
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return {}
    inside = {name: digest for name, digest in files if not Path(name).is_absolute() and ".." not in Path(name).parts}
    return {name: digest for name, digest in inside.items() if isinstance(digest, str)}


def _hash(path: Path) -> str | None:
    """SHA-256 of a file; None for a link, a folder or a missing file."""
    if path.is_symlink() or not path.is_file():
        return None
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _files_in(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def _free(path: Path) -> Path:
    """The first of PATH-new, PATH-new-2 and so on that does not exist."""
    number, place = 1, path.with_name(f"{path.name}-new")
    while place.exists():
        number += 1
        place = path.with_name(f"{path.name}-new-{number}")
    return place
