"""A page that is sent around runs nothing and loads nothing, whatever stands in the files that it is made of."""

import dataclasses
import json
from pathlib import Path
from urllib.parse import unquote

import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.identification.checks import LogFinding
from ehsa_ctrl.report.document import image
from ehsa_ctrl.report.kinds import kinds
from ehsa_ctrl.report.results import MAX_FIGURE, MAX_SVG, results_in, write_overview, write_result_page

from .diagnoses import diagnosis
from .reading import Page, figures, loads_nothing

#: Words that become markup wherever one place of a page takes them as they are.
WORDS = [
    "<script>alert(1)</script>",
    "<ScRiPt src=//evil.example/x.js></sCrIpT>",
    '"><img src=x onerror=alert(1)>',
    "' onmouseover='alert(1)",
    "</title></style><svg/onload=alert(1)>",
    "--><iframe src=javascript:alert(1)></iframe>",
    "]]><object data='data:text/html,<script>alert(1)</script>'></object>",
    "&lt;script&gt;alert(1)&lt;/script&gt;",
    "<base href=//evil.example/><meta http-equiv=refresh content='0;url=//evil.example'>",
    "{{ 7 * 7 }}{% include 'page.css' %}",
    "$\\frac{$ an uneven $ \\n_^",
    "\ud800 \x00 \u202e <b>",
]
SVG = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{}</svg>'
#: What a figure may hold that is none of ours.
DRAWN = [
    *(
        SVG.format(inner)
        for inner in (
            "<SCRIPT>alert(1)</SCRIPT>",
            "<script><![CDATA[alert(1)]]></script>",
            '<image href="x" onerror="alert(1)"/><g onload="alert(1)"/>',
            '<a xlink:href="javascript:alert(1)"><rect width="9" height="9"/></a>',
            '<a href="&#106;avascript:alert(1)"><text>x</text></a>',
            '<foreignObject><iframe xmlns="http://www.w3.org/1999/xhtml" src="//evil.example"/></foreignObject>',
            "<style>@import url(//evil.example/x.css); * { fill: url(//evil.example/x.svg#a) }</style>",
            '<use href="data:image/svg+xml,<svg id=x onload=alert(1)>#x"/>',
            '<svg><svg onload="alert(1)"></svg></svg>',
            '<set attributeName="href" to="javascript:alert(1)"/><animate onbegin="alert(1)"/>',
        )
    ),
    '<!DOCTYPE svg [<!ENTITY a "<script>alert(1)</script>">]>' + SVG.format("&a;"),
    '<?xml-stylesheet href="//evil.example/x.css"?>' + SVG.format(""),
    '"><script>alert(1)</script><svg',
    "'><svg onload=alert(1)>",
    "<svg><g",
    "<html><body onload=alert(1)>",
    "%22%3E%3Cscript%3Ealert(1)%3C/script%3E #\r\n\t\x00\xff",
    "",
]


@pytest.mark.parametrize("text", DRAWN)
def test_a_figure_stays_within_its_img(text):
    """Its bytes arrive as they are and none of them becomes a part of the page."""
    content = text.encode()
    for kind in ("svg+xml", "png"):
        tag = str(image(content, kind, text))
        (attributes,) = Page(tag).with_tag("img")

        assert tag.count("<") == tag.count(">") == 1 and set(attributes) == {"alt", "src"}
        assert figures(tag) == [content]
        assert attributes["src"].startswith(f"data:image/{kind}")


def test_a_figure_is_written_the_shorter_way():
    """Lines as text, pixels as base64."""
    assert ";base64," in image(bytes(range(256)), "png", "")
    assert ";base64," not in image(SVG.format('<path d="M 1 2 L 3 4 L 5 6"/>').encode(), "svg+xml", "")


#: Words of a JSON that must be one of a few, and what is named by its keys.
FIXED, NAMED = (
    {"verdict", "unit", "file_unit", "metric", "balance", "kind", "date", "since"},
    {"settings", "files", "parameters", "provenance", "limits", "models", "failures"},
)


def infected(value, words, key=""):
    """The content of a JSON with words in every string and in every name."""
    if isinstance(value, dict):
        return {name + words * (key in NAMED): infected(each, words, name) for name, each in value.items()}
    if isinstance(value, list):
        return [infected(each, words, "" if isinstance(each, dict) else key) for each in value]
    return value + words if isinstance(value, str) and key not in FIXED else value


@pytest.mark.parametrize("words", WORDS)
def test_words_of_a_tree_of_results_stay_words(tree, tmp_path, words):
    """In every string of every kind's JSON, in the tree's name, and in the pages of single results."""
    for source in sorted(tree.rglob("*.json")):
        folder = tmp_path / source.stem
        folder.mkdir()
        (folder / source.name).write_text(json.dumps(infected(json.loads(source.read_text()), words)))
    results, wrong = results_in(tmp_path)
    text = write_overview(results, tmp_path, words).read_text()

    assert wrong == [] and len(results) == len(kinds())
    loads_nothing(text)
    loads_nothing(write_result_page(tmp_path / "montecarlo", "montecarlo.json").read_text())
    assert len(Page(text).with_tag("h1")) == 1 and len(Page(text).with_tag("h2")) == len(results)


@pytest.mark.slow
def test_words_of_a_result_in_python_stay_words(gentle, fitting, tmp_path):
    """Names of logs, plants, controllers and scenarios, findings, and the command line; figures show them too."""
    # Signs that the font lacks are matplotlib's to warn of.
    words = " ".join([*WORDS[:-1], "\udc80"])
    replay = fitting.train.after[0]
    log = dataclasses.replace(replay.log, path=Path(words))
    plant = dataclasses.replace(replay.plant, title=words)
    replay = dataclasses.replace(replay, log=log, plant=plant)
    reach = dataclasses.replace(fitting.train, after=(replay,))
    run = dataclasses.replace(
        gentle,
        controller=dataclasses.replace(gentle.controller, name=words),
        scenario=dataclasses.replace(gentle.scenario, name=words),
    )
    found = diagnosis("effect")
    found = dataclasses.replace(found, log=dataclasses.replace(found.log, path=Path(words)))
    finding = LogFinding("dead", words, "warning", words)
    fitted = dataclasses.replace(fitting, train=reach, plant=plant, findings=(finding,))

    for result in (run, fitted, replay, found):
        written = e.write_report(result, tmp_path / type(result).__name__)
        text = written.read_text(encoding="utf-8")
        loads_nothing(text)
        assert len(Page(text).with_tag("h1")) == 1 and Page(text).wrong == []


@pytest.mark.parametrize("name", ["javascript:alert(1)", "a#b%41?c", '"><script>alert(1)<', "data:text<html,x"])
def test_the_link_to_a_page_leads_to_its_file(tree, tmp_path, name):
    """Whatever its folder is called."""
    folder = tmp_path / name
    folder.mkdir()
    for file in ("diagnosis.json", "diagnosis.html"):
        (folder / file).write_text((tree / "diagnosis" / "diagnosis.json").read_text())
    text = write_overview(results_in(tmp_path)[0], tmp_path, "results").read_text()
    (link,) = [each["href"] for each in Page(text).with_tag("a") if not each["href"].startswith("#")]

    loads_nothing(text)
    assert (tmp_path / unquote(link)).samefile(folder / "diagnosis.html")


def simulation(tree, folder, **files):
    """The page of a simulation with these figures beside its JSON."""
    (folder / "simulation.json").write_text((tree / "simulation" / "simulation.json").read_text())
    for ending, content in files.items():
        (folder / f"simulation.{ending}").write_bytes(content)
    return write_result_page(folder, "simulation.json").read_text()


def test_a_figure_of_any_content_is_shown_and_does_nothing(tree, tmp_path):
    """A file that is no picture is a picture that the browser does not draw."""
    for text in DRAWN:
        shown = simulation(tree, tmp_path, svg=text.encode())

        loads_nothing(shown)
        assert figures(shown) == [text.encode()]


def test_a_figure_that_is_far_too_large_is_left_out_and_said(tree, tmp_path):
    """A large one is shown where there is nothing smaller."""
    (tmp_path / "large").mkdir()

    assert len(figures(simulation(tree, tmp_path / "large", svg=b"x" * (MAX_SVG + 1)))) == 1
    text = simulation(tree, tmp_path, svg=b"<" * (MAX_FIGURE + 1))
    assert figures(text) == [] and "The figure is left out: simulation is larger than 8 MB." in text


def test_no_name_of_a_figure_leads_out_of_the_folder(tree, tmp_path):
    """The figures of a campaign are named by its JSON."""
    (tmp_path / "private.svg").write_text("<svg/>")
    content = json.loads((tree / "montecarlo" / "montecarlo.json").read_text())
    (tmp_path / "results").mkdir()
    for name in ("../private", str(tmp_path / "private"), "..", "long" * 1000, "\0"):
        content["campaigns"][0]["scenario"] = name
        (tmp_path / "results" / "montecarlo.json").write_text(json.dumps(content))
        results, _ = results_in(tmp_path / "results") if len(name) < 1000 else ([], None)
        assert all(result.images == {} for result in results)


@pytest.mark.parametrize(
    ("value", "says"),
    [*((value, "not a result of ehsa-ctrl") for value in (5, None, {}, [[1]])), ("[" * 100_000, "not valid JSON")],
)
def test_a_json_of_other_types_is_no_result(tree, tmp_path, value, says):
    """It is said when it is read, not when a page is half made."""
    content = json.loads((tree / "montecarlo" / "montecarlo.json").read_text())
    content["campaigns"][0]["influences"][0]["name"] = value
    text = value if isinstance(value, str) else json.dumps(content)
    (tmp_path / "montecarlo.json").write_text(text)

    with pytest.raises(InputError, match=rf"montecarlo\.json: is {says}"):
        results_in(tmp_path)
