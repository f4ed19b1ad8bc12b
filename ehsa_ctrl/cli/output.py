"""Where results go: files in a folder that is never overwritten unasked, JSON on standard output, tables for people."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.errors import InputError

if TYPE_CHECKING:
    from ..plant.plant import Plant


#: Folders that were made for results, the innermost first.
_made: list[Path] = []


def prepare_folder(folder: Path, result: str, *, force: bool) -> Path:
    """Create the folder for a result. Raises InputError if it holds `result` already, unless force is set."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give a folder")
    if (folder / result).exists() and not force:
        raise InputError(f"{folder / result}: there is a result already; choose another folder or say --force")
    _made.extend(place for place in (folder, *folder.parents) if not place.exists())
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: can't be created ({error.strerror})") from None
    return folder


def remove_empty() -> None:
    """Remove the folders that were made for a result that did not come: an input that was wrong leaves nothing."""
    while _made:
        # What is not empty, or not there, stays so.
        with suppress(OSError):
            _made.pop(0).rmdir()


def write_text(path: Path, text: str) -> Path:
    """Write a file, with its folder. Raises InputError for one that can't be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: can't be written ({error.strerror})") from None
    return path


def plain(value: Any) -> Any:
    """A value as JSON knows it: numpy numbers and arrays become plain ones, nan and infinity null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def rests_on(plants: Iterable[Plant], files: Iterable[str | Path | None] = ()) -> dict[str, Any]:
    """What a result's JSON says under `rests_on`: assumed parameters, hashes of files, the command line."""
    from ..report.grounds import grounds

    return {**grounds(plants, files), "command": command_line()}


def command_line() -> str:
    """The call as it can be repeated in a shell: arguments with spaces in quotes."""
    import shlex
    import sys

    return shlex.join(["ehsa-ctrl", *sys.argv[1:]])


def to_json(value: Any) -> str:
    return json.dumps(plain(value), indent=2)


def warn_unbelieved(plants: Iterable[Plant]) -> None:
    """Say which values were set outside the range in which a plant's file believes them."""
    for sentence in dict.fromkeys(sentence for plant in plants for sentence in plant.unbelieved):
        warn(sentence)


def say(sentence: str) -> None:
    """What is wrong, on standard error; one line, whatever the argument or the file name that it quotes."""
    import sys

    print("ehsa-ctrl:", " ".join(sentence.splitlines()), file=sys.stderr)


def note(sentence: str) -> None:
    """Something that was assumed and is probably right, on standard error."""
    import sys

    print(f"ehsa-ctrl: note: {sentence}", file=sys.stderr)


def warn(sentence: str) -> None:
    """A warning on standard error; the command goes on."""
    import sys

    print(f"ehsa-ctrl: warning: {sentence}", file=sys.stderr)
