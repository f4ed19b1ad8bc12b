"""What tests of the diagnosis share."""

import numpy as np
import pytest


@pytest.fixture
def rng():
    """Noise with a seed."""
    return np.random.default_rng(5)
