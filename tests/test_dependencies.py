"""pyproject.toml declares what the code imports, and the code imports what pyproject.toml declares."""

import ast
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
#: Used without an import statement: name -> by what.
USED_OTHERWISE = {
    "ipykernel": "runs the notebooks",
    "mkdocs-material": "theme of the site",
    "mkdocstrings": "plugin of the site",
    "mypy": "a command",
    "pyarrow": "pandas reads and writes Parquet with it",
    "pytest-cov": "plugin of pytest",
    "pytest-xdist": "plugin of pytest",
    "ruff": "a command",
    "slycot": "backend of control.mixsyn, in a notebook",
    "uplot-python": "its JavaScript and style are read as files",
}
#: Modules that tests write and then import.
WRITTEN_BY_TESTS = {"family", "odd"}
#: Import name -> distribution: what belongs to another distribution that is declared.
IMPORTED_AS = {
    "pydantic_core": "pydantic",  # each release of pydantic requires one release of it
    "griffe": "mkdocstrings",
    "mkdocs": "mkdocs-material",
    "pymdownx": "mkdocs-material",
}


def normalised(name):
    return re.sub(r"[-_.]+", "-", re.split(r"[\s\[<>=!~;]", name)[0]).lower()


REQUIRED = {normalised(text) for text in PROJECT["dependencies"]}
EXTRAS = {name: {normalised(text) for text in texts} for name, texts in PROJECT["optional-dependencies"].items()}


@cache
def imported_names(folder):
    """What the Python files below a folder import."""
    names = set()
    for file in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.partition(".")[0])
    return names


#: Import name -> distributions that have it; slow to make.
DISTRIBUTIONS = cache(packages_distributions)


def imported(*folders):
    """Distributions that the Python files below these folders import, whether they are installed or not."""
    scripts = [file for folder in folders if folder != "ehsa_ctrl" for file in (ROOT / folder).rglob("*.py")]
    local = {"ehsa_ctrl", *WRITTEN_BY_TESTS, *(file.stem for file in scripts), *(file.parent.name for file in scripts)}
    known = DISTRIBUTIONS()
    names = set().union(*map(imported_names, folders))
    names -= {*sys.stdlib_module_names, *local}
    return {normalised(IMPORTED_AS.get(name) or (known.get(name) or [name])[0]) for name in names}


def test_the_package_imports_what_it_requires_and_no_more():
    """Each required distribution is imported, each import is required or belongs to an extra."""
    found = imported("ehsa_ctrl")
    optional = set().union(*(names for extra, names in EXTRAS.items() if extra not in ("bench", "dev", "docs")))

    assert found <= REQUIRED | optional
    assert found >= REQUIRED


def test_everything_else_imports_declared_distributions():
    """Tests, documentation, examples and benchmarks import only what some extra installs."""
    declared = REQUIRED.union(*EXTRAS.values())

    assert imported("tests", "docs", "examples", "benchmarks") <= declared


@pytest.mark.parametrize("extra", EXTRAS)
def test_every_distribution_of_an_extra_is_used(extra):
    """An import somewhere in the repository, or a use that is named above."""
    found = imported("ehsa_ctrl", "tests", "docs", "examples", "benchmarks")

    assert {name for name in EXTRAS[extra] if name not in found} <= set(USED_OTHERWISE)
