"""The same work on one core, on all, or on a cluster: joblib with the backend that is asked for."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, TypeVar

from .errors import InputError, choices

BACKENDS = ("loky", "threading", "dask", "ray")
T = TypeVar("T")
R = TypeVar("R")


@contextmanager
def workers(backend: str = "loky", jobs: int = 1, address: str | None = None) -> Iterator[int]:
    """Within it joblib's Parallel uses this backend; gives how many workers there are.

    Parameters
    ----------
    backend: processes ("loky") or threads ("threading") of this machine; a Dask or Ray cluster.
    jobs: how many; -1 for every core, or all that the cluster has.
    address: of the cluster's scheduler; without one a local cluster is started for the time being.

    Raises
    ------
    InputError: an unknown backend, one that is not installed, a cluster that doesn't answer, an address without one.
    """
    from joblib import effective_n_jobs, parallel_config

    if backend not in BACKENDS:
        raise InputError(f"backend {backend!r} is not known; {choices(backend, BACKENDS)}")
    if address is not None and backend not in ("dask", "ray"):
        raise InputError(f"an address ({address}) goes with the backend dask or ray, not with {backend}")
    if jobs == 0 or jobs < -1:
        raise InputError(f"jobs = {jobs}: expected 1 or more, or -1 for all")
    with ExitStack() as stack:
        if backend == "dask":
            stack.enter_context(_dask(jobs, address))
        elif backend == "ray":
            stack.enter_context(_ray(jobs, address))
        stack.enter_context(parallel_config(backend=backend, n_jobs=jobs))
        yield int(effective_n_jobs(jobs))


def in_rounds(
    work: Callable[[Sequence[T]], list[R]], todo: Sequence[T], *, count: int, chunk: int
) -> Iterator[list[R]]:
    """Results of `work` on chunks of `todo`, a round of chunks at a time, so that what is done can be kept.

    count: workers, as `workers` gives it; with one the work is done here and now.
    """
    from joblib import Parallel, delayed

    chunks = [todo[first : first + chunk] for first in range(0, len(todo), chunk)]
    if count == 1:
        yield from (work(part) for part in chunks)
        return
    width = 4 * count
    for first in range(0, len(chunks), width):
        found: list[list[R]] = Parallel()(delayed(work)(part) for part in chunks[first : first + width])
        yield [result for part in found for result in part]


def as_done(work: Callable[[T], R], todo: Sequence[T], *, count: int) -> Generator[R, None, None]:
    """Result of `work` on each of `todo` as soon as it is there, in whatever order that is; for work that takes long.

    count: workers, as `workers` gives it; with one the work is done here and now, in order. Ray gives its results a
    round at a time. Close it (contextlib.closing) to stop before the end.
    """
    from joblib import Parallel, delayed
    from joblib.parallel import get_active_backend

    if count == 1:
        yield from (work(one) for one in todo)
        return
    if not get_active_backend()[0].supports_return_generator:
        for first in range(0, len(todo), count):
            yield from Parallel()(delayed(work)(one) for one in todo[first : first + count])
        return
    parallel = Parallel(return_as="generator_unordered", pre_dispatch=count, batch_size=1)
    results: Generator[R, None, None] = parallel(delayed(work)(one) for one in todo)
    try:
        # Not "yield from", which would close the results before the warning is held back.
        for result in results:  # noqa: UP028
            yield result
    finally:
        with warnings.catch_warnings():
            # Whoever stops early knows that something is not done.
            warnings.simplefilter("ignore", UserWarning)
            results.close()


@contextmanager
def _dask(jobs: int, address: str | None) -> Iterator[None]:
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("the backend dask is not installed; pip install 'ehsa_ctrl[cluster]'") from None
    connect: Any = Client
    if address is None:
        size = os.cpu_count() if jobs == -1 else jobs
        local: Any = LocalCluster
        with local(n_workers=size, threads_per_worker=1, dashboard_address=None) as cluster, connect(cluster):
            yield
        return
    try:
        client = connect(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {address} ({error})") from None
    with client:
        yield


@contextmanager
def _ray(jobs: int, address: str | None) -> Iterator[None]:
    try:
        import ray
        from ray.util.joblib import register_ray
    except ImportError:
        raise InputError("the backend ray is not installed; pip install 'ehsa_ctrl[cluster]'") from None
    given: dict[str, Any] = {"address": address} if address else {"num_cpus": None if jobs == -1 else jobs}
    try:
        ray.init(**given, log_to_driver=False)
    except (ConnectionError, ValueError) as error:
        raise InputError(f"no Ray cluster answers at {address} ({error})") from None
    register_ray()
    try:
        yield
    finally:
        ray.shutdown()
