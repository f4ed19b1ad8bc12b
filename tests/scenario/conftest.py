"""Short scenarios for all tests of this folder."""

import pytest
from short_move import LIMITS
from short_move import SHORT as FREE

from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.scenario.definition import Scenario, ScenarioFile

SHORT = FREE + '\n[load]\nstiffness = "50 kN/m"\n'


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
