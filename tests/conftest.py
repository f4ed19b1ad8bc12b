"""What all tests share: strict floating point, plants, and the folder of shared logs where there is one."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

import ehsa_ctrl

# A first draw may import or compile, and machines are shared: how long an example takes says nothing about it.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")

SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_configure(config):
    """Compile the simulation loops before the workers of `-n` start, side by side, so that no test waits for them."""
    if not getattr(config.option, "numprocesses", None) or hasattr(config, "workerinput"):
        return
    loops = [f"import ehsa_ctrl.simulation.{name}_kernel" for name in ("open_loop", "sensitivity", "closed_loop")]
    # The first one compiles what the two others share.
    for together in (loops[:1], loops[1:]):
        started = [subprocess.Popen([sys.executable, "-c", program]) for program in together]
        for process in started:
            process.wait()


@pytest.fixture(autouse=True)
def _strict_floating_point():
    """Overflow, division by zero and invalid operations in numpy are errors; underflow to zero is not."""
    with np.errstate(all="raise", under="ignore"):
        yield


@pytest.fixture
def plant():
    """The paper's nonlinear plant, unloaded."""
    return ehsa_ctrl.load_plant("ehsa")


@pytest.fixture
def linear():
    """The paper's linear plant, unloaded."""
    return ehsa_ctrl.load_plant("ehsa", model="linear")


@pytest.fixture
def shared():
    """The folder of shared data, where there is one."""
    if not SHARED.is_dir():
        pytest.skip("the shared data are not here")
    return SHARED


@pytest.fixture
def shared_logs():
    """Folder of the labelled logs; the test is skipped where it is absent."""
    folder = SHARED / "logs" / "labelled"
    if not folder.is_dir():
        pytest.skip("the shared logs are not here")
    return folder
