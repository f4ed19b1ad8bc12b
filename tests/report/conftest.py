"""Scenarios that pass and fail, identifications that fit and don't, made once for all tests of the report."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.definition import validate
from ehsa_ctrl.core.result import to_json
from ehsa_ctrl.identification.identification import FreeRuns
from ehsa_ctrl.identification.identify import identify
from ehsa_ctrl.report.live import chart_library
from ehsa_ctrl.report.provenance import provenance
from ehsa_ctrl.scenario.definition import Scenario, ScenarioFile
from ehsa_ctrl.scenario.run import run

from .contents import contents

GENTLE = {
    "schema": 1,
    "title": "A small step & a push",
    "why": "The report needs a run that keeps its limits.",
    "plant": "ehsa",
    "controller": "pid_position",
    "duration": "0.8 s",
    "load": {"stiffness": "50 kN/m"},
    "reference": {"kind": "steps", "times": ["0.1 s"], "positions": ["5 mm"]},
    "disturbance": [{"force": "3 kN", "start": "0.5 s", "duration": "0.2 s"}],
    "sensors": {"seed": 7},
    "limits": {"Overshoot": {"max": "200 %"}, "MaxError": {"min": "1 mm", "max": "20 mm"}},
}
HARSH = GENTLE | {
    "title": "A step that no pump can follow",
    "why": "The report needs a run that fails.",
    "settings": {"P_0": "2 bar"},
    "reference": {"kind": "steps", "times": ["0.1 s"], "positions": ["95 mm"]},
    "limits": {"MaxError": {"max": "1 mm"}},
    "expect_trips": ["pressure_min", "stroke"],
}


def result_of(name, content):
    return run(Scenario(name, validate(content, ScenarioFile, name)))


@pytest.fixture(scope="session", autouse=True)
def _fixed_date():
    """One date in all pages, so that two pages of a result are the same even if a minute passes between them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "1777897800")
        yield


@pytest.fixture(scope="session")
def gentle():
    """Passes its limits and those of the plant."""
    return result_of("gentle", GENTLE)


@pytest.fixture(scope="session")
def harsh():
    """Fails a limit, passes limits of the plant, and misses a trip that it expects."""
    return result_of("harsh", HARSH)


#: A file's name that is no HTML.
AWKWARD = "noise <script>alert(1).csv"


@pytest.fixture(scope="session")
def bench_logs():
    """Noise to identify from and steps to hold out, of the nonlinear plant."""
    plant = ehsa_ctrl.load_plant("ehsa")
    logs = []
    for seed, (kind, amplitude, duration, name) in enumerate(
        (("noise", 3, 8, AWKWARD), ("steps", 1.5, 4, "steps.csv"))
    ):
        made = ehsa_ctrl.excitation(kind, amplitude=amplitude, duration=duration, sample_time=0.004, seed=seed)
        log, _ = ehsa_ctrl.record(plant, *made, centre=True, seed=seed)
        logs.append(dataclasses.replace(log, path=Path(name)))
    return logs


@pytest.fixture(scope="session")
def fitting(bench_logs):
    """The plant that made the logs, with four parameters 30 % off at the start."""
    plant = ehsa_ctrl.load_plant("ehsa")
    free = ("J_M", "V_10", "A_FM", "A_FR")
    start = plant.set(**{name: 1.3 * plant[name] for name in free})
    return identify(start, bench_logs[0], validate=[bench_logs[1]], fix=[n for n in plant.free if n not in free])


@pytest.fixture(scope="session")
def failing(bench_logs):
    """The linear plant, which can't follow the same logs."""
    return identify(ehsa_ctrl.load_plant("ehsa", model="linear"), bench_logs[0], validate=[bench_logs[1]])


@pytest.fixture(scope="session")
def vague(fitting):
    """Nothing held out; a parameter without any information, one at its bound, one that trades, a bias of zero."""
    endless, bound, bias, sure = fitting.estimates
    covariance = fitting.uncertainty.covariance.copy()
    covariance[0, 0] = np.inf
    covariance[1, 2] = covariance[2, 1] = -0.95 * np.sqrt(covariance[1, 1] * covariance[2, 2])
    names = (endless.name, bound.name, "bias.position", sure.name)
    rows = (
        dataclasses.replace(
            endless, sd=np.inf, verdict="not identifiable from this log", trades=("V_10",)
        ),
        dataclasses.replace(
            bound, sd=0.2 * bound.value,
            verdict="poorly determined", at_bound="lower", trades=("bias.position",), prior_sd=0.1 * bound.value,
        ),
        dataclasses.replace(
            bias, name="bias.position", unit="m", value=0.0, start=0.0, sd=1e-5
        ),
        sure,
    )  # fmt: skip
    unsure = dataclasses.replace(fitting.uncertainty, names=names, covariance=covariance)
    return dataclasses.replace(fitting, estimates=rows, uncertainty=unsure, validation=FreeRuns((), ()))


@pytest.fixture(scope="session")
def tree(gentle, harsh, fitting, tmp_path_factory):
    """A folder of each kind, with a figure in one and what each rests on."""
    root = tmp_path_factory.mktemp("results")
    rests_on = {**provenance([gentle.plant]), "command": "ehsa-ctrl <do> it", "date": "2026-05-04 12:30 UTC"}
    for name, content in contents(gentle, harsh, fitting).items():
        folder = root / name.removesuffix(".json")
        folder.mkdir()
        (folder / name).write_text(to_json({**content, "rests_on": rests_on}))
    svg = '<?xml version="1.0"?><svg viewBox="0 0 1 1" width="1pt"><g id="figure_1"><path id="a"/></g></svg>'
    (root / "simulation" / "simulation.svg").write_text(svg)
    (root / "design" / "step.svg").write_text(svg.replace("<g", "<script>alert(1)</script><g"))
    return root


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium of the system."""
    binary, service = shutil.which("chromium"), shutil.which("chromedriver")
    if binary is None or service is None:
        pytest.skip("needs chromium and chromium-driver (Debian: apt-get install chromium chromium-driver)")
    if chart_library() is None:
        pytest.skip("needs the extra live")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(service))
    try:
        yield driver
    finally:
        driver.quit()
