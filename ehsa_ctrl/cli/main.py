"""Entry point of `ehsa-ctrl`: the commands, and the mapping of errors to messages and exit statuses.

Commands import inside their functions, so that `--help` starts fast.
"""

from __future__ import annotations

import io
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ..core.errors import EhsaError, InputError
from . import (
    analyse,
    check,
    compare,
    convert,
    design,
    diagnose,
    effects,
    excite,
    export,
    fleet,
    fmu,
    frf,
    identify,
    init,
    learn,
    listing,
    montecarlo,
    new,
    report,
    run,
    serve,
    simulate,
)
from .options import expand_groups
from .output import say
from .progress import reporting_user_code

EPILOG = """\
Exit status: 0 done; 1 ran, but a scenario's limit or baseline failed; 2 wrong input, explained on standard error;
130 interrupted.

Start with: ehsa-ctrl run
"""


class Interrupted(Exception):  # noqa: N818 - Ctrl-C, not an error
    """Ctrl-C; the message tells which results are kept."""


class Commands(TyperGroup):
    """The group of commands. It turns Ctrl-C into Interrupted: typer would exit with 130 and no message."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        for word in args:
            if any("\ud800" <= character <= "\udfff" for character in word):
                raise InputError(f"{word!r}: is not valid UTF-8, which arguments must be; rename the file")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        if isinstance(sys.stdout, io.TextIOWrapper):
            # File names may be in any encoding.
            sys.stdout.reconfigure(errors="backslashreplace")
        try:
            with reporting_user_code():
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
COMMANDS = {
    "init": init, "run": run, "montecarlo": montecarlo, "learn": learn, "simulate": simulate, "analyse": analyse,
    "design": design, "excite": excite, "convert": convert, "compare": compare, "frf": frf, "identify": identify,
    "diagnose": diagnose, "fleet": fleet, "export": export, "fmu": fmu, "serve": serve, "report": report,
    "list": listing, "check": check,
}  # fmt: skip


def _print_versions(wanted: bool) -> None:
    if wanted:
        from ..simulation.trajectory import versions

        typer.echo("\n".join(f"{name} {version}" for name, version in versions().items()))
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_versions, is_eager=True, help="Print the versions and exit.")
    ] = False,
) -> None: ...


for name, module in COMMANDS.items():
    app.command(name)(expand_groups(module.command))
app.add_typer(new.app, name="new")
app.add_typer(effects.app, name="effects")


def main() -> None:
    """Run the command line and exit with a status of the epilog."""
    # The matrices are small: threads of the linear algebra only slow them down.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _reopen_closed_streams()
    if len(sys.argv) == 1:
        sys.argv.append("--help")
    failure: OSError | None = None
    try:
        status = app(prog_name="ehsa-ctrl", standalone_mode=False)
    except EhsaError as error:
        say(str(error))
        status = 2
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context is not None else "ehsa-ctrl"
        sentence = " ".join(error.format_message().split()).rstrip(".").replace("Value error, ", "")
        if not sentence:
            # typer has no message for a group without a command: it prints the help.
            commands = ", ".join(getattr(getattr(context, "command", None), "commands", ()))
            sentence = f"missing command, one of: {commands}"
        say(f"{sentence}; see {command} --help", who=f"{command}:")
        status = 2
    except MemoryError as error:
        say(f"out of memory ({error}); ask for fewer samples or runs")
        status = 2
    except (Interrupted, typer.Abort, KeyboardInterrupt) as stopped:
        kept = f"; {stopped}" if str(stopped) else ""
        say(f"interrupted{kept}")
        status = 130
    except BrokenPipeError:
        status = 0
    except OSError as error:
        failure, status = error, 2
    except SystemExit as stopped:
        # rich exits with 1 on a closed pipe; here 1 means a limit that failed.
        status = stopped.code if isinstance(stopped.code, int) and stopped.code != 1 else 0
    try:
        sys.stdout.flush()
    except OSError as error:
        # Discard the rest: Python would try to flush again at exit and report it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            status = 0
        else:
            failure, status = failure or error, 2
    if failure is not None:
        what = f"{failure.filename}: can't be read or" if failure.filename else "the output can't be"
        say(f"{what} written ({failure.strerror or failure})")
    sys.exit(status or 0)


def _reopen_closed_streams() -> None:
    """Redirect a closed stream (`>&-`) to the null device, so that no result file gets its file descriptor."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("r" if name == "stdin" else "w"))  # noqa: SIM115 - until the end
