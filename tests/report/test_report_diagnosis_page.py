"""The page of a diagnosis: the verdict first, right numbers, one file, every verdict its own order."""

import re
from functools import cache

import pytest

from ehsa_ctrl import write_report
from ehsa_ctrl.core.result import to_json
from ehsa_ctrl.diagnosis.changed import Change
from ehsa_ctrl.report.figures.free_runs import diagnosis_traces, traces_table
from ehsa_ctrl.report.kinds._diagnosis_law import law_section
from ehsa_ctrl.report.kinds.diagnosis import LAW_VERDICT, VERDICTS
from ehsa_ctrl.report.outcome import outcome
from ehsa_ctrl.report.page import LOOKS
from ehsa_ctrl.report.provenance import provenance
from ehsa_ctrl.report.result_figures import diagnosis_figures
from ehsa_ctrl.report.results import write_result_page
from ehsa_ctrl.report.text import uncertain

from . import diagnoses
from .diagnoses import diagnosis
from .reading import Page, sound

pytestmark = pytest.mark.slow

COMMAND = 'ehsa-ctrl diagnose "my <log>.csv" --plant ehsa'
#: Pages whose figures are drawn; the others have empty ones in their place, as drawing is most of the work.
DRAWN = ("no_gap", "pair")


def page_of(found, folder, **more):
    """The page of a diagnosis with what a command adds to its JSON, and empty figures."""
    folder.mkdir(parents=True, exist_ok=True)
    rests_on = {**provenance([found.plant]), "command": COMMAND}
    (folder / "diagnosis.json").write_text(to_json({**found.to_dict(), "rests_on": rests_on, **more}))
    for stem in ("signals", "where", "unknown_inputs", "candidates", "shrinkage"):
        (folder / f"{stem}.svg").write_text("<svg/>")
    return write_result_page(folder, "diagnosis.json").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Verdict -> the text of its page."""
    folder, found = tmp_path_factory.mktemp("pages"), {}
    for name in diagnoses.VERDICTS:
        if name in DRAWN:
            path = write_report(diagnosis(name), folder / name / "deep")
            assert path.name == "diagnosis.html"
            found[name] = path.read_text(encoding="utf-8")
        else:
            found[name] = page_of(diagnosis(name), folder / name)
    return found


@pytest.fixture(params=diagnoses.VERDICTS)
def verdict(request):
    return request.param


@cache
def parsed(text):
    return Page(text)


@cache
def words_of(text):
    return re.sub(r"\s+", " ", "".join(parsed(text).words))


def test_the_page_is_sound(pages, verdict):
    """One well-formed file that can be sent around."""
    sound(pages[verdict])


def test_text_from_outside_is_no_html(pages, verdict):
    """Names of logs, findings, the next experiment and the command may hold anything."""
    text = pages[verdict]

    assert "<script>alert" not in text and "<b>" not in text and "<against>" not in text
    assert "log &lt;script&gt;alert(1).csv" in text
    assert ("my &lt;log&gt;.csv" in text) == (verdict not in DRAWN)


def test_the_sentence_comes_first_with_its_mark(pages, verdict):
    """Before any section: mark, sentence, and a heading that says the verdict without colour."""
    made = diagnosis(verdict)
    state, heading = VERDICTS[made.verdict] if made.law is None else LAW_VERDICT
    first = words_of(pages[verdict].split("<section")[0] + "</main></body></html>")

    assert f"{LOOKS[state][0]} {made.sentence}" in first
    assert heading in first
    assert len({heading for _, heading in VERDICTS.values()}) == 7


def test_the_sections_have_one_order(pages, verdict):
    """Picture, numbers, why, where and what next, whatever the verdict; no gap makes a short page."""
    made = diagnosis(verdict)
    empty = {
        "causes": not made.effects,
        "law": made.law is None,
        "next": made.next_experiment is None and made.location is None,
        "candidates": not made.candidates,
    }
    parts = ("signals", "gaps", "law", "causes", "where", "next", "candidates")
    expected = [part for part in (parts[:2] if verdict == "no_gap" else parts) if not empty.get(part, False)]
    found = re.findall(r'<h2 id="([^"]+)"', pages[verdict])

    assert found == [*expected, "log", "provenance"]


def test_a_law_leads(pages):
    """It stands before the cause that closes less, which is named as what would be said without it."""
    words = words_of(pages["law"])

    assert "follows a law that the catalogue lacks, which closes 90 % of the total gap" in words
    assert "c_1 * v**3, a force on the rod, resisting extension, with c_1 = 4e+05 N s3/m3" in words
    assert words.index("c_1 * v**3") < words.index("Without the law: internal_leakage")
    assert "the total gap on held-out data falls from 24 % to 0.36 % with the law found" in words


def test_a_cause_stands_with_its_number_and_what_was_believed(pages):
    """Value to the second digit of its deviation, the plant's own value beside it, unit, probability, fingerprint."""
    made = diagnosis("effect")
    row = parsed(pages["effect"]).table("name", "found", "nominal")[0]

    assert row[:4] == ["K_L", uncertain(4e-12, 3e-14), f"{made.plant['K_L']:.4g}".replace("e-0", "e-"), "m³/(Pa s)"]
    words = words_of(pages["effect"])
    assert "probability 0.97" in words and "81 % of the total gap" in words and "25 % of this reduction" in words
    assert "flow error ~ dP" in words


def test_a_sensor_is_read_in_the_unit_of_its_channel(pages):
    """A bias of 50 kPa on a pressure that is believed to be right is half a bar beside none."""
    assert parsed(pages["underdetermined"]).table("name", "found", "nominal")[0] == [
        "bias", "0.5000 ± 0.0050", "0", "bar", "bias of the sensor of p1"
    ]  # fmt: skip


def test_what_no_log_could_tell_is_said_with_its_reason(pages):
    """Apart from what this log alone does not tell."""
    assert "line_pressure_drop: a laminar drop acts as viscous rod friction" in words_of(pages["ambiguous"])
    assert "The data cannot distinguish it from sensor_scale" in words_of(pages["underdetermined"])
    assert "No log with these channels" not in words_of(pages["underdetermined"])


def test_candidates_are_told_what_became_of_them(pages):
    """Named, more than is needed, not to be told from it, excluded; nothing is excluded where nothing is named."""
    fates = {
        name: [row[3] for row in parsed(pages[name]).table("causes", "2 Δ log-likelihood")]
        for name in ("effect", "ambiguous", "outside_catalogue", "underdetermined")
    }

    assert fates["effect"] == ["✓ named", "more than needed", "✗ excluded", "✗ excluded", "✗ excluded"]
    assert fates["ambiguous"][2] == "△ not distinguishable"
    assert set(fates["outside_catalogue"]) == {"✗ does not explain it"}
    assert fates["underdetermined"] == ["△ possible", *["✗ does not explain it"] * 1, "△ possible",
                                        *["✗ does not explain it"] * 2]  # fmt: skip


def test_gaps_stand_in_a_table_with_a_mark_where_they_matter(pages):
    """A column a model; without named causes there is none with them."""
    rows = {row[0]: row[1:] for row in parsed(pages["effect"]).table("signal", "whole log\nnominal")}
    without = parsed(pages["outside_catalogue"]).table("signal", "whole log\nnominal")

    assert rows["pressure P₁"] == ["30 %", "● 30 %", "● 18 %", "1.8 %", "1.5 %"]
    assert rows["rod speed"] == ["0 %"] * 5
    assert {len(row) for row in without} == {5}


def test_own_parts_are_shown_where_there_are_several_causes(pages):
    """One cause has all of it."""
    assert parsed(pages["pair"]).table("cause", "gap closed") == [
        ["internal_leakage", "81 %"],
        ["rod_viscous_friction", "10 %"],
    ]
    assert "Part of each cause" not in pages["effect"]


def test_the_end_has_the_provenance(pages, verdict):
    """Findings, noise, what was set, assumed parameters, versions and the command."""
    made = diagnosis(verdict)
    page, words = parsed(pages[verdict]), words_of(pages[verdict])

    assert "p1 stands <b>still</b> for 3 s" in words and "K_T = 1.1 N m/A" in words
    assert made.held_out in words and made.provenance["numpy"] in words
    assert ["pressure P₁", "0.15", "bar"] in page.table("channel", "noise")
    assert {row[0] for row in page.table("name", "value", "range")} >= {"beta"}


def test_no_gap_makes_a_short_page(pages):
    """One figure, no cause, nothing tried."""
    assert [stem for stem, _ in diagnosis_figures(diagnosis("no_gap"))] == ["signals"]
    assert pages["no_gap"].count("<img") == 1


def test_the_same_diagnosis_gives_the_same_page(pages, tmp_path):
    """No random id, and the date of the environment."""
    path = write_report(diagnosis("no_gap"), tmp_path)

    assert path.read_text(encoding="utf-8") == pages["no_gap"]


def test_the_table_of_signals_has_every_sample(verdict):
    """SI units: what was measured, before, and after where there is something after."""
    made = diagnosis(verdict)
    table = traces_table(made.log.time, diagnosis_traces(made))
    after = {"effect": "with_effects", "ambiguous": "with_effects", "no_gap": None}.get(made.verdict, "refit")
    after = "with_law" if made.law is not None else after

    assert len(table) == len(made.log)
    assert (table["speed"] == made.log["speed"]).all()
    assert (table["p1_before"] == made.simulated["nominal"]["p1"]).all()
    assert table["rod_velocity"].iloc[5] == pytest.approx((made.log["position"][5] - made.log["position"][0]) / 0.02)
    if after is None:
        assert "p1_after" not in table
    else:
        assert (table["p1_after"] == made.simulated[after]["p1"]).all()


CLOSED = {
    "scenario": "steps", "controller": "pid <b>", "plants": ["believed", "improved"],
    "metrics": {"RMSError": {"believed": 1e-3, "improved": 2e-3, "unit": "m"},
                "RiseTime": {"believed": None, "improved": float("nan"), "unit": "s"}},
    "failures": {"believed": [], "improved": ["MaxError 9 mm (at most 3 mm)"]},
    "replay": {"gap": {"believed": {"speed": 0.1}, "improved": {"speed": 0.01}}, "seconds": 2.0,
               "current_not_of_this_loop": 0.5},
}  # fmt: skip


def test_what_it_means_for_the_loop_is_shown_where_it_was_asked(tmp_path):
    """Metrics before and after in the unit that is read, the verdict at the top, the doubt about the log."""
    (tmp_path / "closed_loop.json").write_text(to_json(CLOSED))
    text = page_of(diagnosis("effect"), tmp_path)
    page = Page(text)
    rows = page.table("metric", "nominal plant", "improved plant")

    assert rows == [["RMSError", "1", "2", "mm"], ["gap in speed", "10", "1", "%"]]
    assert "MaxError 9 mm (at most 3 mm)" in text.split("<table")[0]
    assert "differs by 50 % from the output of this controller" in text
    assert page.wrong == [] and page.open == [] and "pid <b>" not in text


def test_what_changed_comes_before_the_rest(tmp_path):
    """The earlier log, how the plant was brought to it, and the values that this took."""
    before, after = diagnosis("no_gap"), diagnosis("effect")
    rig = before.plant.set(M=1.25 * before.plant["M"])
    change = Change(before, after, rig, "it has no relevant gap")
    text = page_of(change.after, tmp_path, **change.to_dict())
    page = Page(text)

    assert page.table("name", "nominal", "then") == [["M", "16.52", "20.65", "kg"]]
    assert "Changed between the logs: internal_leakage" in text.split("<h2")[0]
    assert text.index('id="changed"') < text.index('id="signals"')
    assert page.wrong == [] and page.open == []


def test_what_contains_a_rival_is_not_called_excluded():
    """A cause in another's place that this log does not tell apart, with one more beside it, is more than is needed."""
    made = diagnosis("ambiguous")
    rival = made.effects[0].ambiguous_with[0]
    causes = {cause.name: cause.ambiguous_with for cause in made.effects}
    hypotheses = ((rival,), (rival, "unequal_areas"), ("unequal_areas",), ("unequal_areas", "backlash"))

    assert [outcome(made.verdict, causes, members) for members in hypotheses] == [
        "equivalent", "redundant", "excluded", "excluded",
    ]  # fmt: skip


def test_a_law_that_its_curve_hardly_shows_says_where_the_evidence_is(pages):
    """A valve is open for some samples at a time: its flow explains nothing of the unknown input over the pressure."""
    content = diagnosis("law").to_dict()
    seen, hidden = (
        " ".join(str(part) for part in law_section(content | {"law": content["law"] | {"explained": share}}).blocks)
        for share in (0.8, 0.02)
    )

    assert "explains 2 % of the unknown input" in hidden and "The evidence for it is the simulation" in hidden
    assert "of the unknown input, so that" not in seen
