"""Output of a command: files in a folder, JSON or text on standard output, messages on standard error."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.result import to_json as to_json
from .options import Force, Json, Out

if TYPE_CHECKING:
    from rich.table import Table

    from ..plant.plant import Plant


@dataclass(frozen=True)
class OutputOptions:
    """The options --json, --out and --force."""

    as_json: Json = False
    out: Out = None
    force: Force = False

    def check(self, command: str, *names: str, figures: Iterable[str] = (), keep: bool = False) -> None:
        """Check, before any computation, that the folder can take the result.

        names: files of the result, the main one first. figures: names of its figures. keep: as in ResultFolder.

        Raises InputError as ResultFolder.check does.
        """
        from ..core.result_folder import ResultFolder

        if self.out is not None:
            ResultFolder(self.out, command, self.force, keep).check(*names, figures=figures)

    def deliver(
        self,
        command: str,
        file: str,
        result: Mapping[str, Any],
        text: Callable[[], None],
        *,
        stored: Mapping[str, Any] | None = None,
        files: Callable[[Path], None] = lambda draft: None,
        then: str | None = "",
        keep: bool = False,
    ) -> None:
        """Write the files of a result, then print it.

        Parameters
        ----------
        command: owner of the files in the folder.
        file: name of the JSON file.
        result: content of --json, and of the file unless `stored` is given.
        text: prints the result as text.
        then: text after "written to DIR (open PAGE)"; None if `text` prints that line itself.
        files: writes the other files into the folder it gets, before the JSON file and the page are written.
        keep: as in ResultFolder.
        """
        from ..core.result_folder import ResultFolder

        if self.out is not None:
            with ResultFolder(self.out, command, self.force, keep).draft() as draft:
                files(draft)
                (draft / file).write_text(to_json(result if stored is None else stored) + "\n")
                from ..report.kinds import kinds
                from ..report.results import write_result_page

                # A run of `serve` has no page.
                page = f" (open {self.out / write_result_page(draft, file).name})" if file in kinds() else ""
        if self.as_json:
            print(to_json(result))
            return
        text()
        if self.out is not None and then is not None:
            print(f"written to {self.out}{page}{then}")


def bare_table(*headings: str, right: int = 0) -> Table:
    """A table without rules; `right` columns of numbers follow the first one."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for k, heading in enumerate(headings):
        number = 1 <= k <= right
        table.add_column(heading, justify="right" if number else "left", overflow="fold" if number else "ellipsis")
    return table


def provenance(plants: Iterable[Plant], files: Iterable[str | Path | None] = ()) -> dict[str, Any]:
    """Content of `rests_on` in a result's JSON: assumed parameters, hashes of files, date, the command line."""
    from ..report.provenance import provenance as provenance_of

    return {**provenance_of(plants, files), "command": command_line()}


def assumed_names(plant: Plant) -> list[str]:
    """Parameters with the source "assumed"."""
    return [name for name, p in plant.parameters.items() if p.source == "assumed"]


def command_line() -> str:
    """The command line, quoted for a shell; paths in the current folder are relative to it, those in the home folder
    begin with ~.
    """
    places = {f"{Path.cwd()}{os.sep}": "", f"{Path.home()}{os.sep}": "~/"}

    def told(word: str) -> str:
        for place, short in places.items():
            if word.startswith(place):
                return short + shlex.quote(word.removeprefix(place))
        return shlex.quote(word)

    return " ".join(["ehsa-ctrl", *map(told, sys.argv[1:])])


def warn_implausible(plants: Iterable[Plant]) -> None:
    """Warn of values outside the bounds in a plant's file."""
    warn_once(sentence for plant in plants for sentence in plant.implausible)


def warn_once(sentences: Iterable[str]) -> None:
    """Warn of each sentence, of equal ones once."""
    for sentence in dict.fromkeys(sentences):
        warn(sentence)


def say(sentence: str, *, who: str = "ehsa-ctrl:") -> None:
    """Print a message on standard error, in one line even if it quotes several."""
    # If standard error is closed or full, the exit status alone reports the error.
    with suppress(OSError):
        print(who, " ".join(sentence.splitlines()), file=sys.stderr, flush=True)


def note(sentence: str) -> None:
    """Print an assumption on standard error, e.g. one made in reading a log."""
    say(sentence, who="ehsa-ctrl: note:")


def warn(sentence: str) -> None:
    """Print a warning on standard error; the command goes on."""
    say(sentence, who="ehsa-ctrl: warning:")
