"""The page of a fleet: its order, its links, its small lines, and its table in a browser."""

import base64
import json

import numpy as np
import pytest

from ehsa_ctrl.report.grid import Grid, GridColumn, GridRow
from ehsa_ctrl.report.kinds import kinds
from ehsa_ctrl.report.page import FileLink, Links, Table
from ehsa_ctrl.report.results import results_in, write_overview, write_result_page

from .browsing import show, wait

#: Largest page of 200 rigs [bytes].
LARGEST_PAGE = 1_000_000
DAYS = [f"2026-0{month}-01T00:00:00+00:00" for month in range(1, 6)]


#: A second step of a rig.
LATER = {"cause": "rod_friction", "same": ["constant_force"], "since": DAYS[3],
         "size": {"A_FR": {"change": 200.0, "sd": 10.0, "unit": "N"}}}  # fmt: skip


def _rig(name, changed="", unlike="", p=0.5, folder="", logs=5, parameters=("K_T",), further=()):
    """A rig of five logs; a change is a step of `changed` at the third one."""
    rng = np.random.default_rng(sum(map(ord, name)))
    steps = {cause: [[1e-12 * (k >= 2) if cause == changed else 0.0, 1e-13] for k in range(logs)]
             for cause in ("internal_leakage", "payload_mass")}  # fmt: skip
    series = {each: [[0.01 * float(rng.normal()), 0.01] for _ in range(logs)] for each in parameters}
    found = {"file": "a.csv", "verdict": "effect", "causes": [[changed]], "probability": 0.9, "gap_before": 0.2,
             "gap_after": 0.01, "folder": folder, "error": ""}  # fmt: skip
    return {
        "name": name, "changed": bool(changed), "kind": "step" if changed else "", "cause": changed, "same": [],
        "scored": changed, "further": list(further), "since": DAYS[2] if changed else "", "p": p, "q": 2 * p,
        "unlike": unlike, "unlike_q": 0.01,
        "logs": [
            {"file": f"{name}/{k}.csv", "place": f"../{name}/{k}.csv", "date": DAYS[k % 5], "rms": [5.61, 0.88]}
            for k in range(logs)
        ],
        "size": {"K_L": {"change": 1e-12, "sd": 1e-13, "unit": "m3/(Pa s)"}} if changed else {},
        "diagnosis": found if folder else None, "series": series | steps,
    }  # fmt: skip


def _content(rigs, **more):
    counts = {"rigs": len(rigs), "logs": 5 * len(rigs), "changed": sum(rig["changed"] for rig in rigs)}
    parameter = {"name": "K_T", "unit": "N m/A", "nominal": 1.2, "mean": 1.21, "mean_sd": 0.01, "spread": None}
    return {
        "plant": "ehsa", "rate": 0.05, "counts": counts, "causes": ["internal_leakage"], "rigs": rigs,
        "parameters": [parameter], "drifts": [], "failed": {}, "notes": [], "truth": {},
        "score": None, "provenance": {"python": "3.11"},
    } | more  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Two changed rigs of 30, one with a page of its diagnosis, and one unlike the others."""
    root = tmp_path_factory.mktemp("fleet")
    rigs = [_rig(f"rig {k:02d}") for k in range(27)]
    rigs += [
        _rig("slow", "payload_mass", p=1e-3),
        _rig("leaky", "internal_leakage", p=1e-6, folder="diagnoses/a#b", further=[LATER]),
    ]
    rigs.append(_rig("odd", unlike="payload_mass"))
    (root / "diagnoses" / "a#b").mkdir(parents=True)
    (root / "diagnoses" / "a#b" / "diagnosis.html").write_text("<title>its diagnosis</title>")
    (root / "fleet.json").write_text(json.dumps(_content(rigs)))
    return write_result_page(root, "fleet.json")


def test_changed_rigs_come_first_and_lead_to_their_diagnosis(page):
    """The most significant first, then those unlike the fleet, then all others by name; the verdict names them."""
    found = kinds()["fleet.json"].read(json.loads((page.parent / "fleet.json").read_text()), page.parent)
    (grid,) = [block for block in found.sections[0].blocks if isinstance(block, Grid)]
    rows = grid.table.rows

    both = "leaky since 2026-03-01: internal_leakage; 2026-04-01: rod_friction or constant_force."

    assert [row[0] for row in rows[:4]] == ["leaky", "slow", "odd", "rig 00"]
    assert rows[0][1].startswith("△ internal_leakage\nK_L +1e-12 m³/(Pa s)") and rows[0][2] == "2026-03-01"
    assert "2026-04-01: rod_friction or constant_force\nA_FR +200 N" in rows[0][1]
    assert isinstance(rows[0][4], FileLink) and rows[0][4].url == "diagnoses/a%23b/diagnosis.html"
    assert not isinstance(rows[1][4], FileLink)
    assert found.state == "doubt" and both in [s for s, _ in found.sentences]
    # Causes of changes before parameters; the fleet's mean is the middle of a parameter.
    assert [column.name for column in grid.columns] == ["internal_leakage", "payload_mass", "K_T"]
    assert grid.columns[2].middle == pytest.approx(0.01)


def test_in_an_overview_the_links_lead_to_the_same_file(page):
    """The folder of the fleet lies beside it."""
    results, wrong = results_in(page.parent)
    text = write_overview(results, page.parent.parent, "all").read_text(encoding="utf-8")

    assert wrong == [] and 'class="grid"' in text
    (seen,) = [r.sections[0].blocks[0].table.rows[0][4] for r in results_in(page.parent, page.parent.parent)[0]]
    assert seen.url == f"{page.parent.name}/diagnoses/a%23b/diagnosis.html"


def test_every_rig_leads_to_its_logs():
    """The newest first, and no more than the page has room for; where no path leads there, their number alone."""
    rigs = [_rig(f"rig {k}", logs=5) for k in range(400)] + [_rig("far")]
    rigs[-1]["logs"] = [
        log | {"place": place} for log, place in zip(rigs[-1]["logs"], ["", "/etc/a"] * 3, strict=False)
    ]
    few, many = (
        {row[0]: row[-1] for row in kinds()["fleet.json"].read(_content(some), None).sections[0].blocks[-2].table.rows}
        for some in ([rigs[0], rigs[-1]], [rigs[-1], *rigs[:399]])
    )

    assert few["rig 0"] == "5 logs" and few["far"] == "5 logs"
    assert not isinstance(few["far"], Links)
    assert [(str(link), link.file) for link in few["rig 0"].links[:2]] == [
        ("2026-05-01: 5.6 → 0.88", "../rig 0/4.csv"), ("2026-04-01: 5.6 → 0.88", "../rig 0/3.csv")
    ]  # fmt: skip
    assert many["rig 0"] == "5 logs" and len(many["rig 0"].links) == 5
    assert "rig%200/4.csv" in few["rig 0"].seen_from("below").links[0].url


def test_a_folder_outside_is_no_link(tmp_path):
    """An edited JSON leads nowhere."""
    rig = _rig("a", "payload_mass", folder="..")
    found = kinds()["fleet.json"].read(_content([rig]), tmp_path / "store")

    assert not isinstance(found.sections[0].blocks[0].table.rows[0][4], FileLink)


def test_a_fleet_of_two_hundred_rigs_is_small_enough_to_send(tmp_path):
    """And one with a hundred logs each: neighbouring values are averaged."""
    names = [f"P_{k}" for k in range(20)]
    for logs in (5, 100):
        rigs = [_rig(f"rig {k}", "payload_mass" if k < 12 else "", logs=logs, parameters=names) for k in range(200)]
        (tmp_path / "fleet.json").write_text(json.dumps(_content(rigs)))

        assert write_result_page(tmp_path, "fleet.json").stat().st_size < LARGEST_PAGE


def test_codes_are_shares_of_the_range():
    """A column's range is its largest deviation, or eight times the usual one; what lies beyond is at its end."""
    values = [[1.0, 1.1], [0.9, float("nan")], [1.05, 100.0]]
    rows = [GridRow("", [0.0, 7.0], [each], 0, 7.0) for each in values]
    content = Grid(Table("", ["rig"], [["a"], ["b"], ["c"]]), [GridColumn("K", "m", 1.0)], rows, {}).content
    codes = [np.frombuffer(base64.b64decode(row["codes"]), "<i2") for row in content["rows"]]
    (column,) = content["columns"]

    # Median 1.05, absolute deviations 0, 0.05, 0.05, 0.15 and 98.95.
    assert column["range"] == pytest.approx(8 * 1.4826 * 0.05, rel=1e-3)
    np.testing.assert_allclose(codes[0] / 32767 * column["range"], [0.0, 0.1], atol=1e-4)
    assert codes[1][1] == -32768 and codes[2][1] == 32767
    assert content["period"] == [0.0, 7.0]


@pytest.mark.parametrize("width", [390, 1200])
def test_the_table_is_sorted_and_filtered(browser, page, width):
    """In a browser: a small line in each cell, rows by a column's change, rows by words and by state."""
    browser.get_log("browser")
    show(browser, page, width, ready=".grid.drawn td.spark svg")
    script = (
        "return [...document.querySelectorAll('.grid tbody tr')].filter((r) => !r.hidden)"
        ".map((r) => r.cells[0].textContent)"
    )
    choose = (
        "const put = (tag, value, event) => { const e = document.querySelector(`.grid ${tag}`);"
        " e.value = value; e.dispatchEvent(new Event(event)); };"
    )

    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    assert (
        browser.execute_script("return document.querySelectorAll('.grid tbody td.spark:not(.fixed)').length") == 30 * 3
    )
    assert browser.execute_script("return document.querySelectorAll('td.hit').length") == 2
    browser.execute_script("[...document.querySelectorAll('.grid th button')].at(-2).click()")
    assert browser.execute_script(script)[0] == "slow"
    browser.execute_script("[...document.querySelectorAll('.grid th button')].at(0).click()")
    assert browser.execute_script(script)[:2] == ["leaky", "odd"]
    browser.execute_script(f"{choose} put('input', 'LEAK', 'input');")
    assert browser.execute_script(script) == ["leaky"]
    browser.execute_script(f"{choose} put('input', '', 'input'); put('select', 'state unlike', 'change');")
    assert browser.execute_script(script) == ["odd"]
    assert browser.get_log("browser") == []
    browser.execute_script(f"{choose} put('select', 'all', 'change');")
    browser.execute_script("document.querySelector('.grid tbody tr td summary').click()")
    assert (
        browser.execute_script("return document.querySelector('.grid td details a').getBoundingClientRect().height") > 0
    )
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    if width > 1000:
        browser.execute_script("document.querySelector('.grid td a').click()")
        wait(browser, "return document.title === 'its diagnosis'")
