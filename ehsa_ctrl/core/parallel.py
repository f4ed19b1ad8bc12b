"""Work in parallel with joblib, on the backend of joblib's own context.

    with joblib.parallel_config(backend="dask"):
        monte_carlo("spread_steps", jobs=-1)

Without such a context the work runs on this machine, in threads or processes as the caller prefers.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Literal, TypeVar

from .errors import InputError, choices

BACKENDS = ("loky", "threading", "dask", "ray")
Prefer = Literal["threads", "processes"]
T = TypeVar("T")
R = TypeVar("R")


def worker_count(jobs: int | None) -> int:
    """Number of workers for `jobs` in joblib's context: -1 for all, None for the context's own, else 1.

    Raises InputError for a number that makes no sense.
    """
    from joblib import effective_n_jobs

    if jobs is not None and (jobs == 0 or jobs < -1):
        raise InputError(f"jobs = {jobs}: expected 1 or more, or -1 for all")
    return int(effective_n_jobs(jobs))


@contextmanager
def parallel_backend(name: str | None, address: str | None = None) -> Iterator[None]:
    """joblib's context for a backend, with a connection to its cluster; None leaves the context as it is.

    Parameters
    ----------
    name: processes ("loky") or threads ("threading") of this machine; a Dask or Ray cluster.
    address: of the cluster's scheduler; without one a local cluster runs for the duration of the context.

    Raises
    ------
    InputError: an unknown backend, one that is not installed, a cluster that doesn't answer, an address without one.
    """
    from joblib import parallel_config

    if name is not None and name not in BACKENDS:
        raise InputError(f"backend {name!r} is not known; {choices(name, BACKENDS)}")
    if address is not None and name not in ("dask", "ray"):
        raise InputError(f"an address ({address}) goes with the backend dask or ray, not with {name}")
    with ExitStack() as stack:
        if name in ("dask", "ray"):
            try:
                stack.enter_context(_dask(address) if name == "dask" else _ray(address))
            except ImportError:
                raise InputError(f"the backend {name} is not installed; pip install 'ehsa_ctrl[cluster]'") from None
            except (OSError, ValueError) as error:
                raise InputError(f"no {name.capitalize()} scheduler answers at {address} ({error})") from None
        if name is not None:
            stack.enter_context(parallel_config(backend=name))
        yield


def _dask(address: str | None) -> Any:
    from distributed import Client

    connect: Any = Client
    return connect(address, timeout="10s") if address else connect(threads_per_worker=1, dashboard_address=None)


def _ray(address: str | None) -> Any:
    import ray
    from ray.util.joblib import register_ray

    register_ray()
    return ray.init(address=address, log_to_driver=False)


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

    count: workers, see `worker_count`; with one the work is done here and now, in order. Ray gives its results a
    round at a time. Close the generator (contextlib.closing) to stop before the end.
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
