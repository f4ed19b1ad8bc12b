"""Work handed out to threads or processes: all of it comes back, as soon as it is there, until somebody stops."""

import time
from contextlib import closing
from math import sqrt

import pytest

from ehsa_ctrl.core.parallel import as_done, workers


@pytest.mark.parametrize("backend", ["threading", "loky"])
@pytest.mark.parametrize("jobs", [1, 2])
def test_every_result_comes_once(backend, jobs):
    todo = [float(k) for k in range(20)]

    with workers(backend, jobs) as count:
        found = list(as_done(sqrt, todo, count=count))

    assert sorted(found) == [sqrt(value) for value in todo]


def test_what_is_short_comes_first():
    """Nobody waits for a long piece of work that was begun earlier."""

    def wait(seconds):
        time.sleep(seconds)
        return seconds

    with workers("threading", 2) as count:
        found = list(as_done(wait, [0.5, 0.01, 0.02], count=count))

    assert found == [0.01, 0.02, 0.5]


@pytest.mark.parametrize("backend", ["threading", "loky"])
def test_a_stop_ends_the_work(backend):
    """An interrupt passes through, without a warning, and what was not begun stays undone: that would take 20 s."""
    begun = time.monotonic()

    with pytest.raises(KeyboardInterrupt):
        _interrupted(backend)

    assert time.monotonic() - begun < 15.0


def _interrupted(backend):
    with workers(backend, 2) as count, closing(as_done(time.sleep, [0.2] * 200, count=count)) as results:
        next(results)
        raise KeyboardInterrupt
