"""One short scenario that passes, one that fails and trips, made once for all tests of the report."""

import pytest

from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.scenario.definition import ScenarioFile
from ehsa_ctrl.scenario.run import Scenario, run

GENTLE = {
    "schema": 1,
    "title": "A small step & a push",
    "why": "The report needs a run that keeps its limits.",
    "plant": "ehsa",
    "controller": "pid_position",
    "duration": "0.8 s",
    "load": {"stiffness": "50 kN/m"},
    "reference": {"kind": "steps", "times": ["0.1 s"], "positions": ["5 mm"]},
    "disturbance": [{"force": "3 kN", "start": "0.5 s", "duration": "0.2 s"}],
    "sensors": {"seed": 7},
    "limits": {"Overshoot": {"max": "200 %"}, "MaxError": {"min": "1 mm", "max": "20 mm"}},
}
HARSH = GENTLE | {
    "title": "A step that no pump can follow",
    "why": "The report needs a run that fails.",
    "settings": {"P_0": "2 bar"},
    "reference": {"kind": "steps", "times": ["0.1 s"], "positions": ["95 mm"]},
    "limits": {"MaxError": {"max": "1 mm"}},
    "expect_trips": ["pressure_min", "stroke"],
}


def result_of(name, content):
    return run(Scenario(name, validate(content, ScenarioFile, name)))


@pytest.fixture(scope="session")
def gentle():
    """Passes its limits and those of the plant."""
    return result_of("gentle", GENTLE)


@pytest.fixture(scope="session")
def harsh():
    """Fails a limit, passes limits of the plant, and misses a trip that it expects."""
    return result_of("harsh", HARSH)
