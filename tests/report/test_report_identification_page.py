"""Pages of an identification and of a comparison: verdict first, right numbers, one file, the same each time."""

import dataclasses
import re

import numpy as np
import pytest

from ehsa_ctrl import write_report
from ehsa_ctrl.core.result import plain, to_json
from ehsa_ctrl.core.text import join_words
from ehsa_ctrl.identification.checks import LogFinding
from ehsa_ctrl.identification.identification import FreeRuns
from ehsa_ctrl.identification.preparation import Step
from ehsa_ctrl.report.kinds.identification import KIND
from ehsa_ctrl.report.results import write_result_page
from ehsa_ctrl.report.text import NOTHING, number, uncertain
from ehsa_ctrl.report.write import comparison_dict

from .reading import Page, sound

pytestmark = pytest.mark.slow

WARNING = LogFinding("dead", "p1", "warning", "my <log>.csv: p1 stands still; look at its sensor")


@pytest.fixture(scope="module")
def identified(fitting, failing, tmp_path_factory):
    """The page of a model that fails and one that fits."""
    warned = dataclasses.replace(failing, findings=(WARNING,))
    return write_report([warned, fitting], tmp_path_factory.mktemp("page")).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def unsure(vague, tmp_path_factory):
    """The page of one model of which little is known."""
    return write_report(vague, tmp_path_factory.mktemp("page")).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def compared(fitting, failing, tmp_path_factory):
    """The page of two replays of a log."""
    replays = [failing.validation.after[0], fitting.validation.after[0]]
    more = {
        "findings": [WARNING.to_dict()],
        "untold": ["without p2 the log does not show V_20"],
        "preparation": [{"log": "a.csv", **Step("zero", "p1: zero moved by 0.1 bar").to_dict()}],
    }
    return compared_page(replays, tmp_path_factory.mktemp("page"), **more)


def compared_page(replays, folder, **more):
    """The page of a comparison with what a command adds to its JSON, and an empty figure."""
    (folder / "comparison.json").write_text(to_json({**comparison_dict(replays), **more}))
    (folder / "compare.svg").write_text("<svg/>")
    return write_result_page(folder, "comparison.json").read_text(encoding="utf-8")


def sentences_of(found, tmp_path):
    """The sentences of an identification's page, and the state of all."""
    content = {**found.to_dict(), "model": found.plant.model, "plant": "ehsa", "settings": {}}
    page = KIND.read(plain(content), tmp_path)
    return [words for words, _ in page.sentences], page.state


@pytest.fixture(params=["identified", "unsure", "compared"])
def text(request):
    """Each of the pages."""
    return request.getfixturevalue(request.param)


def top(text):
    """What stands before the first table, without tags."""
    body = text[text.index("<main>") : text.index("<table")]
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body))


def test_the_page_is_sound(text):
    """One well-formed file that can be sent around, with figures."""
    sound(text)
    assert "<img" in text


def test_names_of_files_are_no_html(identified, compared):
    """A log may be called anything."""
    assert "<script>alert" not in identified + compared
    assert "noise &lt;script&gt;alert(1).csv" in identified
    assert "my &lt;log&gt;.csv" in identified and "my &lt;log&gt;.csv" in compared


def test_the_same_results_give_the_same_page(unsure, vague, tmp_path):
    """No random id, and the date of the environment; a folder that is missing is made."""
    again = write_report(vague, tmp_path / "a" / "deep")

    assert again.name == "report.html" and again.read_text(encoding="utf-8") == unsure


def test_the_verdict_comes_first(identified, fitting, failing):
    """How many parameters of each model, the worst fit held out before and after, and what is left."""
    words = top(identified)
    worst = min(fitting.validation.fit_percent, key=fitting.validation.fit_percent.get)
    good = sum(e.identifiable for e in failing.estimates)

    assert f": {good} of 6 (linear) and 4 of 4 (nonlinear) parameters well determined" in words
    assert (
        f"In free run on steps.csv, held out, the worst fit, that of {worst}, changed from "
        f"{number(fitting.validation.fit_percent_before[worst])} % to {number(fitting.validation.fit_percent[worst])} %"
    ) in words
    assert "The simulation does not fit within the noise" in words
    assert "The residuals are sensor noise" in words.replace("&#39;", "'")


def test_the_table_of_parameters_is_that_of_the_result(identified, fitting):
    """Value to the second digit of its deviation, unit, relative deviation, verdict, start, interval, meaning."""
    rows = {row[0]: row for rows in Page(identified).tables if rows[0][:2] == ["name", "value"] for row in rows[1:]}
    meanings = {kind.name: kind.meaning for kind in fitting.plant.structure.equations.parameters}

    for e in fitting.estimates:
        low, high = e.interval
        assert rows[e.name] == [
            e.name, uncertain(e.value, e.sd), rows[e.name][2], f"{100 * e.relative_sd:.2g} %", "✓ well determined",
            number(e.start), f"{number(low)} to {number(high)}", meanings[e.name],
        ]  # fmt: skip
    assert rows["J_M"][2] == "kg m²"


def test_what_is_not_known_is_said(unsure, vague):
    """Verdict by mark and word, no interval without a deviation, bound, trade and prior; first in the page too."""
    rows = {row[0]: row for rows in Page(unsure).tables if rows[0][:2] == ["name", "value"] for row in rows[1:]}
    endless, bound = vague.estimates[:2]
    words = top(unsure)

    assert rows[endless.name][3:5] == [NOTHING, "✗ not identifiable from this log\ncorrelated with V_10"]
    assert rows[endless.name][6] == "unbounded"
    assert rows[bound.name][4].startswith(
        "△ poorly determined\nat its lower bound\ncorrelated with bias.position\nprior"
    )
    assert rows["bias.position"][7] == "bias of the sensor of position"
    assert "2 of 4 parameters are well determined; not identifiable from this log: J_M; " in words
    assert "poorly determined: V_10." in words
    assert "used to identify, as none was held out" in words


def test_fits_stand_in_tables(identified, fitting, failing):
    """Linear beside nonlinear; each before and after, used and held out, to a tenth of a percent."""
    page = Page(identified)
    beside = {row[0]: row[1:] for row in page.table("channel", "used\nlinear", "used\nnonlinear")}
    own = [rows[1:] for rows in page.tables if rows[0][:2] == ["channel", "used\nbefore"]][1]
    reaches = (fitting.train, fitting.validation)

    for channel, cells in beside.items():
        reached = (failing.train, fitting.train, failing.validation, fitting.validation)
        assert cells == [f"{reach.fit_percent[channel]:.1f}" for reach in reached]
    for row in own:
        fits = [fits[row[0]] for reach in reaches for fits in (reach.fit_percent_before, reach.fit_percent)]
        assert row[1:] == [f"{fit:.1f}" for fit in fits]


def test_residual_tests_and_weights_stand_in_tables(identified, failing):
    """Each test with its largest correlation and verdict; weights beside the sensors' noise, in shown units."""
    page = Page(identified)
    tests = page.table("residual of", "with")
    weights = {row[0]: row[1:] for row in page.table("channel", "weight")}

    assert [row[:3] for row in tests] == [[t.channel, t.against, number(t.largest)] for t in failing.residual_tests]
    assert [row[-1] for row in tests] == ["✓ yes" if t.passed else "✗ no" for t in failing.residual_tests]
    assert weights["position"][0] == number(1e3 * failing.noise_sd["position"]) and weights["position"][2] == "mm"


def test_the_other_method_stands_beside(identified, fitting):
    """Each parameter by both methods, and how far they are apart; how well the balances close."""
    page = Page(identified)
    tables = [rows[1:] for rows in page.tables if rows[0][:3] == ["name", "by simulation", "by balances"]]
    rows = {row[0]: row for row in tables[1]}
    other = {e.name: e for e in fitting.other_estimates}
    (closing,) = [rows[1:] for rows in page.tables[len(page.tables) // 2 :] if rows[0][:2] == ["balance", "residual"]]

    assert set(rows) == {e.name for e in fitting.estimates} & set(other)
    one, its = fitting["J_M"], other["J_M"]
    apart = abs(one.value - its.value) / np.hypot(one.sd, its.sd)
    assert rows["J_M"][1:3] == [uncertain(one.value, one.sd), uncertain(its.value, its.sd)]
    assert float(rows["J_M"][4]) == pytest.approx(apart, abs=0.06)
    assert [row[0] for row in closing] == [fit.name for fit in fitting.balances.balances]


def test_the_end_has_the_provenance(identified, fitting):
    """Logs, starts, findings, assumed parameters and versions."""
    page = Page(identified)
    words = "".join(page.words)

    assert {row[0] for row in page.table("name", "value", "range")} >= {"K_T"}
    assert "steps.csv" in words and WARNING.sentence in words
    assert f"{fitting.starts[0][0]}: {number(fitting.starts[0][1])}" in words
    assert fitting.provenance["numpy"] in words


def test_a_verdict_is_bad_where_something_is(fitting, failing, vague, tmp_path):
    """All well with the right model; not with one that can't fit, that knows too little, or that was interrupted."""
    worse = dataclasses.replace(fitting, validation=FreeRuns(fitting.validation.before, fitting.validation.after))
    ended = dataclasses.replace(fitting.validation.after[0], stopped="the rod left its stroke.")
    early = dataclasses.replace(fitting, validation=FreeRuns((ended,), fitting.validation.before))
    untested = dataclasses.replace(fitting, fit=None, residual_tests=())
    states = [sentences_of(each, tmp_path)[1] for each in (failing, vague, worse, early)]

    assert sentences_of(fitting, tmp_path)[1] is not False and sentences_of(untested, tmp_path)[1] is not False
    assert states == [False] * 4
    assert sentences_of(dataclasses.replace(fitting, interrupted=True), tmp_path)[1] is False
    assert "decreased" in sentences_of(worse, tmp_path)[0][1]
    assert sentences_of(early, tmp_path)[0][1].endswith("the simulation stopped early: the rod left its stroke.")
    assert sentences_of(dataclasses.replace(untested, no_simulation="the start is too far off"), tmp_path)[1] is False


def test_balances_say_how_well_they_close(fitting, tmp_path):
    """Where the estimate is theirs, each balance's error is part of the verdict."""
    by_balances = dataclasses.replace(
        fitting, method="balances", estimates=fitting.other_estimates, other_estimates=fitting.estimates
    )
    words = sentences_of(by_balances, tmp_path)[0][0]

    for fit in fitting.balances.balances:
        assert f"{number(100 * fit.relative_error)} % ({fit.name})" in words


def test_a_comparison_says_how_well_each_model_fits(compared, fitting, failing):
    """Range of the fits first, then a table; what was done to the log, what is doubtful, what it can't tell."""
    page = Page(compared)
    linear, nonlinear = (found.validation.after[0].fit_percent for found in (failing, fitting))
    worst, best = min(nonlinear, key=nonlinear.get), max(nonlinear, key=nonlinear.get)
    words = top(compared)

    assert "Comparison of steps.csv with ehsa" in words
    assert f"from {number(nonlinear[worst])} % ({worst}) to {number(nonlinear[best])} % ({best})" in words
    assert page.table("channel", "linear", "nonlinear") == [
        [channel, f"{linear[channel]:.1f}", f"{nonlinear[channel]:.1f}"] for channel in nonlinear
    ]
    for sentence in (WARNING.sentence, "without p2 the log does not show V_20", "p1: zero moved by 0.1 bar"):
        assert sentence in "".join(page.words)


def test_a_comparison_with_a_run_that_ended_says_why(fitting, tmp_path):
    """No fit is made up for it."""
    run = fitting.validation.after[0]
    ended = dataclasses.replace(run, stopped="the pressure fell.", fit_percent=dict.fromkeys(run.fit_percent, np.nan))
    text = compared_page([ended], tmp_path)

    assert "no fit, as the free run stopped early: the pressure fell." in top(text)
    assert {row[1] for row in Page(text).table("channel", "nonlinear")} == {NOTHING}
    assert "The log was used as recorded." in text


def test_words_are_listed_as_in_a_sentence():
    """A comma between, "and" before the last."""
    assert [join_words(words) for words in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]
