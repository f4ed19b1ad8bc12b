"""The page of an identification: is each parameter determined, does the model hold on other logs, what is left over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.text import join_words, unique_names
from ...identification.comparison import GOOD, POOR, quality
from ...plant.file import label
from ..page import Kind, Page, Paragraph, Picture, Points, Section, Sentence, Table, mark
from ..signals import shown
from ..text import NOTHING, as_sentence, percent, quantity_in, uncertain, unit, value_text
from ._tables import FITS, findings_section, fit_table, plant_name, settings_of

Model = Mapping[str, Any]

#: Mark of each verdict on a parameter.
MARKS = {"well determined": "✓", "poorly determined": "△", "not identifiable from this log": "✗"}
#: Residuals this many times the sensor's noise served as weights: the model does not fit within the noise.
OWN = 1.05
#: A fit that is lower than before by more than so many points has fallen.
FELL = 1.0
#: An estimate that moves by more than this share over the range of an assumed parameter is no longer well determined.
MATTERS = 0.1
#: Logs whose fits are drawn; further ones are in the table of runs only.
DRAWN = 4
INFINITE = float("inf")
NOTE = (
    f"A fit of 100 % is exact, 0 % is no better than the mean; from {GOOD:g} % on it is called good, below {POOR:g} % "
    "poor, and fair between. Free runs begin at the log's first state and follow the logged drive alone. A parameter "
    "is well determined if its standard deviation is at most 10 % of its value, poorly determined up to 50 %."
)
METHODS_DIFFER = (
    "The balances weight the error of a force or flow at every instant, the simulation the sum of such errors over "
    "time: an effect that the model lacks goes into other parameters in the one than in the other. Noise in the "
    "regressors of a balance biases its estimate beyond its standard deviation."
)


def fit_stem(end: str, index: int) -> str:
    """Name of the figure of the free runs on one log; end: of the model, where there are several."""
    return f"fit{end}" if index == 0 else f"fit{end}-{index + 1}"


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    models: Mapping[str, Model] = content.get("models") or {content["model"]: content}
    several = len(models) > 1
    counts = [
        f"{_determined(each)} of {len(each['parameters'])}" + (f" ({name})" if several else "")
        for name, each in models.items()
    ]
    sentences = [
        (f"{name} model: {words}" if several else words, state)
        for name, each in models.items()
        for words, state in _sentences(each)
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
                    f"{name.capitalize()} model", list(_model(name, each, f"-{name}" if several else "")), f"model-{k}"
                )
                for k, (name, each) in enumerate(models.items())
            ),
            findings_section(list(findings.values())),
        ],
        facts=[
            *settings_of({**content, "model": ""}),
            ("logs used", join_words(map(str, content["logs"]["train"]))),
            ("held out", join_words(map(str, content["logs"]["validate"])) or "none"),
            *([("plant with these values", str(content["written"]))] if content.get("written") else []),
            *(fact for name, each in models.items() for fact in _facts(each, f"{name}: " if several else "")),
        ],
        versions=content["provenance"],
    )


def _determined(each: Model) -> int:
    return sum(p["identifiable"] for p in each["parameters"].values())


def _sentences(each: Model) -> Iterator[Sentence]:
    if each["interrupted"]:
        yield "The search was interrupted: this is the best point so far, not the minimum.", False
    yield _parameters_sentence(each)
    for words in each.get("search_warnings", each["warnings"]):
        yield as_sentence(words), False
    yield _fit_sentence(each)
    yield _residual_sentence(each)
    for tried in each.get("assumed_ranges") or ():
        words, state = _range_sentence(each, tried)
        if state is False:
            yield words, state


def _parameters_sentence(each: Model) -> Sentence:
    """How many parameters are determined, and which are not."""
    parameters = each["parameters"]
    words = f"{_determined(each)} of {len(parameters)} parameters are well determined"
    if each["method"] == "balances" and each["balances"] is not None:
        errors = [f"{percent(error, 4)} ({name})" for name, error in each["balances"]["relative_error"].items()]
        words += f" from balances whose residuals are {join_words(errors)} of their leading terms"
    others: dict[str, list[str]] = {}
    for name, p in parameters.items():
        if not p["identifiable"]:
            others.setdefault(p["verdict"], []).append(label(name))
    return "; ".join(
        [words, *(f"{verdict}: {join_words(names)}" for verdict, names in others.items())]
    ) + ".", not others


def _fit_sentence(each: Model) -> Sentence:
    """The worst channel's fit before and after, on held-out logs if there are any."""
    fits = each["fit_percent"]
    use = "validate" if fits["validate"] else "train"
    runs = [run for run in each.get("runs", []) if run["use"] == use]
    held_out = "held out" if use == "validate" else "used to identify as none was held out"
    where = (
        f"In free run on {join_words(run['log'] for run in runs)}, {held_out}, " if runs else f"On logs {held_out}, "
    )
    ended = [run["stopped"] for run in runs if run["stopped"]]
    if ended:
        return f"{where}the simulation ended early: {ended[0].rstrip('.')}.", False
    known = {channel: fit for channel, fit in fits[use].items() if fit is not None}
    if not known:
        return f"{where}no channel moved, so that there is no fit.", False
    before = fits["before"][use]
    worst = min(known, key=lambda channel: known[channel])
    came = "from a run that ended early" if before[worst] is None else f"from {value_text(before[worst])} %"
    fell = [channel for channel, fit in known.items() if before[channel] is not None and fit < before[channel] - FELL]
    lower = f"; the fit of {join_words(fell)} fell" if fell else ""
    word = quality(known[worst])
    reached = f"the worst fit, that of {worst}, went {came} to {value_text(known[worst])} % ({word}){lower}."
    return f"{where}{reached}", False if fell else FITS[word]


def _weights(each: Model) -> dict[str, tuple[float, float]]:
    """Channel -> standard deviation by which its residuals were weighted, and that of its sensor's noise."""
    cost = each["cost"] or {}
    return {name: (cost["noise_sd"][name], own) for name, own in cost.get("sensor_noise_sd", {}).items()}


def _residual_sentence(each: Model) -> Sentence:
    """Whether the residuals of the simulation are noise."""
    cost = each["cost"]
    if cost is None:
        why = each["beside"]["without"].rstrip(".")
        return f"Residuals of a simulation were not tested{f': {why}' if why else ''}.", False if why else None
    tests = each["residual_tests"]
    failed = [test for test in tests if not test["passed"]]
    found = f"{len(failed)} of {len(tests)} residual tests fail"
    larger = {name: sd / own for name, (sd, own) in _weights(each).items() if sd > OWN * own}
    if larger:
        worst = max(larger, key=lambda name: larger[name])
        return (
            f"No parameters make the simulation fit within the noise: residuals are up to {value_text(larger[worst])} "
            f"times the sensor's noise ({worst}), and {found}. True errors may be larger than the standard deviations.",
            False,
        )
    if not cost["explained"]:
        return (
            f"The residuals are more than noise: they have {value_text(cost['reduced'])} times its variance, and "
            f"{found}. Standard deviations are scaled by the residuals.",
            False,
        )
    if failed:
        test = max(failed, key=lambda test: test["largest"] or 0.0)
        return (
            f"Residuals are as small as the sensors' noise, but {found}; the largest correlation is that of "
            f"{test['channel']} with {test['against']}.",
            False,
        )
    return "Residuals are the sensors' noise: no test shows anything that a better model could explain.", True


def _side_by_side(models: Mapping[str, Model]) -> list[Any]:
    uses = [
        ("train", "used"),
        *([("validate", "held out")] if next(iter(models.values()))["fit_percent"]["validate"] else []),
    ]
    columns = {f"{words}\n{name}": each["fit_percent"][use] for use, words in uses for name, each in models.items()}
    return [fit_table("Fit in free run after identification, %", columns)]


def _model(name: str, each: Model, end: str) -> Iterator[Any]:
    """One model's parameters, fits, figures and tests."""
    yield Table(
        "Parameters, with one standard deviation",
        ["name", "value", "unit", "relative", "verdict", "start", "95 % interval", "meaning"],
        [_parameter(parameter, p) for parameter, p in each["parameters"].items()],
    )
    fits = each["fit_percent"]
    columns: dict[str, Model] = {}
    for use, words in (("train", "used"), ("validate", "held out")):
        if fits[use]:
            columns |= {f"{words}\nbefore": fits["before"][use], f"{words}\nafter": fits[use]}
    yield fit_table("Fit in free run, %", columns)
    runs = [_run(run) for run in each.get("runs", [])]
    yield Table("Free runs of the identified plant", ["log", "use", "worst fit", "run"], runs)
    beside = ", beside the balances" if each["method"] == "balances" else ""
    drawn = [run["log"] for run in each.get("runs", []) if run["use"] == ("validate" if fits["validate"] else "train")]
    for index, log in enumerate(drawn[:DRAWN] or [""]):
        yield Picture(
            fit_stem(end, index),
            f"Before and after{f' on {log}' if log else ''}",
            "Free runs, driven by the logged drive alone. Right: the second in which the drive varies most. A run far "
            "off the measurement leaves its panel.",
            True,
        )
    yield Picture(
        f"parameters{end}",
        "Parameters",
        "Left: deviation of the start, and the 95 % interval; linear up to 1 %, logarithmic beyond. Right: standard "
        "deviations on a logarithmic axis.",
        True,
    )
    yield Picture(
        f"correlation{end}",
        "Correlation",
        "Two parameters near ±1 compensate each other: a log with other motions is needed to separate them.",
        True,
    )
    yield Picture(
        f"residuals{end}",
        "Residuals",
        f"Of the simulation{beside}. Residuals of a right model are correlated neither with each other nor with the "
        "drive, the direction of motion or the position. Above each panel: passed or not, and the largest correlation.",
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
    fit = f"{value_text(known[worst])} % ({worst})" if worst else NOTHING
    story = f"starts {run['start']}" + (f"; {run['stopped']}" if run["stopped"] else "")
    return [run["log"], "used" if run["use"] == "train" else "held out", fit, story]


def _weights_table(each: Model) -> Table:
    rows = []
    for channel, (sd, own) in _weights(each).items():
        how = shown(channel)
        rows.append([how.words, value_text(sd, how.scale), value_text(own, how.scale), unit(how.unit)])
    head = ["channel", "weight", "sensor's noise", "unit"]
    return Table("Standard deviations by which residuals were weighted", head, rows)


def _tests(each: Model) -> Table:
    rows = [
        [test["channel"], test["against"], value_text(test["largest"]), value_text(test["band"]),
         percent(test.get("outside"), 4), mark(test["passed"], "yes" if test["passed"] else "no")]
        for test in each["residual_tests"]
    ]  # fmt: skip
    caption = "Residual tests: a correlation beyond the band at any lag fails; a right model fails one in 1 of 100 logs"
    return Table(caption, ["residual of", "with", "largest", "band", "lags outside", "passed"], rows)


def _other_method(each: Model) -> Iterator[Any]:
    """The same parameters by the other method, and how well the balances close."""
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
    yield Table(f"Estimates by {other['method']}: a difference of more than 2 is significant", head, rows)
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
    """How far the estimates move when an assumed parameter is at an end of its range."""
    ranges = each["assumed_ranges"]
    yield Points([_range_sentence(each, tried) for tried in ranges])
    ends = [(tried, end) for tried in ranges for end in tried["ends"]]
    rows = [
        [label(name), *(_moved(end["parameters"].get(name), p["value"]) for _, end in ends)]
        for name, p in each["parameters"].items()
    ]
    rows.append(["residual variance / noise variance", *(value_text(end["cost"], 1.0, 3) for _, end in ends)])
    rows.append(["the log", *("excludes it" if end["excluded"] else "allows it" for _, end in ends)])
    head = ["name", *(f"{label(tried['name'])}\n{_end(tried, end)}" for tried, end in ends)]
    yield Table("Change of the estimates with an assumed parameter at an end of its range, one at a time", head, rows)


def _end(tried: Model, end: Model) -> str:
    return quantity_in(end["value"], tried.get("file_unit", tried["unit"]), tried["unit"])


def _moved(value: float | None, estimate: float) -> str:
    if value is None or estimate == 0.0:
        return NOTHING
    share = 100.0 * (value / estimate - 1.0)
    return "0 %" if abs(share) < 0.005 else f"{share:+.2g} %" if abs(share) < 99.5 else f"{share:+.0f} %"


def _range_sentence(each: Model, tried: Model) -> Sentence:
    """What follows from the range of one assumed parameter, and whether the estimates hold over it."""
    name = label(tried["name"])
    possible = [end for end in tried["ends"] if not end["excluded"]]
    excluded = [_end(tried, end) for end in tried["ends"] if end["excluded"]]
    if not possible:
        return f"{name}: the log excludes both ends of its range; it can be estimated (--free).", None
    moves = [
        (abs(end["parameters"][parameter] / p["value"] - 1.0) if p["value"] else 0.0, parameter, end)
        for end in possible
        for parameter, p in each["parameters"].items()
        if parameter in end["parameters"]
    ]
    if not moves:
        return f"{name}: the plant could not be simulated at the ends of its range.", False
    size, moved, end = max(moves, key=lambda move: move[0])
    against = f"; the log excludes {join_words(excluded)}" if excluded else ""
    words = f"{label(moved)} moves by {value_text(100.0 * size, 1.0, 2)} %"
    return f"{name}: at {_end(tried, end)}, which the log allows, {words}{against}.", size < MATTERS


def _facts(each: Model, before: str) -> Iterator[tuple[str, str]]:
    """How the estimate was made."""
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
            f"{before}starts tried, with their cost",
            ", ".join(f"{s['name']}: {value_text(s['cost'])}" for s in starts),
        )
        yield f"{before}residuals", f"{cost['residuals']}, {value_text(cost['reduced'])} times the weights"
    yield f"{before}time", f"{value_text(each['seconds'])} s"


KIND = Kind("identification.json", "identification", _read)
