"""Progress on standard error, for people: nothing is shown where it is no terminal."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager


class _Notice(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.INFO)

    def emit(self, record: logging.LogRecord) -> None:
        from rich.console import Console

        Console(stderr=True, highlight=False).print(record.getMessage(), style="dim")


@contextmanager
def compiling() -> Iterator[None]:
    """Say on standard error when an engine has to be compiled first, so that nobody wonders at a slow first run."""
    logger = logging.getLogger("ehsa_ctrl.simulation.compiled")
    handler = _Notice()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
