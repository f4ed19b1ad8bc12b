"""What an unknown input goes along: its mean in bins."""

import numpy as np
import pytest

from ehsa_ctrl.diagnosis.regimes import Curve, Windows, regime_of


def test_what_goes_against_the_motion_has_a_mean_of_its_size():
    """Friction of 3 N turns over with the motion: along time its mean is none, times the motion's sign it is 3 N."""
    time = np.linspace(0.0, 10.0, 2000)
    sign = np.sign(np.sin(7.0 * time) + 1e-9)
    force = 3.0 * sign
    curve = Curve("force", "signed time", "time, against the motion", "s", time, force, 0.9, 8, sign=sign)
    plain = Curve("force", "time", "time", "s", time, force, 0.9, 8)

    assert regime_of(curve, force).mean == pytest.approx(3.0)
    assert regime_of(curve, force).sd == pytest.approx(0.0, abs=1e-12)
    assert np.abs(regime_of(plain, force).mean).max() < 2.0


def test_a_log_shorter_than_a_window_has_none():
    """Some samples at 5 Hz: nothing to average, and no error."""
    few = np.ones(20)

    assert Windows(few, 0.2, few > 0.0, longer=8).values.size == 0
