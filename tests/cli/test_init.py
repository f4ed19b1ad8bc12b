"""`ehsa-ctrl init`: a project that passes its own tests."""

import json
import subprocess
import sys

import nbformat
import pytest
from nbclient import NotebookClient


def test_every_file_is_there_and_nothing_is_replaced(run, tmp_path):
    status, out, _ = run("init", "press", "--json")
    written = json.loads(out)["written"]
    assert status == 0
    folders = {"plants", "controllers", "scenarios", "effects", "tests", ".github"}
    assert {name.split("/")[1] for name in written} >= folders
    assert all((tmp_path / name).is_file() for name in written)
    plant = tmp_path / "press/plants/rig.toml"
    plant.write_text("mine", encoding="utf-8")

    status, _, error = run("init", "press")

    assert status == 2
    assert "press/plants/rig.toml exists" in error
    assert plant.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(("base", "words"), [("emps", "of the system 'ehsa'"), ("esha", "did you mean 'ehsa'")])
def test_a_plant_that_does_not_fit_leaves_no_file(run, tmp_path, base, words):
    status, _, error = run("init", "--from", base)
    assert status == 2
    assert words in error
    assert not [*tmp_path.iterdir()]


@pytest.mark.slow
def test_its_tests_pass_and_its_notebook_runs(run, tmp_path):
    assert run("init")[0] == 0
    tests = subprocess.run([sys.executable, "-m", "pytest", "-p", "no:cacheprovider"], capture_output=True, text=True)
    assert tests.returncode == 0, tests.stdout
    assert "4 passed" in tests.stdout

    notebook = nbformat.read(tmp_path / "notebook.ipynb", as_version=4)
    nbformat.validate(notebook)
    NotebookClient(notebook, timeout=300, kernel_name="python3").execute()

    printed = [str(output) for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("internal_leakage" in text for text in printed)
