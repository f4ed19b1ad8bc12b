"""Who may import whom is a test, not a wish."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "ehsa_ctrl"

#: Folder -> the folders it may import from. cli may import everything; nothing may import cli.
ALLOWED = {
    "core": set(),
    "physics": {"core"},
    "plant": {"physics", "core"},
    "simulation": {"plant", "physics", "core"},
    "design": {"core"},
    "identification": {"simulation", "plant", "physics", "core"},
    "scenario": {"design", "simulation", "plant", "physics", "core"},
    # A prepared scenario is given to diagnosis/closed_loop.py, which imports it for its type alone.
    "diagnosis": {"identification", "simulation", "plant", "physics", "core"},
    "fleet": {"diagnosis", "identification", "simulation", "plant", "physics", "core"},
    "report": {"scenario", "diagnosis", "identification", "design", "simulation", "plant", "physics", "core"},
}


def imports(path):
    """Folders of the package that a file imports anywhere but for type checking."""
    tree = ast.parse(path.read_text())
    package = ["ehsa_ctrl", *path.relative_to(PACKAGE).parent.parts]
    everything = list(ast.walk(tree))
    blocks = [n for n in everything if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.unparse(n.test)]
    typing_only = {node for block in blocks for node in ast.walk(block)}
    for node in everything:
        if node in typing_only:
            continue
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            parts = [*base, *node.module.split(".")] if node.module else [*base, node.names[0].name]
        elif isinstance(node, ast.Import):
            parts = node.names[0].name.split(".")
        else:
            continue
        if parts[0] == "ehsa_ctrl" and len(parts) > 1:
            yield parts[1]


@pytest.mark.parametrize("folder", sorted(ALLOWED))
def test_a_folder_imports_only_from_below(folder):
    """A folder's modules import only the folders that the design allows, inside functions too."""
    for path in (PACKAGE / folder).rglob("*.py"):
        wrong = set(imports(path)) - {folder, *ALLOWED[folder]}

        assert not wrong, f"{path.relative_to(PACKAGE.parent)} imports {sorted(wrong)} of ehsa_ctrl"


def test_every_folder_has_its_place():
    """A new folder must be given a place in the import order."""
    folders = {path.name for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}

    assert folders == {*ALLOWED, "cli"}


def test_design_does_not_see_the_nonlinear_plant():
    """Controllers are designed from linear models; neither plant nor simulator is within their reach."""
    assert ALLOWED["design"] == {"core"}


def test_no_two_classes_share_a_name():
    """A class name says which class is meant wherever it is read, without the module."""
    modules = {}
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef):
                modules.setdefault(node.name, set()).add(path.relative_to(PACKAGE).as_posix())
    shared = {name: sorted(paths) for name, paths in modules.items() if len(paths) > 1}

    assert not shared


def test_a_module_is_named_after_an_idea():
    """No module collects leftovers under a name that says nothing."""
    vague = {"helper", "helpers", "util", "utils", "manager", "managers", "misc", "common"}

    assert not [path for path in PACKAGE.rglob("*.py") if path.stem.strip("_") in vague]


def test_only_the_plugin_needs_pytest():
    """pytest is an extra: the package and all commands work without it."""
    users = {path.name for path in PACKAGE.rglob("*.py") if "import pytest" in path.read_text()}

    assert users == {"pytest_plugin.py"}


def test_a_simulation_imports_no_library_that_it_does_not_use():
    """scipy.signal, statistics, tables and figures import for seconds, which each command would take longer."""
    heavy = ("control", "cvxpy", "joblib", "matplotlib", "pandas", "scipy.interpolate", "scipy.signal", "scipy.stats")
    program = (
        "import sys, ehsa_ctrl as e; e.simulate(e.load_plant('ehsa'), [1.0] * 10); "
        f"print([name for name in {heavy} if name in sys.modules])"
    )

    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == "[]"
