"""Entry point of `ehsa-ctrl`: the commands, and the one place where errors become sentences and exit statuses.

Heavy imports stand inside the commands, so that `--help` answers at once.
"""

from __future__ import annotations

import io
import os
import sys
from typing import Any

import typer
from typer.core import TyperGroup

from ..core.errors import EhsaError, InputError
from . import (
    analyse,
    check,
    compare,
    design,
    diagnose,
    excite,
    export,
    fmu,
    identify,
    listing,
    montecarlo,
    new,
    report,
    run,
    simulate,
)
from .output import remove_empty, say

EPILOG = """\
Exit status: 0 done; 1 ran, but a scenario's limit failed; 2 the input was wrong, said in one sentence; 130 interrupted.

Start with: ehsa-ctrl run
"""


class Interrupted(Exception):  # noqa: N818 - Ctrl-C, not an error
    """Ctrl-C; its text says what is kept."""


class Commands(TyperGroup):
    """typer would leave with status 130 and without a word."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for word in args:
            if any("\ud800" <= letter <= "\udfff" for letter in word):
                raise InputError(f"{word!r}: is no text in UTF-8, as arguments have to be; rename the file")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        if isinstance(sys.stdout, io.TextIOWrapper):
            # Names of files that are found may be in any encoding.
            sys.stdout.reconfigure(errors="backslashreplace")
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stopped:
            raise Interrupted(str(stopped)) from None


app = typer.Typer(
    name="ehsa-ctrl",
    cls=Commands,
    help="Control design on an electro-hydrostatic actuator: from the identified linear model to a controller "
    "that is checked on the nonlinear plant with friction and a spring load.",
    epilog=EPILOG,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("run")(run.command)
app.command("montecarlo")(montecarlo.command)
app.command("simulate")(simulate.command)
app.command("analyse")(analyse.command)
app.command("design")(design.command)
app.command("excite")(excite.command)
app.command("compare")(compare.command)
app.command("identify")(identify.command)
app.command("diagnose")(diagnose.command)
app.command("export")(export.command)
app.command("fmu")(fmu.command)
app.add_typer(new.app, name="new")
app.command("report")(report.command)
app.command("list")(listing.command)
app.command("check")(check.command)


def main() -> None:
    """Run the command line and exit: 0, 1 or 2 as the epilog says."""
    # Small matrices by the thousand: threads of the linear algebra cost several times what they bring.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if len(sys.argv) == 1:
        sys.argv.append("--help")
    try:
        status = app(prog_name="ehsa-ctrl", standalone_mode=False)
    except EhsaError as error:
        say(str(error))
        status = 2
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "ehsa-ctrl"
        sentence = " ".join(error.format_message().split()).rstrip(".")
        if not sentence:
            # A group of commands that was called alone has printed its help.
            sentence = "say which: " + ", ".join(getattr(getattr(context, "command", None), "commands", ()))
        print(f"{command}: {sentence}; see {command} --help", file=sys.stderr)
        status = 2
    except MemoryError as error:
        print(f"ehsa-ctrl: out of memory ({error}); ask for fewer samples or runs", file=sys.stderr)
        status = 2
    except (Interrupted, typer.Abort, KeyboardInterrupt) as stopped:
        kept = f"; {stopped}" if str(stopped) else ""
        print(f"ehsa-ctrl: interrupted{kept}", file=sys.stderr)
        status = 130
    except BrokenPipeError:
        status = 0
    except SystemExit as stopped:
        # rich leaves with 1 where nobody reads on; to us that is a limit that failed.
        status = stopped.code if isinstance(stopped.code, int) and stopped.code != 1 else 0
    if status:
        remove_empty()
    if not _flushed():
        status = 0
    sys.exit(status or 0)


def _flushed() -> bool:
    """Whether standard output was read to its end; if not (`| head`), Python is kept from complaining of it."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return False
    return True


if __name__ == "__main__":
    main()
