"""How probable a claimed cause is, by its size and by what the model leaves."""

import pytest

from ehsa_ctrl.diagnosis.causes import LARGEST, SMALLEST, reliability


def test_a_larger_cause_is_more_probable_and_one_beside_a_larger_rest_less():
    sizes, rests = [1.0, 3.0, 10.0, LARGEST], [SMALLEST, 0.3, 1.0, 5.0]

    by_size = [reliability(size, 0.5) for size in sizes]
    by_rest = [reliability(5.0, rest) for rest in rests]

    assert by_size == sorted(set(by_size)) and by_rest == sorted(set(by_rest), reverse=True)


@pytest.mark.parametrize("factor", [1.0, 4.0, 30.0])
def test_of_a_huge_gap_the_share_that_is_left_counts(factor):
    """A cause of 20 thresholds that leaves one, and one of 600 that leaves 30, are as probable."""
    expected = reliability(LARGEST, 1.0)

    assert reliability(factor * LARGEST, factor) == pytest.approx(expected, rel=1e-12)
