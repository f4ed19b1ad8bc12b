"""Every kind of controller runs every scenario of the EHSA."""

from pathlib import Path

import numpy as np
import pytest

from ehsa_ctrl.core.catalogue import scenarios
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.specification import starting_definition
from ehsa_ctrl.scenario.prepare import prepare, with_drive_of

#: The example of a kind, where it is not the one that `design` starts from.
EXAMPLES = {
    "pid": "pid_tuned",
    "scheduled_pid": "pid_scheduled",
    "cascade": "cascade_friction",
    "adrc": "adrc_friction",
    "sliding_mode": "sliding_friction",
    "lqr": "lqr_friction",
    "mpc": "mpc_friction",
}
NAMES = with_drive_of(sorted(path.stem for path in Path(scenarios.folders[-1]).glob("*.toml")), "ehsa", [])


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(CONTROLLER_KINDS))
def test_every_kind_runs_every_scenario(kind):
    """On the nonlinear plant to its end or to a limit of the plant, with finite currents and metrics.

    Failing a limit of the scenario is allowed. Each scenario's file is a test too, which has the linear prediction.
    """
    controller = EXAMPLES.get(kind) or starting_definition(kind)[1].stem
    for name in NAMES:
        case = prepare(name, controller=controller)
        loop = case.simulate(case.nonlinear)

        assert np.isfinite(loop.asked).all(), name
        assert np.isfinite(case.metrics(loop)["CurrentRMS"]), name
