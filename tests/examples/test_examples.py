"""Every example runs and passes its own checks."""

import subprocess
import sys
from pathlib import Path

import pytest

# build_notebooks.py is not an example; test_notebooks.py checks it.
EXAMPLES = [
    example
    for example in sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))
    if example.stem != "build_notebooks"
]
SLOW = {"design_script", "paper_figures"}


@pytest.mark.parametrize(
    "example",
    [pytest.param(one, id=one.stem, marks=[pytest.mark.slow] if one.stem in SLOW else []) for one in EXAMPLES],
)
def test_an_example_runs(example, tmp_path):
    """Exit status 0 (an example checks its own statements), figures in the folder it is given."""
    done = subprocess.run(
        [sys.executable, str(example), str(tmp_path / "out")], cwd=tmp_path, capture_output=True, text=True, check=False
    )

    assert done.returncode == 0, done.stdout + done.stderr
    assert list((tmp_path / "out").glob("*.png"))
