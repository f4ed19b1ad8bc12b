"""The page of an identification: accuracy of the parameters, fit on held-out logs, residual tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.text import join_words, unique_names
from ...identification.comparison import GOOD, POOR
from ...plant.file import label
from ..page import Kind, Page, Paragraph, Picture, Points, Section, Table, mark
from ..signals import channel_display
from ..text import NOTHING, percent, uncertain, unit, value_text
from ._charts import charted, free_run_chart
from ._identification_verdict import determined, range_sentence, value_at_end, verdict, weights
from ._tables import findings_section, fit_table, fit_text, plant_name, settings_of

Model = Mapping[str, Any]

#: Verdict on a parameter -> mark.
MARKS = {"well determined": "✓", "poorly determined": "△", "not identifiable from this log": "✗"}
#: Largest number of logs whose fits are drawn; the table of runs lists all logs.
DRAWN = 4
INFINITE = float("inf")
NOTE = (
    "A fit of 100 % is exact, 0 % is no better than the mean of the measurement. A fit of at least "
    f"{GOOD:g} % is good, below {POOR:g} % poor, otherwise fair. Free runs start from the log's first state and use "
    "the logged input alone. A parameter is well determined if its standard deviation is at most 10 % of its value, "
    "poorly determined up to 50 %."
)
METHODS_DIFFER = (
    "The balances weight the error of a force or flow at every instant, the simulation its integral over time: an "
    "unmodelled effect biases different parameters in the two methods. Noise in the regressors of a balance biases its "
    "estimate beyond its standard deviation."
)


def fit_stem(end: str, index: int) -> str:
    """File stem of the figure of the free runs on one log; end: suffix of the model if there are several."""
    return f"fit{end}" if index == 0 else f"fit{end}-{index + 1}"


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    models: Mapping[str, Model] = content.get("models") or {content["model"]: content}
    several = len(models) > 1
    counts = [
        f"{determined(each)} of {len(each['parameters'])}" + (f" ({name})" if several else "")
        for name, each in models.items()
    ]
    sentences = [
        (f"{name.capitalize()} model. {words}" if several else words, state)
        for name, each in models.items()
        for words, state in verdict(each)
    ]
    findings = {str(finding): finding for each in models.values() for finding in each["findings"]}
    names = unique_names([str(log) for log in content["logs"]["train"]])
    logs = join_words(names) if 0 < len(names) < 4 else f"{len(names)} logs"
    return Page(
        title=f"Identification of {plant_name(content)} from {logs}: {join_words(counts)} parameters well determined",
        sentences=sentences,
        notes=[NOTE],
        sections=[
            Section(" and ".join(models).capitalize(), _side_by_side(models) if several else [], "models"),
            *(
                Section(
                    f"{name.capitalize()} model",
                    list(_model(name, each, f"-{name}" if several else "", folder)),
                    f"model-{k}",
                )
                for k, (name, each) in enumerate(models.items())
            ),
            findings_section(list(findings.values())),
        ],
        facts=[
            *settings_of({**content, "model": ""}),
            ("logs used", join_words(map(str, content["logs"]["train"]))),
            ("logs held out", join_words(map(str, content["logs"]["validate"])) or "none"),
            *([("file of the identified plant", str(content["written"]))] if content.get("written") else []),
            *(fact for name, each in models.items() for fact in _facts(each, f"{name}: " if several else "")),
        ],
        versions=content["provenance"],
    )


def _side_by_side(models: Mapping[str, Model]) -> list[Any]:
    uses = [
        ("train", "used"),
        *([("validate", "held out")] if next(iter(models.values()))["fit_percent"]["validate"] else []),
    ]
    columns = {f"{words}\n{name}": each["fit_percent"][use] for use, words in uses for name, each in models.items()}
    return [fit_table("Fit in free run after identification, %", columns)]


def _model(name: str, each: Model, end: str, folder: Path) -> Iterator[Any]:
    """Parameters, fits, figures and residual tests of one model."""
    fits = each["fit_percent"]
    drawn = [run["log"] for run in each.get("runs", []) if run["use"] == ("validate" if fits["validate"] else "train")]
    for index, log in enumerate(drawn[:DRAWN] or [""]):
        stem = fit_stem(end, index)
        picture = Picture(
            stem,
            f"Before and after{f' on {log}' if log else ''}",
            "Free runs, driven by the logged input alone. Right: the second in which the input varies most. A run far "
            "from the measurement leaves its panel.",
            True,
        )
        yield from charted(free_run_chart(folder, f"{stem}.csv", [picture], after="after (identified)"), [picture])
    yield Table(
        "Parameters, with one standard deviation",
        ["name", "value", "unit", "relative", "verdict", "start", "95 % interval", "meaning"],
        [_parameter(parameter, p) for parameter, p in each["parameters"].items()],
    )
    columns: dict[str, Model] = {}
    for use, words in (("train", "used"), ("validate", "held out")):
        if fits[use]:
            columns |= {f"{words}\nbefore": fits["before"][use], f"{words}\nafter": fits[use]}
    yield fit_table("Fit in free run, %", columns)
    runs = [_run(run) for run in each.get("runs", [])]
    yield Table("Free runs of the identified plant", ["log", "use", "worst fit", "run"], runs)
    beside = ", beside the balances" if each["method"] == "balances" else ""
    yield Picture(
        f"parameters{end}",
        "Parameters",
        "Left: start value and 95 % interval relative to the estimate; linear up to 1 %, logarithmic beyond. Right: "
        "standard deviations on a logarithmic axis.",
        True,
    )
    yield Picture(
        f"correlation{end}",
        "Correlation",
        "Two parameters with a correlation near ±1 compensate each other; only another excitation can separate them.",
        True,
    )
    yield Picture(
        f"residuals{end}",
        "Residuals",
        f"Residuals of the simulation{beside}. With a correct model they are correlated neither with each other nor "
        "with the input, the direction of motion or the position. Above each panel: test result and largest "
        "correlation.",
        True,
    )
    yield _weights_table(each)
    yield _tests(each)
    yield from _other_method(each)
    if each.get("assumed_ranges"):
        yield Section("Sensitivity to assumed parameters", list(_ranges(each)))


def _parameter(name: str, p: Model) -> list[str]:
    sd = INFINITE if p["sd"] is None else p["sd"]
    relative = sd / abs(p["value"]) if p["value"] else INFINITE
    low, high = p["interval_95"]
    notes = [f"at its {p['at_bound']} bound"] if p["at_bound"] else []
    if p["trades_with"]:
        notes.append(f"correlated with {join_words(map(label, p['trades_with']))}")
    if p["prior_sd"] is not None:
        notes.append(f"prior {value_text(p['start'])} ± {value_text(p['prior_sd'])}")
    return [
        label(name), uncertain(p["value"], sd), unit(p["unit"]), percent(relative, 2) if relative < 10.0 else NOTHING,
        "\n".join([f"{MARKS.get(p['verdict'], '')} {p['verdict']}", *notes]), value_text(p["start"]),
        "unbounded" if low is None or high is None else f"{value_text(low)} to {value_text(high)}",
        p.get("meaning", ""),
    ]  # fmt: skip


def _run(run: Model) -> list[str]:
    known = {channel: fit for channel, fit in run["fit_percent"].items() if fit is not None}
    worst = min(known, key=lambda channel: known[channel], default="")
    fit = f"{fit_text(known[worst])} % ({worst})" if worst else NOTHING
    remark = f"starts {run['start']}" + (f"; {run['stopped']}" if run["stopped"] else "")
    return [run["log"], "used" if run["use"] == "train" else "held out", fit, remark]


def _weights_table(each: Model) -> Table:
    rows = []
    for channel, (sd, own) in weights(each).items():
        how = channel_display(channel)
        rows.append([how.words, value_text(sd, how.scale), value_text(own, how.scale), unit(how.unit)])
    head = ["channel", "weight", "sensor noise", "unit"]
    return Table("Weights of the residuals: standard deviation assumed for each channel", head, rows)


def _tests(each: Model) -> Table:
    rows = [
        [test["channel"], test["against"], value_text(test["largest"]), value_text(test["band"]),
         percent(test.get("outside"), 4), mark(test["passed"], "yes" if test["passed"] else "no")]
        for test in each["residual_tests"]
    ]  # fmt: skip
    caption = "Residual tests: a correlation outside the band at any lag fails; a correct model fails in 1 of 100 logs"
    return Table(caption, ["residual of", "with", "largest", "band", "lags outside", "passed"], rows)


def _other_method(each: Model) -> Iterator[Any]:
    """Estimates by the other method, and the residuals of the balances."""
    other = each["beside"]
    rows = []
    for name, p in each["parameters"].items():
        its = other["parameters"].get(name)
        if its is not None:
            sds = [INFINITE if sd is None else sd for sd in (p["sd"], its["sd"])]
            sd = (sds[0] ** 2 + sds[1] ** 2) ** 0.5
            apart = value_text(round(abs(p["value"] - its["value"]) / sd, 1)) if 0.0 < sd < INFINITE else NOTHING
            values = (uncertain(p["value"], sds[0]), uncertain(its["value"], sds[1]))
            rows.append([label(name), *values, unit(p["unit"]), apart])
    head = ["name", f"by {each['method']}", f"by {other['method']}", "unit", "difference\nstandard deviations"]
    yield Table(f"Estimates by {other['method']}; a difference of more than 2 is significant", head, rows)
    if rows:
        yield Paragraph(METHODS_DIFFER)
    if other["without"]:
        yield Paragraph(f"No estimate by {other['method']}: {other['without']}")
    balances = each["balances"]
    if balances is None:
        return
    if balances["undetermined"]:
        yield Paragraph("Not determined by the balances:")
        yield Points([f"{name}: {why}" for name, why in balances["undetermined"].items()])
    rows = [
        [fit["name"], value_text(fit["rms"]), unit(fit["unit"]), percent(fit["relative_error"], 4),
         str(fit["rows"])]
        for fit in balances.get("balances", [])
    ]  # fmt: skip
    head = ["balance", "residual", "unit", "of its leading term", "rows"]
    yield Table(f"Residuals of the balances ({balances['method']})", head, rows)


def _ranges(each: Model) -> Iterator[Any]:
    """Change of the estimates when an assumed parameter is at an end of its range."""
    ranges = each["assumed_ranges"]
    yield Points([range_sentence(each, tried) for tried in ranges])
    ends = [(tried, end) for tried in ranges for end in tried["ends"]]
    rows = [
        [label(name), *(_moved(end["parameters"].get(name), p["value"]) for _, end in ends)]
        for name, p in each["parameters"].items()
    ]
    rows.append(["residual variance / noise variance", *(value_text(end["cost"], 1.0, 3) for _, end in ends)])
    words = {True: "excluded by the log", False: "allowed by the log"}
    head = [
        "name",
        *(f"{label(tried['name'])}\n{value_at_end(tried, end)}\n{words[end['excluded']]}" for tried, end in ends),
    ]
    yield Table("Change of the estimates with an assumed parameter at an end of its range, one at a time", head, rows)


def _moved(value: float | None, estimate: float) -> str:
    if value is None or estimate == 0.0:
        return NOTHING
    share = 100.0 * (value / estimate - 1.0)
    return "0 %" if abs(share) < 0.005 else f"{share:+.2g} %" if abs(share) < 99.5 else f"{share:+.0f} %"


def _facts(each: Model, before: str) -> Iterator[tuple[str, str]]:
    """Method, data and computation time of the estimation."""
    by = "simulation error"
    if each["method"] == "balances" and each["balances"] is not None:
        by = f"balances, {each['balances']['method']}"
    yield f"{before}method", by
    cost = each["cost"]
    if cost is not None:
        window = cost["window"]
        yield (
            f"{before}simulation",
            "whole logs in free run" if window is None else f"windows of {value_text(window)} s",
        )
        starts: Sequence[Model] = cost["starts"]
        yield (
            f"{before}starts, with their final cost",
            ", ".join(f"{s['name']}: {value_text(s['cost'])}" for s in starts),
        )
        yield f"{before}residuals", f"{cost['residuals']}, variance {value_text(cost['reduced'])} times the weights'"
    yield f"{before}computation", f"{value_text(each['seconds'])} s"


KIND = Kind("identification.json", "identification", _read)
