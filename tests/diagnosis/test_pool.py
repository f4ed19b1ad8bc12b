"""Threads of a diagnosis: progress over all stages, and an end of all runs at an error or interrupt."""

import threading

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.pool import STEPS, Pool
from ehsa_ctrl.simulation.threads import sharing_threads


def test_progress_never_goes_back_and_keeps_to_its_phases():
    """Whatever the number of stages: the first phase, of 0.6, ends before the second one begins."""
    told = []
    pool = Pool(lambda *arguments: told.append(arguments))
    ends = []
    with sharing_threads(2):
        for share in (0.6, 0.4):
            pool.progress.begin(share)
            for _ in range(12):
                pool.map("stage", abs, range(5))
            ends.append(told[-1][1])

    done = [steps for _, steps, _ in told]
    assert len(told) == 120 and {total for _, _, total in told} == {STEPS}
    assert done == sorted(done)
    assert ends[0] == pytest.approx(0.6 * STEPS, abs=0.03 * STEPS) and ends[0] <= 0.6 * STEPS
    assert ends[1] <= STEPS


def test_the_largest_item_begins_first_and_results_keep_their_order():
    begun = []

    def work(item):
        begun.append(item)
        return -item

    assert Pool().map("stage", work, [2, 9, 4], lambda item: item) == [-2, -9, -4]
    assert begun == [9, 4, 2]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_error_ends_the_simulations_of_all_threads(error):
    """A run of three hours of plant time, begun before the error, ends unfinished; so does one begun after it."""
    plant = ehsa_ctrl.load_plant("ehsa")
    current = np.sin(np.arange(2_500_000) / 50.0)
    started, found = threading.Event(), []

    def simulate(length):
        # Two runs in two threads of their own, which end with those of the pool.
        both = np.vstack([plant.vector, plant.vector])
        return int(ehsa_ctrl.simulate_batch(plant, both, current[:length], jobs=2).status.max())

    def work(item):
        if item == "fail":
            started.wait()
            raise error
        started.set()
        found.extend([simulate(None), simulate(100_000)])

    with pytest.raises(error), sharing_threads(2):
        Pool().map("stage", work, ["fail", "simulate"])

    assert 0 not in found and len(found) == 2
    # Later runs, of this thread and of other ones, are complete.
    assert simulate(100) == 0 and Pool().map("stage", simulate, [100]) == [0]
