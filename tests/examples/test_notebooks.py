"""Every notebook runs from its first cell to its last, and stores the outputs of such a run."""

import re
import runpy
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))
IDS = [notebook.stem for notebook in NOTEBOOKS]


def _code(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def _words(cell):
    """All text outputs of a cell."""
    for output in cell.outputs:
        shown = output.get("data", {})
        yield from (output.get("text", ""), shown.get("text/plain", ""), shown.get("text/html", ""))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning:zmq.*", "ignore::DeprecationWarning:jupyter_client.*")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_a_notebook_runs(path, tmp_path):
    """No cell raises, warns or writes to the error stream; notebooks assert their own statements."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": tmp_path}})

    client.execute()

    for cell in _code(notebook):
        assert not [output for output in cell.outputs if output.get("name") == "stderr"], cell.source


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_a_notebook_is_stored_as_executed(path):
    """Every cell is executed once from top to bottom, without error and with figures."""
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = _code(notebook)

    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert not [output for cell in code for output in cell.outputs if output.output_type == "error"]
    assert any("image/png" in output.get("data", {}) for cell in code for output in cell.outputs)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_a_notebook_names_no_machine(path):
    """Outputs contain no absolute path, metadata no time of execution."""
    notebook = nbformat.read(path, as_version=4)

    shown = "\n".join(words for cell in _code(notebook) for words in _words(cell))

    assert not re.search(r"/(home|root|tmp|work|Users|usr|opt)/|[A-Z]:\\", shown)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert set(notebook.metadata.kernelspec) <= {"name", "display_name", "language"}
    assert notebook.metadata.language_info == {"name": "python"}
    assert not [cell for cell in notebook.cells if "execution" in cell.metadata]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_a_notebook_uses_public_names_alone(path):
    """It imports the package, and nothing from within it."""
    code = "\n".join(cell.source for cell in _code(nbformat.read(path, as_version=4)))

    assert "import ehsa_ctrl as e" in code
    assert not re.search(r"\b(from|import) ehsa_ctrl\.", code)


def test_every_notebook_has_a_source():
    """Notebooks and sources correspond one to one."""
    sources = [source.stem for source in sorted((EXAMPLES / "notebooks").glob("*.py"))]

    assert sources == IDS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=IDS)
def test_a_notebook_is_its_source(path):
    """Each cell equals that of build_notebooks.py for the source."""
    read = runpy.run_path(str(EXAMPLES / "build_notebooks.py"))["read"]
    source = read(EXAMPLES / "notebooks" / f"{path.stem}.py")

    stored = nbformat.read(path, as_version=4)

    assert [(c.cell_type, c.source) for c in stored.cells] == [(c.cell_type, c.source) for c in source.cells]


def test_the_notebooks_lead_from_one_to_the_next():
    """The last cell of each links to the next, all are reached, and the last leads back to the first."""
    names = {path.stem for path in NOTEBOOKS}
    name, read = "from_paper_to_model", []

    while name not in read:
        read.append(name)
        last = nbformat.read(EXAMPLES / f"{name}.ipynb", as_version=4).cells[-1].source
        (name,) = re.findall(r"\]\((\w+)\.ipynb\)", last)

    assert set(read) == names and name == "from_paper_to_model"
