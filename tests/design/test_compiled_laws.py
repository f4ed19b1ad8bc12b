"""The law of every kind of controller is one text, in Python and compiled."""

import numpy as np
import pytest

from ehsa_ctrl import load_controller, run_closed_loop
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.specification import starting_definition


@pytest.mark.parametrize("kind", sorted(CONTROLLER_KINDS))
def test_plain_and_compiled_law_are_the_same(plant, system, kind):
    """To the bit, on a step that most laws answer with their largest current."""
    chosen = load_controller(starting_definition(kind)[1], system, sample_time=plant.sample_time)
    if chosen.compiled is None:
        pytest.skip("the solver of this law is not compiled")
    reference = np.zeros((150, 4 if chosen.follows_force else 3))
    reference[5:, 0] = 0.02
    reference[50:, 3:] = 2e3

    plain, fast = (run_closed_loop(plant, chosen, reference, compiled=way) for way in (False, True))

    assert np.ptp(fast.asked) > 1.0
    np.testing.assert_array_equal(plain.asked, fast.asked)
    for name, values in plain.traces.items():
        np.testing.assert_array_equal(values, fast.traces[name])
