"""Public names, commands and files are documented."""

import re
from pathlib import Path

import pytest

import ehsa_ctrl
from ehsa_ctrl.cli.main import app

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("name", [name for name in ehsa_ctrl.__all__ if name != "__version__"])
def test_every_public_name_is_there_and_documented(name):
    """Each name can be imported and has a docstring."""
    thing = getattr(ehsa_ctrl, name)

    assert (thing.__doc__ or "").strip(), name
    assert name in dir(ehsa_ctrl)


def test_an_unknown_name_is_an_attribute_error():
    """As for any module."""
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        ehsa_ctrl.simulat  # noqa: B018


@pytest.mark.parametrize("command", [command.name for command in app.registered_commands])
def test_every_command_is_in_the_readme(command):
    """The README mentions every command."""
    assert f"ehsa-ctrl {command}" in README


@pytest.mark.slow
def test_the_readmes_python_runs(tmp_path, monkeypatch):
    """The snippet of the tour runs unchanged."""
    monkeypatch.chdir(tmp_path)
    (snippet,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)

    exec(compile(snippet, "README.md", "exec"), {})


def test_every_link_of_the_readme_leads_somewhere():
    """Linked files and pictures are in the repository."""
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if not target.startswith("http"):
            assert (ROOT / target).exists(), target


def test_the_readme_is_short():
    """At most 1500 words; evidence, limits and how-to guides are in docs/."""
    assert len(README.split()) <= 1500


def test_version_is_said_once():
    """pyproject.toml and the package agree."""
    assert f'version = "{ehsa_ctrl.__version__}"' in (ROOT / "pyproject.toml").read_text()
