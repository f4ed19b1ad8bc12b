"""Threads that share simulations: the compiled engine releases Python's interpreter lock.

A computation of many simulations says once how many threads it may use (`sharing_threads`). Work that can be divided
takes those that are free when it begins: all of them at the outermost level, and within the work of a thread what the
other items leave idle.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from threading import Event, Lock
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class _Threads:
    """The threads of a computation. busy: those that work now. end: ends their simulations; a thread gets no interrupt.

    The thread that makes it is busy.
    """

    def __init__(self, jobs: int) -> None:
        self.jobs, self.busy = jobs, 1
        self.end, self._lock = Event(), Lock()

    @contextmanager
    def counted(self, change: int) -> Iterator[None]:
        """So many more busy threads."""
        with self._lock:
            self.busy += change
        try:
            yield
        finally:
            with self._lock:
                self.busy -= change


#: Those to which this thread belongs.
_threads: ContextVar[_Threads | None] = ContextVar("_threads", default=None)


@contextmanager
def sharing_threads(jobs: int) -> Iterator[None]:
    """Let the simulations of this block use so many threads together."""
    token = _threads.set(_Threads(jobs))
    try:
        yield
    finally:
        _threads.reset(token)


def free_threads(jobs: int | None = None) -> int:
    """Number of threads for a piece of work, this one included.

    Those that are free, and at least `jobs`; outside `sharing_threads` and `in_threads`, `jobs`, by default all cores.
    """
    threads = _threads.get()
    if threads is None:
        return jobs or os.cpu_count() or 1
    return max(jobs or 1, threads.jobs - threads.busy + 1)


def is_ended() -> bool:
    """Whether an interrupt or an error in another thread has ended the computation."""
    threads = _threads.get()
    return threads is not None and threads.end.is_set()


def in_threads(work: Callable[[Item], Result], items: Sequence[Item], jobs: int = 1) -> Iterator[Result]:
    """Results in the order of the items, see `free_threads`. An interrupt or an error ends the runs of all threads.

    Within work of such a thread it ends those of the outer threads too: iterate to the end, and catch no error.
    """
    threads = _threads.get() or _Threads(jobs)

    def counted(item: Item) -> Result:
        with threads.counted(1):
            return work(item)

    number = free_threads(jobs)
    # This thread waits.
    with threads.counted(-1), ThreadPoolExecutor(number, initializer=_threads.set, initargs=(threads,)) as pool:
        try:
            yield from pool.map(counted, items)
        except BaseException:
            threads.end.set()
            raise
