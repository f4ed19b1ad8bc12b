"""Progress on standard error, for people: nothing is shown where it is no terminal."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class _Notice(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.INFO)

    def emit(self, record: logging.LogRecord) -> None:
        from rich.console import Console

        console = Console(stderr=True, highlight=False, markup=False)
        console.print(record.getMessage(), style="dim", soft_wrap=True)


@contextmanager
def watching() -> Iterator[Callable[[Any], None] | None]:
    """A line on standard error that says where a fit is: stage, step, cost. None where that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("reading", total=None)

        def watch(state: Any) -> None:
            progress.update(task, description=f"{state.stage}: step {state.step}, cost {state.cost:.4g}")

        yield watch


@contextmanager
def counting() -> Iterator[Callable[[str, int, int], None] | None]:
    """A bar on standard error, a stage at a time. None where that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("reading", total=None)

        def watch(stage: str, done: int, total: int) -> None:
            progress.update(task, description=stage, completed=done, total=total)

        yield watch


@contextmanager
def compiling() -> Iterator[None]:
    """Say on standard error when an engine has to be compiled first, so that nobody wonders at a slow first run.

    Ctrl-C in this work says that it is lost, where it is not said otherwise.
    """
    logger = logging.getLogger("ehsa_ctrl.core.compiled")
    handler = _Notice()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    except KeyboardInterrupt as stopped:
        raise KeyboardInterrupt(str(stopped) or "what was begun is not kept") from None
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
