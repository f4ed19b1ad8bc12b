"""Documentation and code agree: commands, options, keys and files exist, and the code that pages show runs."""

import importlib
import importlib.util
import re
import shlex
import sys
import tomllib
from fnmatch import fnmatch
from itertools import pairwise
from pathlib import Path

import pytest

import ehsa_ctrl
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.physics.effects import EFFECTS
from ehsa_ctrl.physics.friction import LAWS
from ehsa_ctrl.plant.file import LIMIT_UNITS
from ehsa_ctrl.scenario.metrics import METRICS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = {str(path.relative_to(DOCS)): path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^([ ]*)```([a-z]*)(?: title=\"([^\"]*)\")?\n(.*?)^\1```", flags=re.DOTALL | re.MULTILINE)


sys.path.insert(0, str(DOCS / "_site"))  # mkdocs imports these modules from this folder too
reference, page_api, page_commands = map(importlib.import_module, ("reference", "page_api", "page_commands"))
GENERATED = reference.pages()
COMMANDS = page_commands.all_commands()


def blocks(language):
    """(page, title, text) of each block of code in a language."""
    return [
        (page, title, text)
        for page, content in PAGES.items()
        for _, word, title, text in BLOCK.findall(content)
        if word == language
    ]


def typed():
    """Each call of ehsa-ctrl in the README and the pages, in blocks and in the text."""
    found = []
    for page, content in {"README.md": README, **PAGES}.items():
        lines = [
            line.strip().removeprefix("$ ")
            for _, word, _, text in BLOCK.findall(content)
            if word in ("sh", "text")
            for line in text.replace("\\\n", " ").splitlines()
        ]
        lines += re.findall(r"`(ehsa-ctrl [^`]+)`", BLOCK.sub("", content).replace("\n", " "))
        found += [(page, line.strip()) for line in lines if line.strip().startswith("ehsa-ctrl ")]
    return found


def test_every_page_is_in_the_navigation_and_there():
    """Every page of the navigation exists or is generated, and every page is in it."""
    named = re.findall(r":\s+(\S+\.md)\s*$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.MULTILINE)

    assert sorted(named) == sorted([*PAGES, *GENERATED])


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("commands", COMMANDS),
        ("effects", EFFECTS),
        ("friction", LAWS),
        ("metrics", METRICS),
        ("controllers", CONTROLLER_KINDS),
        ("plants", LIMIT_UNITS),
    ],
)
def test_the_reference_names_all_of_them(page, names):
    """Each has a heading or a row."""
    text = GENERATED[f"reference/{page}.md"]

    for name in names:
        assert re.search(rf"^(#+ (ehsa-ctrl )?{re.escape(name)}\b|\| \[?`{re.escape(name)}`)", text, re.MULTILINE), name


def test_the_reference_has_every_option_and_key():
    """Options of commands, and keys that the shipped definitions use."""
    for name, command in COMMANDS.items():
        section = GENERATED["reference/commands.md"].partition(f"## ehsa-ctrl {name} ")[2].partition("\n## ")[0]
        for parameter in command.params:
            assert f"`{parameter.opts[0]}" in section or f"`{parameter.name}" in section, (name, parameter.name)
    for folder in ("plants", "controllers", "scenarios"):
        for path in (ROOT / folder).glob("*.toml"):
            for key in tomllib.loads(path.read_text(encoding="utf-8")):
                assert f"| `{key}` |" in GENERATED[f"reference/{folder}.md"], (path.name, key)


def test_the_commands_that_set_a_value_are_named():
    """All commands with --set, and no other."""
    listed = PAGES["how-to/own-plant.md"].partition("`--set` is an option of ")[2].partition(". ")[0]

    assert re.findall(r"`([a-z ]+)`", listed.partition(".")[0]) == sorted(
        name for name, command in COMMANDS.items() if any("--set" in p.opts for p in command.params)
    )


def test_the_api_has_every_public_name():
    """Each name of the package is on one page."""
    shown = [name for names in page_api.api_names().values() for name in names]

    assert sorted(shown) == sorted(set(ehsa_ctrl.__all__) - {"__version__"})


@pytest.mark.parametrize(("page", "line"), typed())
def test_every_command_that_is_shown_is_one(page, line):
    """Command and options exist."""
    words = shlex.split(line, comments=True)[1:]
    if words[0].startswith("-") or any(command.startswith(" ".join([*words, ""])) for command in COMMANDS):
        return  # a general option, or a group of commands
    name = next((known for known in (" ".join(words[:2]), words[0]) if known in COMMANDS), None)
    known = {option for p in COMMANDS[name].params for option in [*p.opts, *p.secondary_opts]} | {"--help"}

    for word in words:
        if re.match(r"--?[A-Za-z]", word):
            assert word.partition("=")[0] in known, f"{page}: {line}"


@pytest.mark.parametrize("page", PAGES)
def test_files_that_a_page_works_with_are_made_on_it(page):
    """An earlier command or a shown file creates them, so that the page can be followed in an empty folder."""
    made = set()
    for _, language, title, text in BLOCK.findall(PAGES[page]):
        made |= {title} if language == "toml" else set()
        for line in text.replace("\\\n", " ").splitlines() if language == "sh" else ():
            words = shlex.split(line, comments=True)
            if words[:1] != ["ehsa-ctrl"]:
                continue
            made |= {f"plants/{words[3]}.toml"} if words[1:3] == ["new", "plant"] else set()
            for before, word in pairwise(words):
                if before in ("--out", "-o"):
                    made.add(word)
                elif "/" in word and "://" not in word and re.fullmatch(r"[\w./*-]+", word):
                    assert any(fnmatch(file, word) or fnmatch(f"{file}/{Path(word).name}", word) for file in made), line


def test_no_page_installs_from_an_index():
    """Pages install extras in a clone of the project."""
    assert not [page for page, text in PAGES.items() if re.search(r'pip install "?ehsa_ctrl', text)]


@pytest.mark.parametrize(("page", "title", "text"), [b for b in blocks("python") if not b[1]])
def test_python_that_is_shown_runs(page, title, text, tmp_path, monkeypatch, capsys):
    """Unchanged, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    exec(compile(text, page, "exec"), {"__name__": "__main__"})


@pytest.mark.slow
def test_the_controller_in_python_runs(tmp_path, monkeypatch, capsys):
    """It prints the line that the page shows."""
    monkeypatch.chdir(tmp_path)
    (text,) = (text for _, title, text in blocks("python") if title == "own_law.py")
    monkeypatch.setitem(
        sys.modules, "own_law", importlib.util.module_from_spec(importlib.machinery.ModuleSpec("own_law", None))
    )

    exec(compile(text, "own_law.py", "exec"), vars(sys.modules["own_law"]))

    said = capsys.readouterr().out.splitlines()[0]
    assert said in PAGES["how-to/own-controller.md"]


def test_the_effect_that_is_shown_is_neutral():
    """At the neutral value it changes no bit, at another one it adds friction."""
    (text,) = (text for _, title, text in blocks("python") if title.startswith("effects/"))
    names = {"__name__": "ehsa_ctrl.physics.effects.shown", "__package__": "ehsa_ctrl.physics.effects"}

    exec(compile(text, "effect", "exec"), names)

    effect = names["effect"]
    (function,), (size,) = effect.changes.values(), effect.parameters
    assert function(-854.3, -1.0, 2e6, 1e6, size.neutral) == -854.3
    assert function(-854.3, -1.0, 2e6, 1e6, size.typical) == pytest.approx(-854.3 - 1.5e6 * size.typical)


def test_the_friction_law_that_is_shown_is_one():
    """It takes the symbols of friction laws and opposes the motion."""
    (text,) = (text for _, title, text in blocks("python") if title == "friction/lorentz.py")
    names = {}

    exec(compile(text, "friction", "exec"), names)

    assert list(names["law"].symbols) == ["A", "B", "C", "tau"]
    assert names["law"].effort(-1.0, -0.5, 800.0, 100.0, 200.0, 0.5) == -950.0


@pytest.mark.slow
def test_definitions_that_are_shown_are_valid(tmp_path, monkeypatch, capsys):
    """Every TOML with a file name passes `ehsa-ctrl check`, including the parts on other pages."""
    monkeypatch.chdir(tmp_path)
    files = {}
    for page, title, text in blocks("toml"):
        if title and not title.startswith("in "):
            # The catalogue's plant replaces the result of the tutorial's diagnosis.
            files[f"{page}/{title}"] = text.replace("../results/diagnosis/ehsa_improved.toml", "ehsa")
    (plant,) = (name for name in files if name.endswith("plants/rig.toml"))
    files[plant] += "".join(text for _, title, text in blocks("toml") if title == "in plants/rig.toml")
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    assert len(files) >= 4
    assert not app(["check", *files], standalone_mode=False), capsys.readouterr()


def test_docstrings_become_what_the_reader_of_numpy_style_takes():
    """An item on one line becomes two lines, several items on a line are separated, prose is unchanged."""
    pytest.importorskip("griffe")
    text = (
        "Do it.\n\nAttributes\n----------\na: first. b, c: others;\n    more of it.\n\n"
        "Returns\n-------\nRun. All of it: nothing less.\n\nRaises\n------\nInputError: wrong; right: not."
    )

    read = importlib.import_module("docstrings").numpydoc(text)

    assert "\na\n    first.\nb, c\n    others;\n    more of it.\n" in read
    assert "\nRun\n    All of it: nothing less.\n" in read
    assert read.endswith("\nInputError\n    wrong; right: not.")


def test_formulas_are_drawn():
    """In the text's colour, with its number, and with its source as the label for screen readers."""
    pytest.importorskip("ziamath")
    formulas = importlib.import_module("formulas")

    drawn = formulas.render(r'<div class="arithmatex">\[x &lt; \omega \tag{7}\]</div>')

    assert "currentColor" in drawn
    assert 'id="eq-7">(7)<' in drawn
    assert r'aria-label="x &lt; \omega"' in drawn


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "README.md", "benchmarks/README.md", "docs/evidence.md"])
def test_paths_that_a_page_names_exist(page):
    """Files and folders of the repository in backticks, up to a placeholder in capitals."""
    text = (ROOT / page).read_text(encoding="utf-8")
    folders = "|".join(path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith("."))

    for path in re.findall(rf"`((?:{folders})/[\w./-]*)`", text):
        known = path.partition("NAME")[0]
        assert (ROOT / known).exists() or path.startswith(("demo", "results", "site")), path


def test_every_benchmark_is_described():
    """Each file of the folder is in its table."""
    text = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")

    assert not [file.name for file in (ROOT / "benchmarks").glob("*.[cp]*") if f"`{file.name}`" not in text]
