"""Text, TOML and JSON out of a file; whatever keeps it from being read is one sentence."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from .errors import InputError


def read_text(path: Path) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises InputError for one that is absent, a folder, not to be read, or no such text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8 (byte {error.start + 1}); save it as such") from None
    except ValueError:
        raise InputError(f"{str(path)!r}: is no name of a file") from None


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file. Raises InputError as `read_text` does, and for what is no TOML, with its line."""
    text = read_text(path)
    try:
        content = tomllib.loads(text)
        _check_integers(content)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: is no valid TOML: {error}") from None
    except ValueError:
        raise InputError(f"{path}: is no valid TOML: it holds a whole number of more than 64 bits") from None
    except RecursionError:
        raise InputError(f"{path}: is no valid TOML: brackets are nested too deeply") from None
    return content


def _check_integers(value: Any) -> None:
    """Raise ValueError for a whole number beyond 64 bits, which no TOML may hold."""
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError
    for item in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_integers(item)


def read_json(path: Path) -> Any:
    """Content of a JSON file. Raises InputError as `read_text` does, and for what is no JSON."""
    text = read_text(path)
    try:
        return json_of(text)
    except ValueError:
        raise InputError(f"{path}: is no valid JSON") from None


def json_of(text: str) -> Any:
    """Content of a JSON text. Raises ValueError for what is none, and for brackets nested too deeply."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("brackets are nested too deeply") from None
