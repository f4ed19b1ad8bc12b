"""The page of scenario runs: verdicts, then each scenario with its controllers, then the linear loops."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.text import join_words
from ...scenario.metrics import METRICS
from ...scenario.result import first_reasons
from ..page import (
    DOUBT,
    Facts,
    Kind,
    Link,
    Page,
    Paragraph,
    Picture,
    Points,
    Section,
    Sentence,
    Table,
    anchors,
    mark,
    unique,
)
from ..provenance import merged_versions
from ..text import as_sentence, quantity, unit, value_text
from ._charts import charted, run_chart
from ._metrics import (
    bounds_text,
    metric_exists,
    metric_heading,
    metric_of,
    metric_text,
    not_defined_sentence,
    range_sentence,
    ranges_table,
)
from ._tables import loop_sentence, margins_table

Run = Mapping[str, Any]

#: Metrics in the table of all runs; the section of a scenario has all metrics.
SHOWN = (
    "RiseTime", "SettlingTime", "Overshoot", "SteadyStateError", "MaxError", "RMSError", "Slips", "StickShare",
    "CurrentRMS",
)  # fmt: skip
VERDICTS = {"pass": "✓ passed", "fail": "✗ failed", "untested": "– untested"}
STATES = {"pass": True, "fail": False, "untested": None}
NOTE = (
    "Each controller is designed on the linear model of its plant. The linear prediction simulates the controller with "
    "that model; the check simulates the same controller with the nonlinear plant, including friction, load, sampling "
    "and sensor noise. Limits apply to the nonlinear plant."
)


def run_stems(runs: Sequence[Run]) -> list[str]:
    """File stems of the runs' figures, in the order of the runs."""
    return unique(_file_name(f"{run['scenario']}-{run['controller']}") for run in runs)


def _file_name(name: str) -> str:
    """A name without characters that are invalid in a file name; Python results may have any name."""
    return re.sub(r"[/\\\0]", "-", name)[:100]


def loops_of(runs: Sequence[Run]) -> dict[str, Run]:
    """File stem of the figure of each linear loop -> first run with that loop; runs with equal margins share one."""
    first: dict[str, Run] = {}
    for run in runs:
        if run["margins"] is not None:
            first.setdefault(_loop_key(run), run)
    return dict(
        zip(unique(_file_name(f"loop-{run['controller']}") for run in first.values()), first.values(), strict=True)
    )


def _loop_key(run: Run) -> str:
    return f"{run['controller']} {run.get('plant', '')} {sorted(run['margins'].items())}"


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    runs = content["scenarios"]
    if not runs:
        raise ValueError("no run")
    passed = sum(run["passed"] for run in runs)
    names = list(dict.fromkeys(str(run["scenario"]) for run in runs))
    loops, stems = loops_of(runs), run_stems(runs)
    keys = dict(zip([*stems, *loops], anchors([*stems, *loops]), strict=True))
    loop_keys = {_loop_key(run): keys[stem] for stem, run in loops.items()}
    groups: dict[str, list[tuple[str, Run]]] = {}
    for stem, run in zip(stems, runs, strict=True):
        groups.setdefault(f"{run['scenario']} {run['title']} {run.get('definition')}", []).append((stem, run))
    # A picture comes before the numbers; of several scenarios the table leads to their pictures.
    single = next(iter(groups.values())) if len(groups) == 1 else []
    picture = [Section("Runs over time", charted(run_chart(folder, single), ()), "runs")] if single else []
    return Page(
        title=f"{passed} of {len(runs)} scenarios passed: {join_words(names[:4])}"
        + (" and more" if len(names) > 4 else ""),
        sentences=list(_sentences(runs)),
        notes=[NOTE],
        sections=[
            *picture,
            Section("All runs", [_summary(runs, [keys[stem] for stem in stems])], "summary"),
            *(_scenario(group, keys, loop_keys, folder if len(groups) > 1 else None) for group in groups.values()),
            Section("Linear loops", list(_loops(loops, keys)), "loops", folded=True),
            Section("Settings of the runs", [_settings(runs)], "settings", folded=True),
        ],
        versions=merged_versions(run["provenance"] for run in runs),
    )


def _name(run: Run) -> str:
    return f"{run['scenario']} with {run['controller']}"


def _sentences(runs: Sequence[Run]) -> Iterator[Sentence]:
    failed = [run for run in runs if not run["passed"]]
    for run in failed:
        yield f"{_name(run)} failed: {first_reasons(run['failures'])}.", False
    if not failed:
        yield "Every scenario meets its limits on the nonlinear plant.", True
    tried = [run for run in runs if run.get("assumed_ranges")]
    sensitive = [run for run in tried if any(each["flips"] for each in run["assumed_ranges"])]
    for run in sensitive:
        yield f"The verdict of {_name(run)} depends on an assumed parameter. {range_sentence(run)[0]}", DOUBT
    if tried and not sensitive:
        yield "No verdict changes when an assumed parameter is at either end of its range.", True


def _summary(runs: Sequence[Run], keys: Sequence[str]) -> Table:
    columns = [name for name in SHOWN if any(metric_exists(run, name) for run in runs)]
    head = ["scenario", "controller", "verdict", "limits\nmet", *(metric_heading(name) for name in columns)]
    rows = [
        [
            Link(run["scenario"], key), run["controller"], VERDICTS[run["verdict"]],
            f"{sum(limit['passed'] for limit in run['limits'])} of {len(run['limits'])}",
            *(metric_of(run, name, digits=3) for name in columns),
        ]
        for key, run in zip(keys, runs, strict=True)
    ]  # fmt: skip
    return Table("Nonlinear plant; –: did not happen, n/a: not defined for the reference", head, rows)


def _scenario(
    group: Sequence[tuple[str, Run]], keys: Mapping[str, str], loops: Mapping[str, str], folder: Path | None
) -> Section:
    """One scenario with all its controllers.

    keys, loops: section keys by figure stem and by linear loop. folder: of the live chart; None if it stands elsewhere.
    """
    runs = [run for _, run in group]
    first = runs[0]
    # The chart shows them; details of each are folded, unless the page is about a single run.
    many = folder is not None or len(runs) > 1
    chart = charted(run_chart(folder, group), ()) if folder is not None else []
    blocks: list[Any] = [Paragraph(first["why"]), *chart, Facts(list(_conditions(first)))]
    if len(runs) > 1:
        rows = [
            [name, *(metric_of(run, name) for run in runs), unit(METRICS[name].display_unit)]
            for name in METRICS
            if any(metric_exists(run, name) for run in runs)
        ]
        head = ["metric", *(run["controller"] for run in runs), "unit"]
        blocks.append(Table("Comparison of the controllers on the nonlinear plant", head, rows))
    if not_defined := not_defined_sentence(runs):
        blocks.append(Paragraph(not_defined))
    for stem, run in group:
        heading = f"{_name(run)}: {VERDICTS[run['verdict']].partition(' ')[2]}"
        blocks.append(Section(heading, list(_run(stem, run, loops)), keys[stem], STATES[run["verdict"]], many))
    return Section(first["title"], blocks)


def _run(stem: str, run: Run, loops: Mapping[str, str]) -> Iterator[Any]:
    """One controller on a scenario."""
    yield Points(run["failures"])
    limits = [
        [each["metric"], metric_text(each["metric"], each["value"]), bounds_text(each),
         mark(each["passed"], "yes" if each["passed"] else "no")]
        for each in run["limits"]
    ]  # fmt: skip
    yield Table("Limits of the scenario, on the nonlinear plant", ["metric", "value", "bound", "met"], limits)
    if not limits:
        yield Paragraph("The scenario has no limits.")
    caption = "Grey bars: the rod of the nonlinear plant sticks. "
    caption += "Blue: an external force acts on the rod. " if (run.get("definition") or {}).get("disturbance") else ""
    caption += "Dotted: the controller's current limit, if reached. " if run.get("current_limit_reached") else ""
    yield Picture(stem, f"{_name(run)} over time", f"{caption}Pressures P₁ and P₂ are those of the nonlinear plant.")
    if run.get("assumed_ranges"):
        words, holds = range_sentence(run)
        yield Paragraph(words, True if holds else DOUBT)
        yield ranges_table(run)
    yield Table(
        "Linear prediction and nonlinear plant",
        ["metric", "linear", "nonlinear", "difference", "unit", "meaning"],
        [
            [name, *(metric_of(run, name, each) for each in ("linear", "nonlinear", "gap")),
             unit(METRICS[name].display_unit), METRICS[name].meaning]
            for name in METRICS
            if metric_exists(run, name)
        ],
    )  # fmt: skip
    expected = run["expected_trips"]
    if run["trips"]:
        yield Paragraph("Plant limits exceeded by the nonlinear run:")
        yield Points(
            [
                trip.get("sentence", trip["limit"]) + (", as expected" if trip["limit"] in expected else "")
                for trip in run["trips"]
            ]
        )
    else:
        yield Paragraph("The nonlinear run exceeded no plant limit.")
    if run.get("warnings"):
        yield Paragraph("What makes the run doubtful:")
        yield Points(run["warnings"])
    if run["linear_model_passed_limits"]:
        yield Paragraph(f"The linear prediction exceeded: {'; '.join(run['linear_model_passed_limits'])}.")
    if run["margins"] is not None:
        yield Paragraph(Link(f"Linear loop: {loop_sentence(run['margins'])}", loops[_loop_key(run)]))
    else:
        yield Paragraph("The controller has no linear feedback, so no margins are defined.")
    if run.get("solver_words"):
        yield Paragraph(as_sentence(run["solver_words"]))


def _loops(loops: Mapping[str, Run], keys: Mapping[str, str]) -> Iterator[Any]:
    if loops:
        yield Paragraph(
            "Each controller with its linear design model, sampled exactly with a zero-order hold; the loop is opened "
            "at the current."
        )
    for stem, run in loops.items():
        plant = f" on {run['plant']}" if run.get("plant") else ""
        stable = bool(run["margins"]["stable"])
        heading = f"{run['controller']}{plant}: {'stable' if stable else 'not stable'}"
        caption = (
            "Thick bars: gain margin (top) and phase margin (middle). Bottom: sensitivity S and complementary "
            "sensitivity T."
        )
        blocks = [
            *([Paragraph(run["controller_words"])] if run.get("controller_words") else []),
            margins_table("Margins", [run["margins"]]),
            Picture(stem, f"Bode plot of the open loop with {run['controller']}", caption),
        ]
        yield Section(heading, blocks, keys[stem], stable)


def _conditions(run: Run) -> Iterator[tuple[str, str]]:
    """Plant and conditions of a scenario, as facts."""
    definition = run.get("definition") or {}
    if run.get("plant"):
        yield "plant", f"{run['plant']}: {run['plant_title']}"
    scenario = {f"load.{key}": value for key, value in definition.get("load", {}).items()}
    scenario |= definition.get("settings", {})
    yield "set by the scenario", _pairs(scenario) or "nothing"
    if run["settings"]:
        yield "parameters set", _pairs(run["settings"])
    forces = [f"{quantity(each['force'], 'N')} {_during(each)}" for each in definition.get("disturbance", [])]
    yield "force on the rod", ", ".join(forces) or "none"
    yield "faults", ", ".join(_fault(fault) for fault in definition.get("fault", [])) or "none"
    if definition:
        yield "duration", quantity(definition["duration"], "s")
    yield "baseline", f"recorded because: {run['baseline']['reason']}" if run["baseline"] else "none"


def _pairs(settings: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in settings.items())


def _during(each: Mapping[str, Any]) -> str:
    """Time interval of a force; JSON has null for an infinite duration."""
    duration = each["duration"]
    lasting = " to the end" if duration in (None, float("inf")) else f" for {quantity(duration, 's')}"
    return f"from {quantity(each['start'], 's')}{lasting}"


def _fault(fault: Mapping[str, Any]) -> str:
    sensor = fault["kind"] in ("stuck", "lost")
    words = f"{fault['channel']} {fault['kind']}" if sensor else f"drive limited to {quantity(fault['current'], 'A')}"
    duration = fault["duration"]
    lasting = "" if duration in (None, float("inf")) else f" for {quantity(1e3 * duration, 'ms')}"
    return f"{words} from {quantity(fault['start'], 's')}{lasting}"


def _settings(runs: Sequence[Run]) -> Table:
    rows = []
    for run in runs:
        sensors = (run.get("definition") or {}).get("sensors", {})
        noise = {True: "on", False: "off"}.get(sensors.get("noise"), "–")
        rows.append(
            [run["scenario"], run["controller"], value_text(run.get("sample_time"), 1e-3), str(run["seed"]), noise,
             value_text(sensors.get("lag")), value_text(run.get("tolerance"))]
        )  # fmt: skip
    head = ["scenario", "controller", "sample time\nms", "seed", "sensor noise", "lag\nsamples", "tolerance"]
    return Table("Sampling, sensors and integration", head, rows)


KIND = Kind("results.json", "scenarios", _read)
