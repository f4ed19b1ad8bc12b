"""What commands say: JSON on standard output, sentences on standard error, and what a result rests on."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..plant.plant import Plant


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


def warn_implausible(plants: Iterable[Plant]) -> None:
    """Say which values were set outside the range in which a plant's file believes them."""
    for sentence in dict.fromkeys(sentence for plant in plants for sentence in plant.implausible):
        warn(sentence)


def say(sentence: str, *, who: str = "ehsa-ctrl:") -> None:
    """What is wrong, on standard error; one line, whatever the argument or the file name that it quotes."""
    import sys

    # Where standard error can't be written to, the exit status has to do.
    with suppress(OSError):
        print(who, " ".join(sentence.splitlines()), file=sys.stderr, flush=True)


def note(sentence: str) -> None:
    """Something that was assumed and is probably right, on standard error."""
    say(sentence, who="ehsa-ctrl: note:")


def warn(sentence: str) -> None:
    """A warning on standard error; the command goes on."""
    say(sentence, who="ehsa-ctrl: warning:")
