"""Read text, TOML and JSON files with one-sentence errors; write files atomically."""

from __future__ import annotations

import json
import secrets
import tomllib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import InputError

#: Prefix of the names of drafts and manifests.
DRAFT_PREFIX = ".ehsa_ctrl-"
#: How a user allows a result to be replaced, for messages: on the command line and in Python.
FORCE_OPTION, FORCE_ARGUMENT = "use --force", "pass force=True"


def read_text(path: Path) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises InputError for a file that is missing, a folder, not readable or not UTF-8.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not valid UTF-8 (byte {error.start + 1}); save it as UTF-8") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: is not a file name") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file. Raises InputError as `read_text` does, and for invalid TOML, with the line."""
    text = read_text(path)
    try:
        content = tomllib.loads(text)
        _check_integers(content)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is not valid TOML: {error}") from None
    except ValueError:
        raise InputError(f"{path}: is not valid TOML: it contains an integer of more than 64 bits") from None
    except RecursionError:
        raise InputError(f"{path}: is not valid TOML: brackets are nested too deeply") from None
    return content


def _check_integers(value: Any) -> None:
    """Raise ValueError for an integer beyond 64 bits, which TOML does not allow."""
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_integers(item)


def read_json(path: Path) -> Any:
    """Content of a JSON file. Raises InputError as `read_text` does, and for invalid JSON."""
    text = read_text(path)
    try:
        return parse_json(text)
    except ValueError:
        raise InputError(f"{path}: is not valid JSON") from None


def parse_json(text: str) -> Any:
    """Content of a JSON text. Raises ValueError for invalid JSON, also for brackets nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Path of a draft in the folder of `path`; it replaces `path` when the block ends without an error.

    A missing folder is created. After an error or an interrupt the old file is unchanged.

    Raises InputError for a path that can't be written.
    """
    # Replace the target of a link, not the link.
    path = Path(path).resolve() if Path(path).is_symlink() else Path(path)
    made = missing_folders(path.parent)
    # The draft keeps the suffix, because some writers choose the format by it.
    draft = path.with_name(f"{DRAFT_PREFIX}{secrets.token_hex(4)}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        draft.replace(path)
    except OSError as error:
        raise InputError(f"{path}: can't be written ({strerror(error)})") from error
    finally:
        draft.unlink(missing_ok=True)
        remove_empty(made)


def write_text(path: str | Path, text: str) -> Path:
    """Write a text file atomically and return its path."""
    with atomic_write(path) as draft:
        draft.write_text(text, encoding="utf-8")
    return Path(path)


def refuse_existing(path: Path, *, force: bool, how: str = FORCE_OPTION) -> None:
    """Raise InputError if a file that the user named exists, unless force is set."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not force:
        raise InputError(f"{path}: already exists; choose another name or {how}")


def missing_folders(folder: Path) -> list[Path]:
    """The folder and its parents that do not exist, the innermost first."""
    return [place for place in (folder, *folder.parents) if not place.exists()]


def remove_empty(folders: Iterable[Path]) -> None:
    """Remove the empty ones of these folders, the innermost first."""
    for place in sorted(folders, key=lambda folder: -len(folder.parts)):
        with suppress(OSError):
            place.rmdir()


def strerror(error: OSError) -> str:
    """The reason of a file error in words."""
    return error.strerror or str(error)
