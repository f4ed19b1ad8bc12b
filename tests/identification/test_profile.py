"""Profile likelihood beside the deviations from the information."""

import pytest

from ehsa_ctrl import InputError
from ehsa_ctrl.identification.refits import profile


@pytest.mark.slow
def test_the_profile_of_a_well_determined_parameter_is_a_parabola(from_truth):
    """One, two, three deviations raise the cost by one, four, nine, and the interval is that of the deviation."""
    line = profile(from_truth, "A_FR")

    assert line.rise == pytest.approx([9, 4, 1, 1, 4, 9], rel=0.1)
    assert line.interval == pytest.approx(from_truth["A_FR"].interval, abs=0.1 * from_truth["A_FR"].sd)


def test_what_has_no_profile(found):
    """A parameter that was not estimated has none."""
    with pytest.raises(InputError, match="K_T was not estimated"):
        profile(found, "K_T")
