"""Work handed out to threads or processes: all of it comes back, as soon as it is there, until somebody stops."""

import threading
import time
from contextlib import closing
from math import sqrt

import joblib
import pytest
from joblib.parallel import ThreadingBackend
from threadpoolctl import threadpool_info, threadpool_limits

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.parallel import as_completed, in_rounds, one_blas_thread, parallel_backend, worker_count


@pytest.mark.parametrize("backend", ["threading", "loky"])
@pytest.mark.parametrize("jobs", [1, 2])
def test_every_result_comes_once(backend, jobs):
    todo = [float(k) for k in range(20)]

    with parallel_backend(backend):
        found = list(as_completed(sqrt, todo, count=jobs))

    assert sorted(found) == [sqrt(value) for value in todo]


def test_what_is_short_comes_first():
    """Nobody waits for a long piece of work that was begun earlier."""

    def wait(seconds):
        time.sleep(seconds)
        return seconds

    found = list(as_completed(wait, [0.5, 0.01, 0.02], count=2, prefer="threads"))

    assert found == [0.01, 0.02, 0.5]


@pytest.mark.parametrize("backend", ["threading", "loky"])
def test_a_stop_ends_the_work(backend):
    """An interrupt passes through, without a warning, and what was not begun stays undone: that would take 20 s."""
    begun = time.monotonic()

    with pytest.raises(KeyboardInterrupt):
        _interrupted(backend)

    assert time.monotonic() - begun < 15.0


def _interrupted(backend):
    with parallel_backend(backend), closing(as_completed(time.sleep, [0.2] * 200, count=2)) as results:
        next(results)
        raise KeyboardInterrupt


def test_the_context_of_joblib_is_used():
    """Workers and backend of a surrounding `parallel_config` hold where nothing else is asked for."""
    assert worker_count(None) == 1
    with joblib.parallel_config(backend="threading", n_jobs=3):
        assert worker_count(None) == 3 and worker_count(2) == 2
        names = set(as_completed(lambda _: threading.current_thread().name, range(20), count=2))

    assert "MainThread" not in names


@pytest.mark.parametrize("generator", [True, False])
def test_a_registered_backend_is_used(generator, monkeypatch):
    """A backend that the user registered with joblib does the work, with and without results in order of completion."""

    class Registered(ThreadingBackend):
        supports_return_generator = generator
        submitted = 0

        def submit(self, func, callback=None):
            Registered.submitted += 1
            return super().submit(func, callback)

    monkeypatch.setattr("joblib.parallel.BACKENDS", dict(joblib.parallel.BACKENDS))
    joblib.register_parallel_backend("registered", Registered)
    todo = [float(k) for k in range(8)]
    with joblib.parallel_config(backend="registered", n_jobs=2):
        count = worker_count(None)
        completed = list(as_completed(sqrt, todo, count=count))
        rounds = list(in_rounds(lambda part: [sqrt(x) for x in part], todo, count=count, chunk=2, prefer="threads"))

    assert count == 2 and Registered.submitted > 0
    assert sorted(completed) == [x for part in rounds for x in part] == [sqrt(value) for value in todo]


def test_an_unknown_backend_is_refused():
    with pytest.raises(InputError, match="backend 'slurm' is not known"):
        parallel_backend("slurm")


def test_the_limit_of_blas_ends_with_the_last_call():
    """One thread as long as any call needs it, whichever ends first; then the number that the user had."""

    def threads():
        return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    # A library may be built for a single thread, as that of SCS is; those of NumPy and SciPy follow.
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        first, second = one_blas_thread(), one_blas_thread()
        first.__enter__()
        second.__enter__()
        within = threads()
        first.__exit__(None, None, None)
        still = threads()
        second.__exit__(None, None, None)

        assert set(within.values()) == {1} and still == within
        assert threads() == before
        assert all(number == 2 for path, number in before.items() if "scipy_openblas" in path)
        assert 2 in before.values()
