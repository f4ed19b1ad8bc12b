"""Words for a rig whose rod another machine moves: the combinations of velocity and current that its logs lack."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.moved_rod_experiment import missing_combinations

SYSTEM = ehsa_ctrl.load_plant("mbari_pto").structure.system
LEVELS = [(v, i) for v in (-0.4, -0.2, 0.2, 0.4) for i in (-10.0, 0.0, 10.0)]


def held(levels, seconds=2.0, dt=0.02):
    """A log that holds each pair of velocity and current for some seconds."""
    v, current = np.repeat(np.array(levels), int(seconds / dt), axis=0).T
    return Log(dt * np.arange(v.size), {"velocity": v, "current": current})


def test_what_a_log_lacks_is_named_with_numbers():
    """All combinations but one."""
    words = missing_combinations(SYSTEM, [held([pair for pair in LEVELS if pair != (0.4, -10.0)])])

    assert words.endswith("hold +0.4 m/s with -10 A")


def test_a_current_that_follows_the_velocity_is_said_with_its_correlation():
    words = missing_combinations(SYSTEM, [held([(v, 25.0 * v) for v in (-0.4, -0.2, 0.2, 0.4)])])

    assert "correlation in motion is 1.00" in words and "-0.4 m/s with 0 A" in words


@pytest.mark.parametrize("logs", [[held(LEVELS)], [held(LEVELS[:6]), held(LEVELS[6:])]])
def test_logs_that_have_all_combinations_need_none(logs):
    """In one log or in two."""
    assert "all combinations of their levels are there" in missing_combinations(SYSTEM, logs)
