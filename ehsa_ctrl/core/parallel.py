"""Work in parallel with joblib, on the backend of joblib's own context.

    with joblib.parallel_config(backend="threading", n_jobs=8):
        monte_carlo("spread_steps")

Without such a context the work runs on this machine, in threads or processes as the caller prefers.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, Literal, TypeVar

from .errors import InputError, choices

#: joblib's backends on this machine: processes and threads.
BACKENDS = ("loky", "threading")
Prefer = Literal["threads", "processes"]
T = TypeVar("T")
R = TypeVar("R")


_blas_lock = threading.Lock()
#: Calls within `one_blas_thread`, and the limit that the first of them has set.
_blas_calls = 0
_blas_limit: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread in this process, also as a decorator; the last call to leave restores the user's number.

    Matrices are small here: threads of BLAS would mostly wait for each other, all the more on a busy machine.
    """
    global _blas_calls, _blas_limit
    from threadpoolctl import threadpool_limits

    with _blas_lock:
        if _blas_calls == 0:
            _blas_limit = threadpool_limits(1, user_api="blas")
        _blas_calls += 1
    try:
        yield
    finally:
        with _blas_lock:
            _blas_calls -= 1
            if _blas_calls == 0:
                _blas_limit.restore_original_limits()


def worker_count(jobs: int | None) -> int:
    """Number of workers for `jobs` in joblib's context: -1 for all, None for the context's own, else 1.

    Raises InputError for a number that makes no sense.
    """
    from joblib import effective_n_jobs

    if jobs is not None and (jobs == 0 or jobs < -1):
        raise InputError(f"jobs = {jobs}: expected 1 or more, or -1 for all")
    return int(effective_n_jobs(jobs))


def parallel_backend(name: str | None) -> AbstractContextManager[Any]:
    """joblib's context for a backend of this machine, one of BACKENDS; None leaves the surrounding context as it is.

    Raises InputError for an unknown backend.
    """
    from joblib import parallel_config

    if name is None:
        return nullcontext()
    if name not in BACKENDS:
        raise InputError(f"backend {name!r} is not known; {choices(name, BACKENDS)}")
    return parallel_config(backend=name)


def in_rounds(
    work: Callable[[Sequence[T]], list[R]], todo: Sequence[T], *, count: int, chunk: int, prefer: Prefer
) -> Iterator[list[R]]:
    """Results of `work` on chunks of `todo`, a round of chunks at a time, so that finished results can be saved.

    count: workers, see `worker_count`; with one the work is done here and now.
    """
    from joblib import Parallel, delayed

    chunks = [todo[first : first + chunk] for first in range(0, len(todo), chunk)]
    if count == 1:
        yield from (work(part) for part in chunks)
        return
    width = 4 * count
    for first in range(0, len(chunks), width):
        tasks = (delayed(work)(part) for part in chunks[first : first + width])
        found: list[list[R]] = Parallel(count, prefer=prefer)(tasks)
        yield [result for part in found for result in part]


def as_completed(
    work: Callable[[T], R], todo: Sequence[T], *, count: int, prefer: Prefer = "processes"
) -> Generator[R, None, None]:
    """Result of `work` on each of `todo` as soon as it is there, in order of completion; for work that takes long.

    count: workers, see `worker_count`; with one the work is done here and now, in order. A backend that can't return
    results in order of completion gives them a round at a time. Close the generator (contextlib.closing) to stop
    before the end.
    """
    from joblib import Parallel, delayed
    from joblib.parallel import get_active_backend

    if count == 1:
        yield from (work(one) for one in todo)
        return
    if not get_active_backend()[0].supports_return_generator:
        for first in range(0, len(todo), count):
            yield from Parallel(count, prefer=prefer)(delayed(work)(one) for one in todo[first : first + count])
        return
    parallel = Parallel(count, prefer=prefer, return_as="generator_unordered", pre_dispatch=count, batch_size=1)
    results: Generator[R, None, None] = parallel(delayed(work)(one) for one in todo)
    try:
        # Not "yield from", which would close the results before the warning is held back.
        for result in results:  # noqa: UP028
            yield result
    finally:
        with warnings.catch_warnings():
            # joblib warns of unfinished tasks; the caller stopped on purpose.
            warnings.simplefilter("ignore", UserWarning)
            results.close()
