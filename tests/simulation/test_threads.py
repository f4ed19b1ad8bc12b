"""The threads that share the simulations of a computation."""

import os
import threading

import pytest

from ehsa_ctrl.simulation.threads import free_threads, in_threads, sharing_threads


def test_alone_a_batch_has_all_cores_or_what_it_asks_for():
    assert free_threads() == (os.cpu_count() or 1)
    assert free_threads(3) == 3


def test_a_computation_has_the_threads_that_it_was_given():
    with sharing_threads(5):
        assert free_threads() == free_threads(1) == 5
        assert free_threads(7) == 7

    assert free_threads(1) == 1


def test_work_takes_the_threads_that_the_other_items_leave_idle():
    """Three threads: with three items at work each has its own; the last one at work has all three."""
    all_at_work, others_done = threading.Barrier(3), threading.Semaphore(0)

    def work(item):
        all_at_work.wait(10.0)
        first = free_threads(1)
        all_at_work.wait(10.0)
        if item == "long":
            while free_threads(1) < 3:
                others_done.acquire(timeout=0.01)
            # It waits for its own items, and does not count as busy.
            return first, list(in_threads(lambda _: free_threads(1), ["only"]))
        return first, []

    with sharing_threads(3):
        found = list(in_threads(work, ["long", "short", "short"]))

    assert found == [(1, [3]), (1, []), (1, [])]


def test_after_an_error_all_threads_are_free_again():
    def fail(_):
        raise ValueError("as expected")

    with sharing_threads(2):
        with pytest.raises(ValueError, match="as expected"):
            list(in_threads(fail, [1, 2]))

        assert free_threads(1) == 2
