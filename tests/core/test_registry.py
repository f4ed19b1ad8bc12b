"""Registries of modules in a folder."""

import sys

import pytest

from ehsa_ctrl.core.registry import members


def package(tmp_path, monkeypatch, **modules):
    """A package of the given modules, importable."""
    folder = tmp_path / "family"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    for name, text in modules.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.split(".")[0] == "family"]:
        monkeypatch.delitem(sys.modules, name)
    import family

    return family


MEMBER = "from types import SimpleNamespace\nlaw = SimpleNamespace(name={name!r})\n"


def test_a_new_file_is_a_new_member(tmp_path, monkeypatch):
    """Adding a file is the whole registration; files with an underscore are machinery."""
    family = package(tmp_path, monkeypatch, one=MEMBER.format(name="one"), _law="")

    assert list(members(family, "law")) == ["one"]


def test_a_file_may_define_several_members(tmp_path, monkeypatch):
    """A tuple under the plural of the attribute."""
    text = "from types import SimpleNamespace\nlaws = tuple(SimpleNamespace(name=n) for n in ('two', 'one'))\n"
    family = package(tmp_path, monkeypatch, both=text)

    assert set(members(family, "law")) == {"one", "two"}


def test_a_name_taken_twice_is_an_error_at_import(tmp_path, monkeypatch):
    """Two files can't have the same name."""
    family = package(tmp_path, monkeypatch, one=MEMBER.format(name="same"), two=MEMBER.format(name="same"))

    with pytest.raises(TypeError, match=r"two\.py: the name 'same' is taken"):
        members(family, "law")


def test_a_file_without_a_member_is_an_error_at_import(tmp_path, monkeypatch):
    """A module without the attribute is an error."""
    family = package(tmp_path, monkeypatch, empty="")

    with pytest.raises(TypeError, match=r"empty\.py: .* must define `law`"):
        members(family, "law")
