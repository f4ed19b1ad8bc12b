"""The page of scenarios: verdict first, right numbers, one file, well formed, the same each time."""

import dataclasses
import re

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.plant.file import label
from ehsa_ctrl.report.text import number, unit
from ehsa_ctrl.scenario.metrics import METRICS

from .reading import Page, sound


@pytest.fixture(scope="module")
def results(gentle, harsh):
    """Two scenarios, and the first with a second controller that has no linear loop and an awkward name."""
    other = dataclasses.replace(gentle.controller, name="pid <script>alert(1)</script>")
    return [gentle, harsh, dataclasses.replace(gentle, controller=other, loop=None)]


@pytest.fixture(scope="module")
def text(results, tmp_path_factory):
    path = e.write_report(results, tmp_path_factory.mktemp("page"))
    assert path.name == "report.html"
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_the_page_is_sound(text):
    """One well-formed file that can be sent around, whose table of runs leads to each of them."""
    sound(text)
    assert len(re.findall(r'href="#([^"]+)"', text)) >= 5


def test_the_verdict_comes_before_the_first_table(text, harsh):
    """How many passed, which one failed and why, on the first screen."""
    top = text[: text.index("<table")]

    assert "<h1>2 of 3 scenarios passed: gentle and harsh</h1>" in top
    assert "harsh with pid_position failed" in top and "gentle with" not in top
    assert len(harsh.failures) >= 3
    for failure in harsh.failures[:3]:
        assert failure in top
    assert f"and {len(harsh.failures) - 3} more" in top
    for failure in harsh.failures:
        assert failure in text
    assert "expected trip stroke did not happen" in text


@pytest.mark.slow
def test_all_passed_is_said_too(gentle, tmp_path):
    """A page without failure says so."""
    text = e.write_report(gentle, tmp_path).read_text()

    assert "<h1>1 of 1 scenarios passed: gentle</h1>" in text
    assert "failed" not in re.sub(r"<style>.*?</style>", "", text, flags=re.DOTALL)


def test_the_comparison_shows_every_metric_that_happened(page, harsh):
    """Name, linear and nonlinear value in the shown unit, unit, meaning; nothing that neither run has."""
    scale = {"s": 1e-3, "1": 1e-2}
    rows = [rows[1:] for rows in page.tables if rows[0][:3] == ["metric", "linear", "nonlinear"]][-1]
    shown = {name: rest for name, *rest in rows}

    assert set(shown) == {name for name, pair in harsh.metrics.items() if not np.isnan(pair).all()}
    assert shown["RiseTime"][:2] == [number(value / scale["s"]) for value in harsh.metrics["RiseTime"]]
    assert shown["CurrentRMS"][2] == number(np.subtract(*harsh.metrics["CurrentRMS"][::-1]))
    assert shown["StickShare"][1] == number(harsh.metrics["StickShare"][1] / scale["1"])
    assert shown["CurrentRMS"][1] == number(harsh.metrics["CurrentRMS"][1])
    for name, (_, _, _, of, meaning) in shown.items():
        assert of == unit(METRICS[name].display_unit) and meaning == METRICS[name].meaning


def test_limits_are_judged_in_the_page_as_in_the_result(page, gentle, harsh):
    """Metric, value, bounds and verdict of each limit."""
    tables = [rows[1:] for rows in page.tables if rows[0] == ["metric", "value", "bound", "met"]]
    peak = number(1e3 * gentle.metrics["MaxError"][1])

    assert tables[0][1] == ["MaxError", peak, "at least 1 and at most 20 mm", "✓ yes"]
    assert tables[-1] == [["MaxError", number(1e3 * harsh.metrics["MaxError"][1]), "at most 1 mm", "✗ no"]]


def test_one_row_a_run(page):
    """The table of all runs has scenario, controller and verdict of each."""
    rows = page.table("scenario", "controller", "verdict")

    assert [row[:4] for row in rows] == [
        ["gentle", "pid_position", "✓ passed", "2 of 2"],
        ["harsh", "pid_position", "✗ failed", "0 of 1"],
        ["gentle", "pid <script>alert(1)</script>", "✓ passed", "2 of 2"],
    ]


def test_a_scenario_has_one_section_for_all_its_controllers(text, page, gentle):
    """Title and reason stand once; the loop's Bode plot stands once a controller."""
    headings = re.findall(r"<h([1-6])[ >]", text)

    assert text.count("<h2>A small step &amp; a push</h2>") == 1
    assert text.count(gentle.scenario.definition.why) == 1
    assert len(page.with_tag("img")) == 4
    assert headings[0] == "1" and headings.count("1") == 1
    for before, after in zip(headings[:-1], headings[1:], strict=True):
        assert int(after) <= int(before) + 1


def test_the_conditions_of_a_scenario_are_stated(page):
    """Plant, load, force on the rod and duration, in units."""
    words = "".join(page.words)

    for part in ("load.stiffness = 50 kN/m", "3000 N from 0.5 s for 0.2 s", "0.8 s", "P_0 = 2 bar"):
        assert part in words


def test_margins_are_those_of_the_result(page, gentle):
    """Crossover and margins as analysed."""
    rows = {row[0]: row[1] for row in page.table("margin", "pid_position")}

    assert rows["phase margin"] == number(gentle.loop.phase_margin)
    assert rows["delay margin"] == number(1e3 * gentle.loop.delay_margin)
    assert rows["Ms"] == number(gentle.loop.Ms)


@pytest.mark.slow
def test_controllers_of_one_name_keep_their_own_loops(gentle, tmp_path):
    """Files in two folders can share a name: each run links to its own margins, a shared loop stands once."""
    other = dataclasses.replace(gentle, loop=dataclasses.replace(gentle.loop, phase_margin=12.34))
    page = Page(e.write_report([gentle, other, gentle], tmp_path).read_text())
    links = [attributes["href"] for attributes in page.with_tag("a") if attributes["href"].startswith("#loop-")]
    tables = [dict(row[:2] for row in rows[1:]) for rows in page.tables if rows[0][0] == "margin"]

    assert [table["phase margin"] for table in tables] == [number(gentle.loop.phase_margin), "12.34"]
    assert links[0] == links[2] != links[1]


def test_trips_are_told_apart_by_what_was_expected(page, harsh):
    """Each exceeded limit is named, with the word that the scenario expects it where it does."""
    words = "".join(page.words)
    for trip in harsh.trips:
        expected = trip.limit in harsh.expected_trips

        assert (f"{trip}, as expected" in words) == expected
        assert str(trip) in words


def test_the_end_has_the_provenance(page, gentle):
    """Assumed parameters with value, unit and note; settings of the runs and versions."""
    rows = {row[0]: row for row in page.table("name", "value", "range")}
    runs = page.table("scenario", "controller", "sample time\nms")
    assumed = {label(name) for name, p in gentle.plant.parameters.items() if p.source == "assumed"}
    words = "".join(page.words)

    assert assumed <= set(rows) and "K_T" in assumed
    assert rows["K_T"][1:3] == ["1.2 N m/A", "0.87 to 1.6 N m/A"]
    assert rows["K_T"][3] == gentle.plant.parameters["K_T"].note
    assert runs[0] == ["gentle", "pid_position", "4", "7", "on", "0", "1e-6"]
    assert gentle.nonlinear.trajectory.provenance["numpy"] in words
