"""Pages made of what commands leave: every kind is read, verdict first; a folder of all of them is one page."""

import dataclasses
import json
import re
import shutil
from urllib.parse import quote

import pytest

import ehsa_ctrl as e
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.report.kinds import kinds
from ehsa_ctrl.report.page import DOUBT, LOOKS, Table
from ehsa_ctrl.report.page import Page as PageModel
from ehsa_ctrl.report.provenance import hashes
from ehsa_ctrl.report.results import results_in, write_overview, write_result_page
from ehsa_ctrl.scenario.sensitivity import AssumptionSensitivity, RangeEnd

from .contents import AWKWARD, contents
from .reading import Page, figures, sound


@pytest.fixture(scope="module")
def overview(tree, tmp_path_factory):
    sections, wrong = results_in(tree)
    assert wrong == []
    return write_overview(sections, tmp_path_factory.mktemp("page"), "results").read_text(encoding="utf-8")


def test_every_kind_of_result_is_tried(tree):
    """A kind that is added needs a content here."""
    assert {path.name for path in tree.rglob("*.json")} == set(kinds())


def test_a_tree_of_all_kinds_is_one_sound_page(overview):
    """Well formed, ids unique, links within it, loading nothing, nothing from outside taken for HTML."""
    page = Page(overview)
    links = [attributes["href"] for attributes in page.with_tag("a")]
    headings = [int(level) for level in re.findall(r"<h([1-6])[ >]", overview)]

    sound(overview)
    # Others than to a part of the page lead to pages of single logs, below the folder, and to a fleet's logs.
    assert {link for link in links if not link.startswith("#")} == {
        "summary/a/diagnosis.html", "summary/b/diagnosis.html", "fleet/diagnoses/rig/diagnosis.html",
        f"fleet/../{quote(AWKWARD)}/a.csv",
    }  # fmt: skip
    assert "alert(1)</script>" not in overview
    assert headings[0] == 1 and headings.count(1) == 1
    assert all(after <= before + 1 for before, after in zip(headings[:-1], headings[1:], strict=True))


def test_verdicts_come_before_everything(overview, harsh):
    """What is to be looked at stands above the first figure and table, of every result."""
    top = overview[: min(overview.index("<table"), overview.index("<img"))]

    assert "Plant limit exceeded: pump speed reached 5000 rpm." in top
    assert "96 of 100 runs pass" in top and "Interrupted: fewer runs than requested" in top
    assert "<h1>14 results, 5 failed, " in top and "NOT STABLE" in top
    assert '<span class="doubt">△</span> <a href="#simulation-' in top
    assert f"{'; '.join(harsh.failures[:3])}; and {len(harsh.failures) - 3} more." in top.replace("&gt;", ">")
    for failure in harsh.failures:
        assert failure in overview.replace("&gt;", ">")


def test_headings_say_what_a_result_is(overview):
    """Log, plant and scenario, and not the name of a folder."""
    headings = re.findall(r"<h2 [^>]*>(.*?)</h2>", overview)

    assert any(each.startswith("Diagnosis of log &lt;script&gt;alert(1).csv on ehsa: ") for each in headings)
    assert any(each.startswith("Identification of ehsa from noise ") for each in headings)
    assert "Diagnosis of 3 logs of ehsa" in headings and "Design for ehsa: pid" in headings
    assert any(each.endswith("scenarios passed: gentle and harsh") for each in headings)


def test_a_result_among_others_says_what_it_is_first():
    """The verdict, then what one should look at; much of that is counted."""
    sentences = [("The cause is known.", True), *((f"Doubt {k}.", DOUBT) for k in range(6))]

    lead = PageModel("a title", sentences).lead

    assert lead == ["The cause is known.", "Doubt 0.", "Doubt 1.", "Doubt 2.", "And 3 more."]
    assert PageModel("a title", sentences[:1]).lead == ["The cause is known."]
    assert PageModel("a title", sentences[:5]).lead[-1] == "Doubt 3."
    assert (PageModel("", sentences).state, PageModel("", [("no", False)]).state) == (DOUBT, False)


@pytest.mark.parametrize("name", sorted(kinds()))
def test_a_result_alone_is_a_page(tree, name):
    """Its sentences first, then what it rests on: assumed parameters, versions, command."""
    folder = tree / name.removesuffix(".json")
    path = write_result_page(folder, name)
    again = write_result_page(folder, name).read_bytes()
    page = Page(path.read_text(encoding="utf-8"))
    rows = {row[0]: row for row in page.table("name", "value", "range")}

    assert path.name == kinds()[name].page and path.read_bytes() == again
    assert page.wrong == [] and page.open == []
    assert rows["K_T"][2] == "0.87 to 1.6 N m/A"
    assert "ehsa-ctrl <do> it" in "".join(page.words)


def test_figures_are_those_that_lie_there(overview):
    """They are in the page as they are; in an <img> nothing of them runs."""
    first, second = figures(overview)

    assert b"<script>" in first and b"<script>" not in second
    assert "<svg" not in overview and "<script>alert" not in overview


def test_pixels_stand_in_for_a_figure_of_too_many_lines(tree, tmp_path):
    """A very large SVG makes way for its PNG, which is within the page as well."""
    content = json.loads((tree / "simulation" / "simulation.json").read_text())
    (tmp_path / "simulation.json").write_text(json.dumps(content))
    (tmp_path / "simulation.svg").write_text(f"<svg>{'x' * 700_000}</svg>")
    (tmp_path / "simulation.png").write_bytes(b"png")
    text = write_result_page(tmp_path, "simulation.json").read_text()

    assert figures(text) == [b"png"] and "data:image/png," in text


def test_logs_of_a_batch_are_shown_in_its_table_only(tree, tmp_path):
    """A folder for each log would make a page of hundreds of figures."""
    (tmp_path / "summary.json").write_text((tree / "summary" / "summary.json").read_text())
    for stem in ("a", "other"):
        (tmp_path / stem).mkdir()
        (tmp_path / stem / "diagnosis.json").write_text((tree / "diagnosis" / "diagnosis.json").read_text())

    assert [each.place for each in results_in(tmp_path)[0]] == [".", "other"]


def test_a_result_of_another_program_is_left_out_and_said(tree, tmp_path):
    """results.json is a common name: what is none of ours is named, the rest is shown."""
    (tmp_path / "results.json").write_text("[1, 2]")
    (tmp_path / "design").mkdir()
    (tmp_path / "design" / "design.json").write_text((tree / "design" / "design.json").read_text())
    sections, wrong = results_in(tmp_path)

    assert [each.kind.name for each in sections] == ["design.json"]
    assert wrong == [f"{tmp_path / 'results.json'}: is not a result of ehsa-ctrl"]


@pytest.mark.parametrize("text", ["", "{}", "null", '{"scenarios": []}', '{"scenarios": [3]}'])
def test_a_folder_of_nothing_known_is_refused(tmp_path, text):
    """In one sentence; so is one that is not there."""
    (tmp_path / "results.json").write_text(text)

    with pytest.raises(InputError, match="contains no result"):
        results_in(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        results_in(tmp_path / "absent")


def test_columns_of_numbers_are_told_from_words():
    """A name in the first column is none; a number may have a unit, a sign, a deviation, or be missing."""
    rows = [["1 mm", "12 %", "−3 ± 1", "–", "yes"], ["x", "∞", "(4 ± 1)e-13", "2", "12 and more words"]]

    assert Table("", ["", "", "", "", ""], rows).numbers == [False, True, True, True, False]


def test_hashes_are_those_of_the_files(tmp_path):
    """The first digits of SHA-256, each file once, without those that are not there."""
    path = tmp_path / "log.csv"
    path.write_bytes(b"abc")

    assert hashes([path, None, tmp_path / "absent", path]) == [(f"{path.parent.name}/log.csv", "ba7816bf8f01cfea")]


@pytest.mark.slow
def test_a_flip_is_said_at_the_top_of_the_run_page(gentle, tmp_path):
    """Where an assumed parameter decides a verdict the page says so before all tables, and shows the numbers."""
    metrics = {name: pair[1] for name, pair in gentle.metrics.items()}
    parameter = gentle.plant.parameters["K_T"]
    low, high = RangeEnd(0.87, metrics, ()), RangeEnd(1.6, metrics, ())
    violated = RangeEnd(1.6, metrics | {"Overshoot": 3.0}, ("Overshoot 300 %",))
    fine = AssumptionSensitivity(parameter, low, high, True)
    flips = AssumptionSensitivity(parameter, low, violated, True)
    texts = {}
    for name, swing in (("fine", fine), ("flips", flips)):
        result = dataclasses.replace(gentle, sensitivities=(swing,))
        texts[name] = e.write_report(result, tmp_path / name).read_text(encoding="utf-8")
    rows = Page(texts["flips"]).table("assumed", "value")

    top = texts["flips"].split("<table")[0]
    assert "Limits are met at the nominal values but violated at K_T = 1.6 N m/A." in top
    assert "No verdict changes" in texts["fine"].split("<table")[0]
    assert rows[0][0] == "nominal" and rows[1][:2] == ["K_T", "0.87 N m/A"]
    assert rows[2][2] == "300" and rows[2][-1] == "✗ Overshoot 300 %"


@pytest.mark.parametrize(("fit", "state"), [(95.0, True), (80.0, DOUBT), (56.0, False), (-20.0, False)])
def test_a_fit_is_green_only_where_it_is_good(gentle, harsh, fitting, tmp_path, fit, state):
    """From 90 % good, below 70 % poor, in between something to look at; of several channels the worst one counts."""
    content = contents(gentle, harsh, fitting)["comparison.json"] | {"findings": []}
    content["models"] = {"linear": {"fit_percent": {"speed": 99.0, "p1": fit}, "stopped": ""}}
    found = kinds()["comparison.json"].read(content, tmp_path)

    assert found.state is state or found.state == state
    assert ("poor in p1" in found.sentences[0][0]) == (state is False)
    assert "good in speed" in found.sentences[0][0]


@pytest.mark.parametrize(("required", "state"), [(None, None), (0.95, False), (0.85, True)])
def test_a_share_of_passing_runs_is_compared_with_the_required_probability(
    gentle, harsh, fitting, tmp_path, required, state
):
    """187 of 200 with its interval, against the demand; without one there is no mark of success."""
    content = contents(gentle, harsh, fitting)["montecarlo.json"]
    (each,) = content["campaigns"]
    each |= {"runs": 200, "passes": 187, "probability": 0.935, "interval": [0.891, 0.965], "interrupted": False}
    found = kinds()["montecarlo.json"].read({"campaigns": [each | {"required": required}]}, tmp_path)

    assert found.state is state
    assert "187 of 200 runs pass, probability 0.935 (95 % confidence interval 0.891 to 0.965)" in found.lead[0]
    assert LOOKS[found.state][0] == {None: "–", False: "✗", True: "✓"}[state]


def test_what_makes_a_simulation_doubtful_is_on_its_page(tree, tmp_path):
    """Each warning is a sentence; the symbol of a parameter keeps its letter."""
    shutil.copytree(tree / "simulation", tmp_path, dirs_exist_ok=True)
    content = json.loads((tmp_path / "simulation.json").read_text())
    content["warnings"] = ["kappa = 3 lies outside 0 to 1", "the law drag is known for omega from -1 to 1 rad/s"]
    (tmp_path / "simulation.json").write_text(json.dumps(content))
    text = write_result_page(tmp_path, "simulation.json").read_text()

    assert "kappa = 3 lies outside 0 to 1." in text
    assert "The law drag is known for omega from -1 to 1 rad/s." in text
