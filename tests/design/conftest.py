"""What tests of design share: the paper's linear model, and the model that state feedback is designed on."""

import pytest

from ehsa_ctrl import three_state
from ehsa_ctrl.design.state_space.model import design_model


@pytest.fixture
def system(linear):
    return three_state(linear)


@pytest.fixture
def model(system):
    return design_model(system, 0.004)
