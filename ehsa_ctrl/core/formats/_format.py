"""A file format of logs: what tells it, what it needs, and its reader."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError
from ..table import LogTable


@dataclass(frozen=True)
class Format:
    """One format, in one file of this folder.

    Attributes
    ----------
    name: in messages and tables, as in "is not a valid TDMS file".
    suffixes: endings of its files, in lower case.
    contents: what is read, for the documentation.
    read: path -> its tables. Channels that were sampled together are one table, with the time that the file gives
        them. Whatever the library raises on a damaged file becomes one sentence, see `read_tables`.
    modules: what `read` imports beyond the package's own requirements; the first one is named in messages.
    extra: the extra of the package that installs them.
    magic: first bytes of its files; a file that begins so is read in this format whatever its ending is.
    recognises: (path, first bytes) -> whether it is this format, where `magic` can't tell.
    """

    name: str
    suffixes: tuple[str, ...]
    contents: str
    read: Callable[[Path], Iterable[LogTable]]
    modules: tuple[str, ...] = ()
    extra: str = ""
    magic: tuple[bytes, ...] = ()
    recognises: Callable[[Path, bytes], bool] = lambda path, head: False

    def fits(self, path: Path, head: bytes) -> bool:
        """Whether the content shows this format."""
        return any(head.startswith(magic) for magic in self.magic) or self.recognises(path, head)

    def summary(self) -> str:
        """Endings, extra (and whether its libraries are here) and contents, in words."""
        endings = ", ".join(self.suffixes) or "recognised by its content"
        missing = any(importlib.util.find_spec(module) is None for module in self.modules)
        extra = f" (extra {self.extra}{', not installed' if missing else ''})" if self.extra else ""
        return f"{endings}{extra}: {self.contents.replace('`', '')}"

    def require(self, path: Path) -> None:
        """Raise InputError, with the command to install it, if a library is missing."""
        for module in self.modules:
            try:
                importlib.import_module(module)
            except ImportError:
                raise InputError(
                    f"{path}: reading {self.name} needs {module.partition('.')[0]}; install it with "
                    f'pip install "ehsa_ctrl[{self.extra}]"'
                ) from None
