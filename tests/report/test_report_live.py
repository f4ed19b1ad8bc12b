"""Charts that zoom: their numbers, and the pages in a browser."""

import base64
import dataclasses
import json
import re
import time
import zlib

import numpy as np
import pandas
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.diagnosis.closed_loop_replay import ClosedLoopReplay
from ehsa_ctrl.report import document
from ehsa_ctrl.report.kinds._charts import free_run_chart, loop_replay_chart, run_chart, simulation_chart
from ehsa_ctrl.report.live import encode, pack, payloads, thin
from ehsa_ctrl.report.page import Picture
from ehsa_ctrl.report.result_tables import diagnosis_tables, save_tables, simulation_tables
from ehsa_ctrl.report.signals import spans

from .browsing import show, wait
from .diagnoses import diagnosis

#: Largest page of a 24 s log of eight channels [bytes].
LARGEST_PAGE = 1_000_000


def test_thinning_keeps_the_extremes():
    """A peak of a single sample stays, and the two values of a part come in the order of time."""
    values = np.zeros(1000)
    values[[502, 507]] = 5.0, -3.0

    kept = thin(values, 50)

    assert kept.size == 100
    assert list(kept[50:52]) == [5.0, -3.0]
    assert np.isnan(thin(np.full(10, np.nan), 2)).all()


def test_thinning_is_that_of_a_loop_over_the_parts():
    """Uneven parts, a part without values, infinities: least and largest finite value of each, by their place."""
    values = np.random.default_rng(0).normal(size=103)
    values[[3, 40, 41, 90]] = np.nan, np.inf, -np.inf, np.nan
    values[50:70] = np.nan

    kept = thin(values, 12).reshape(12, 2)

    edges = np.linspace(0, 103, 13).astype(int)
    for pair, part in zip(kept, np.split(values, edges[1:-1]), strict=True):
        known = part[np.isfinite(part)]
        expected = [v for v in known if v in (known.min(), known.max())] if known.size else [np.nan, np.nan]
        np.testing.assert_array_equal(pair, expected)


def test_packed_values_come_back_within_their_resolution():
    """16 bits resolve a line to a 65000th of its span; missing values stay missing. Read as the page's script does."""
    lines = [np.array([-3.0, np.nan, 0.1234, 7.0, np.inf]), np.linspace(1.0, -1.0, 5)]
    encoded = [encode(line) for line in lines]
    planes = np.frombuffer(zlib.decompress(base64.b64decode(pack([codes for _, _, codes in encoded]))), np.uint8)
    low, high = planes.astype(int).reshape(2, 2, 5)
    codes = np.cumsum(low + 256 * high, axis=1).astype(np.uint16).view(np.int16)

    assert list(codes[0, [1, 4]]) == [-32768, -32768]
    for (least, largest, _), line, code in zip(encoded, lines, codes, strict=True):
        read = np.where(code == -32768, np.nan, least + (code.astype(float) + 32767) / 65534 * (largest - least))
        known = np.isfinite(line)
        np.testing.assert_allclose(read[known], line[known], atol=10.0 / 65534)


def test_a_long_log_of_noise_takes_less_than_half_a_megabyte(tmp_path):
    """24 s of eight channels at 250 Hz, measured, before and after: white noise, which nothing compresses."""
    rng, time = np.random.default_rng(0), 0.004 * np.arange(6000)
    names = ["speed", "p1", "p2", "position", "velocity", "force", "current_measured"]
    columns = {"t": time, "current": rng.normal(size=6000)}
    columns |= {f"{name}{end}": rng.normal(size=6000) for name in names for end in ("", "_before", "_after")}
    pandas.DataFrame(columns).to_csv(tmp_path / "signals.csv", index=False)
    chart = free_run_chart(tmp_path, "signals.csv", [Picture("signals", "Signals")])

    (found,) = payloads([(chart, tmp_path)])

    assert found["samples"] == 6000 and len(found["panels"]) == 8
    assert len(json.dumps(found)) < LARGEST_PAGE / 2


def test_spans_last_until_the_next_sample():
    """Two parts, the second up to the end of the run."""
    assert spans(np.arange(5.0), np.array([True, False, True, True, True])) == [(0.0, 1.0), (2.0, 4.0)]


def test_without_the_library_the_page_says_how_to_get_it(tmp_path, monkeypatch, gentle):
    """The printed figures are all there, and a sentence names the extra."""
    monkeypatch.setattr(document, "chart_library", lambda: None)

    page = e.write_report(gentle, tmp_path).read_text(encoding="utf-8")

    assert 'pip install "ehsa_ctrl[live]"' in page
    assert "application/json" not in page and "<img" in page


def test_a_damaged_table_leaves_the_printed_figure(tmp_path, gentle):
    """A user's edit of a CSV file is named in a sentence, and the rest of the page is as before."""
    from ehsa_ctrl.core.result import to_json
    from ehsa_ctrl.report.results import write_result_page
    from ehsa_ctrl.report.write import RESULTS

    _, store, _ = RESULTS[type(gentle)]
    stored = store([gentle])
    (tmp_path / "results.json").write_text(to_json(stored.content))
    for name, table in stored.tables:
        table.to_csv(tmp_path / name, index=False)
        text = (tmp_path / name).read_text()
        (tmp_path / name).write_text(text.replace("\n0.004,", "\nabc,", 1))

    page = write_result_page(tmp_path, "results.json").read_text(encoding="utf-8")

    assert "is not a table of numbers" in page
    assert "application/json" not in page


@pytest.fixture(scope="module")
def pages(tmp_path_factory, gentle):
    """A diagnosis and a scenario as pages."""
    root = tmp_path_factory.mktemp("live")
    return {
        "diagnosis": e.write_report(diagnosis("effect"), root / "diagnosis"),
        "run": e.write_report(gentle, root / "run"),
    }


def painted(browser, colour, panel):
    """Pixels of a colour (r, g, b) in the canvas of a panel."""
    script = """
    const canvas = document.querySelectorAll('.live .uplot canvas')[arguments[3]];
    const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    let count = 0;
    for (let k = 0; k < data.length; k += 4)
      if (data[k + 3] > 200 && [0, 1, 2].every((j) => Math.abs(data[k + j] - arguments[j]) < 12)) count++;
    return count;"""
    time.sleep(0.2)
    return browser.execute_script(script, *colour, panel)


@pytest.mark.parametrize("kind", ["diagnosis", "run"])
@pytest.mark.parametrize("width", [390, 1200])
def test_a_page_fits_its_window_and_asks_for_nothing(browser, pages, kind, width):
    """No sideways scrolling, no error in the console, no request but for the file itself."""
    browser.get_log("performance"), browser.get_log("browser")

    show(browser, pages[kind], width)
    sent = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [each["params"]["request"]["url"] for each in sent if each["method"] == "Network.requestWillBeSent"]

    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    assert browser.get_log("browser") == []
    assert [url for url in urls if not url.startswith("data:")] == [pages[kind].as_uri()]


def test_a_page_is_small_enough_to_send(pages):
    """Below a megabyte, for a run of eight seconds too."""
    assert all(path.stat().st_size < LARGEST_PAGE for path in pages.values())


def test_dragging_zooms_all_panels(browser, pages):
    """A drag over the middle of one panel shows the same part in all of them; 0 shows the whole run."""
    from selenium.webdriver import ActionChains
    from selenium.webdriver.common.by import By

    show(browser, pages["run"], 1200)
    panels = browser.find_elements(By.CSS_SELECTOR, ".live .u-over")
    chart = browser.find_element(By.CSS_SELECTOR, ".live .chart")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", panels[1])
    ActionChains(browser).move_to_element_with_offset(panels[1], -100, 0).click_and_hold().move_by_offset(
        200, 0
    ).release().perform()

    wait(browser, "return document.querySelector('.live .chart').dataset.from > 0")
    start, end = (float(chart.get_attribute(f"data-{side}")) for side in ("from", "to"))
    share = 200 / panels[1].size["width"]
    assert end - start == pytest.approx(0.8 * share, rel=0.05)
    chart.send_keys("0")
    assert float(chart.get_attribute("data-to")) == pytest.approx(0.8, abs=0.005)


def test_switches_take_lines_away(browser, pages):
    """The measurement goes with its switch and comes back, by keyboard too; the effect's button swaps the two runs."""
    from selenium.webdriver.common.by import By

    sky, vermilion, panel = (0x56, 0xB4, 0xE9), (0xD5, 0x5E, 0x00), 1
    show(browser, pages["diagnosis"], 1200)
    boxes = browser.find_elements(By.CSS_SELECTOR, ".switches input")
    assert painted(browser, sky, panel) > 0

    boxes[0].send_keys(" ")
    assert painted(browser, sky, panel) == 0
    boxes[0].click()
    assert painted(browser, sky, panel) > 0

    button = browser.find_element(By.CSS_SELECTOR, ".switches button")
    button.click()
    assert button.get_attribute("aria-pressed") == "true"
    assert [box.is_selected() for box in boxes] == [True, False, True]
    assert painted(browser, vermilion, panel) > 0
    button.click()
    assert [box.is_selected() for box in boxes] == [True, True, False]
    assert painted(browser, vermilion, panel) == 0


def test_a_click_on_a_regime_marks_its_samples(browser, pages):
    """A point of the curve marks bands in the panels; Escape takes them away."""
    from selenium.webdriver.common.by import By

    show(browser, pages["diagnosis"], 1200)
    chart = browser.find_element(By.CSS_SELECTOR, ".live .chart")
    curve = browser.find_element(By.CSS_SELECTOR, ".regime")
    before = painted(browser, (242, 194, 0), 0)
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", curve)
    browser.find_element(By.CSS_SELECTOR, ".regime .u-over").click()

    wait(browser, "return document.querySelector('.live .chart').dataset.marked > 0")
    assert re.search(r"Marked: .* s of the run", chart.text)
    curve.send_keys("\ue00c")
    wait(browser, "return document.querySelector('.live .chart').dataset.marked == 0")
    assert before == 0


def test_print_shows_every_section_and_the_printed_figures(browser, pages):
    """In print the live chart is gone, its figure is there, and folded sections are open."""
    show(browser, pages["diagnosis"], 1200)
    assert browser.execute_script("return [...document.querySelectorAll('details')].every((each) => !each.open)")

    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    browser.execute_script("dispatchEvent(new Event('beforeprint'))")
    shown = browser.execute_script(
        "return ['.live', '.replaced img', 'details'].map((s) => document.querySelector(s).getClientRects().length > 0)"
    )
    opened = browser.execute_script("return [...document.querySelectorAll('details')].every((each) => each.open)")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})

    assert shown == [False, True, True]
    assert opened


def test_a_system_of_its_own_has_a_chart_of_its_signals(tmp_path):
    """The carriage: its drive force and both states, in usual units; the prescribed force that is zero has none."""
    plant = e.load_plant("emps")
    run = e.simulate(plant, 30.0 * np.sin(np.linspace(0.0, 6.0, 400)), sample_time=1e-3)
    save_tables(simulation_tables(run), tmp_path)
    content = {"model": "nonlinear", "exceeded": [], **run.shown()}

    chart = simulation_chart(tmp_path, content, [])
    (found,) = payloads([(chart, tmp_path)])

    assert [(panel["name"], panel["unit"]) for panel in found["panels"]] == [
        ("F_M", "N"), ("speed v", "mm/s"), ("position", "mm"),
    ]  # fmt: skip
    assert found["panels"][0]["lines"][0]["high"] == pytest.approx(30.0, rel=1e-3)
    assert [strip["label"] for strip in found["strips"]] == ["rod sticks"]


def test_a_replay_in_closed_loop_shows_what_the_models_leave_of_the_position(tmp_path):
    """The error first, then position and drive; a run that ended early has no values after its end."""
    found = diagnosis("effect")
    time = found.log.time
    runs = {name: {"position": scale * time[:end], "drive": np.sin(time[:end])}
            for name, scale, end in (("nominal", 0.9, 50), ("with_effects", 1.0, time.size))}  # fmt: skip
    gap = {name: {"position": 0.1} for name in runs}
    loop = ClosedLoopReplay(
        "pid", 0, gap, gap, {}, {}, {}, 0.0, 0.0, time, {"position": time, "drive": np.sin(time)}, runs
    )
    save_tables(diagnosis_tables(dataclasses.replace(found, closed_loop=loop)), tmp_path)

    chart = loop_replay_chart(tmp_path, [], "after", found.held_spans)
    (shown,) = payloads([(chart, tmp_path)])
    error = shown["panels"][0]

    assert [panel["name"] for panel in shown["panels"]] == ["position, measured − simulated", "position", "current"]
    assert error["lines"][0]["high"] == pytest.approx(100.0 * time[49]) and error["lines"][1]["label"] == "after"
    assert shown["shaded"] == [[1.6, 2.4]]
    assert list(pandas.read_csv(tmp_path / "closed_loop_replay.csv")["position_before"].isna()) == [
        k >= 50 for k in range(time.size)
    ]


def test_the_chart_of_an_identification_names_its_log(fitting, tmp_path):
    """Above the chart, once: the figure below it that is printed repeats no heading."""
    page = e.write_report(fitting, tmp_path).read_text(encoding="utf-8")

    assert len(re.findall(r"<h3>Before and after on ", page)) == len(fitting.validation.after or fitting.train.after)
    assert page.index("<h3>Before and after on ") < page.index('class="live"')


def test_a_result_of_an_earlier_version_has_its_figures_alone(tmp_path):
    """It does not state its signals: no chart of a part of them."""
    (tmp_path / "s.csv").write_text("t,reference,x_nonlinear,F_cell_nonlinear\n0,0,0,0\n1,0,0,0\n")
    run = {"controller": "pid", "trips": []}
    stated = run | {"signals": {"x": "m"}, "inputs": [], "contacts": []}

    assert run_chart(tmp_path, [("s", run)]) is None
    panels = run_chart(tmp_path, [("s", stated)]).panels
    assert [(panel.how.words, panel.how.unit) for panel in panels] == [("position", "mm"), ("force", "kN")]
