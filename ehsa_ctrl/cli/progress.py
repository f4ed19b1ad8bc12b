"""Progress on standard error, if that is a terminal."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from .output import note


class _Notice(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.INFO)

    def emit(self, record: logging.LogRecord) -> None:
        from rich.console import Console

        console = Console(stderr=True, highlight=False, markup=False)
        console.print(record.getMessage(), style="dim", soft_wrap=True)


class _Note(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.INFO)

    def emit(self, record: logging.LogRecord) -> None:
        note(record.getMessage())


@contextmanager
def _progress(*columns: Any) -> Iterator[Callable[..., None] | None]:
    """Update function of a progress line on standard error; None if that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    # The time left follows from the whole time so far: stages differ in length.
    with Progress(*columns, console=console, transient=True, speed_estimate_period=86400.0) as progress:
        yield partial(progress.update, progress.add_task("reading", total=None))


@contextmanager
def watching() -> Iterator[Callable[[Any], None] | None]:
    """Update function of a line with the state of a fit: stage, step, cost."""
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    with _progress(SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn()) as update:
        yield update and (lambda state: update(description=f"{state.stage}: step {state.step}, cost {state.cost:.4g}"))


@contextmanager
def counting() -> Iterator[Callable[[str, int, int], None] | None]:
    """Update function of a progress bar: (stage, done, total)."""
    with _progress() as update:
        yield update and (lambda stage, done, total: update(description=stage, completed=done, total=total))


@contextmanager
def _shown(name: str, handler: logging.Handler) -> Iterator[None]:
    """Give the messages of one module's logger to a handler."""
    logger = logging.getLogger(name)
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)


@contextmanager
def compiling() -> Iterator[None]:
    """Report the compilation of an engine on standard error; give Ctrl-C a message that the work is lost."""
    with _shown("ehsa_ctrl.core.compiled", _Notice()):
        try:
            yield
        except KeyboardInterrupt as stopped:
            raise KeyboardInterrupt(str(stopped) or "the unfinished work is not kept") from None


@contextmanager
def continuing(what: str, folder: Path | None, *records: Path) -> Iterator[None]:
    """Give Ctrl-C, wherever it comes, the message that what is finished is kept, once one of the records exists.

    what: plural of what is finished. folder: where it is kept; without records, None.
    """
    try:
        yield
    except KeyboardInterrupt as stopped:
        if not any(record.exists() for record in records):
            raise
        kept = f"finished {what} are kept in {folder}; the same command continues with the others"
        raise KeyboardInterrupt(kept) from stopped


@contextmanager
def reporting_user_code() -> Iterator[None]:
    """Report on standard error the effects, friction laws and systems that are loaded from a user's project."""
    with _shown("ehsa_ctrl.core.registry", _Note()):
        yield
