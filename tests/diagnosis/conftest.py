"""What tests of the diagnosis share."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Segment


@pytest.fixture
def rng():
    """Noise with a seed."""
    return np.random.default_rng(5)


@pytest.fixture(scope="session")
def carriage_segments():
    """Training and held-out data of a carriage whose nominal mass is 40 % too large and that follows late, by the time
    [s] by which it does."""

    def segments(late=0.0):
        rig = ehsa_ctrl.load_plant("emps")
        time = np.arange(0.0, 9.0, 0.004)
        force = 75.0 * np.sin(2.0 * np.pi * 0.9 * time) * np.where(np.sin(2.0 * np.pi * 0.17 * time) > 0.0, 1.0, 0.6)
        run = ehsa_ctrl.simulate(rig, force, hold="first_order", sample_time=0.004)
        position = np.interp(time - late, time, run["x"]) + 1e-6 * np.random.default_rng(0).standard_normal(time.size)
        log = ehsa_ctrl.Log(time, {"drive_force": force, "position": position})
        prepared = prepare_logs(rig.set(M=1.4 * rig["M"]), [log], None, 0.03, check=True)
        return split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True)

    return segments
