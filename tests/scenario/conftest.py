"""Short scenarios for all tests of this folder."""

import pytest

from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.scenario.definition import Scenario, ScenarioFile

SHORT = """\
schema = 1
title = "A short move"
why = "Tests need a run that takes little time."
plant = "ehsa"
controller = "pid_position"
duration = "1.2 s"

[load]
stiffness = "50 kN/m"

[reference]
kind = "moves"
times = ["0.1 s"]
positions = ["5 mm"]
durations = ["0.3 s"]
"""
LIMITS = '\n[limits]\nMaxError = { max = "3 mm" }\n'


@pytest.fixture
def project(tmp_path):
    """A user's own project: a folder `scenarios`; call it with a name and what is to stand below the short move."""
    folder = tmp_path / "scenarios"
    folder.mkdir()

    def write(name="short", add=LIMITS, replace=("", "")):
        path = folder / f"{name}.toml"
        path.write_text(SHORT.replace(*replace) + add)
        return path

    return write


@pytest.fixture
def short():
    """The short move as a loaded scenario, with more content or other."""

    def make(**more):
        import tomllib

        content = tomllib.loads(SHORT) | more
        return Scenario("short", validate(content, ScenarioFile, "short"))

    return make
