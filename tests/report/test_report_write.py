"""A result that was computed in Python has its page too."""

import dataclasses

import pytest

import ehsa_ctrl as e

from .diagnoses import diagnosis
from .reading import Page

pytestmark = pytest.mark.slow


@pytest.fixture
def of_each(gentle, harsh, fitting):
    """What is written, by the file of its page."""
    return {
        "run": (gentle, "report.html"),
        "runs": ([gentle, harsh], "report.html"),
        "identification": (fitting, "report.html"),
        "replay": (fitting.train.after[0], "report.html"),
        "diagnosis": (diagnosis("effect"), "diagnosis.html"),
    }


@pytest.mark.parametrize("name", ["run", "runs", "identification", "replay", "diagnosis"])
def test_a_result_is_a_page(of_each, name, tmp_path):
    """One sound file in a folder that is made for it; nothing of a command line is in it."""
    result, file = of_each[name]

    path = e.write_report(result, tmp_path / "new" / "folder")
    text = path.read_text(encoding="utf-8")
    page = Page(text)

    assert path == tmp_path / "new" / "folder" / file
    assert page.wrong == [] and page.open == [] and text.count("<img") >= 1
    assert "Command:" not in text


def test_a_page_is_replaced_only_when_told(gentle, tmp_path):
    """One sentence, and what to say."""
    e.write_report(gentle, tmp_path)

    with pytest.raises(e.InputError, match=r"report\.html: is part of an earlier result; .* force=True"):
        e.write_report(gentle, tmp_path)
    page = e.write_report(gentle, tmp_path, force=True)
    page.write_text("edited")
    with pytest.raises(e.InputError, match=r"report\.html: was edited since write_report wrote it"):
        e.write_report(gentle, tmp_path, force=True)
    assert page.read_text() == "edited"


def test_what_has_no_page_is_said(gentle, fitting, tmp_path):
    """Which have, and what else there is; results of two kinds don't share one."""
    with pytest.raises(
        e.InputError,
        match=r"got a Log, which has no page; expected Change, Comparison, Diagnosis",
    ):
        e.write_report(fitting.train.after[0].log, tmp_path)
    with pytest.raises(e.InputError, match=r"got a LoopAnalysis, which has no page; .*; use its plot\(\)"):
        e.write_report(gentle.loop, tmp_path)
    with pytest.raises(e.InputError, match="ScenarioResult and Identification can't share a page"):
        e.write_report([gentle, fitting], tmp_path)
    with pytest.raises(e.InputError, match="got no result"):
        e.write_report([], tmp_path)
    with pytest.raises(e.InputError, match="is a file; give a folder"):
        e.write_report(gentle, __file__)


def test_many_reasons_are_counted(gentle, harsh, tmp_path):
    """A sentence names the first three; the page of the run has all of them, and the terminal's line stays short."""
    reasons = tuple(f"baseline: metric {k} was 1 and is 2" for k in range(18))
    failing = dataclasses.replace(gentle)
    vars(failing)["failures"] = reasons

    text = e.write_report(failing, tmp_path).read_text(encoding="utf-8")
    first = str(failing).splitlines()[0]

    assert first.endswith("FAILED: " + "; ".join([*reasons[:3], "and 15 more"]))
    assert text.count("metric 17 was 1") == 1 and "and 15 more" in text[: text.index("<table")]
