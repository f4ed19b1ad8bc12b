"""The verdict on an identification as sentences, from its JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ...core.text import join_words
from ...identification.comparison import quality
from ...identification.uncertainty import WELL
from ...plant.file import label
from ..page import Sentence
from ..text import as_sentence, percent, quantity_in, value_text
from ._tables import FITS

Model = Mapping[str, Any]

#: The model does not fit within the noise if a weight exceeds the sensor noise by this factor (engineering judgement).
NOISE_FACTOR = 1.05
#: A drop of a fit by more than this many percentage points is reported (engineering judgement).
FIT_DROP = 1.0


def determined(each: Model) -> int:
    return sum(p["identifiable"] for p in each["parameters"].values())


def verdict(each: Model) -> Iterator[Sentence]:
    if each["interrupted"]:
        yield "The search was interrupted: the values are the best so far, not the minimum of the cost.", False
    yield _parameters_sentence(each)
    for words in each.get("search_warnings", each["warnings"]):
        yield as_sentence(words), False
    yield _fit_sentence(each)
    yield _residual_sentence(each)
    for tried in each.get("assumed_ranges") or ():
        words, state = range_sentence(each, tried)
        if state is False:
            yield words, state


def _parameters_sentence(each: Model) -> Sentence:
    """Number of well determined parameters, and the others by verdict."""
    parameters = each["parameters"]
    words = f"{determined(each)} of {len(parameters)} parameters are well determined"
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
    """Fit of the worst channel before and after, on held-out logs if there are any."""
    fits = each["fit_percent"]
    use = "validate" if fits["validate"] else "train"
    runs = [run for run in each.get("runs", []) if run["use"] == use]
    held_out = "held out" if use == "validate" else "used to identify, as none was held out"
    where = (
        f"In free run on {join_words(run['log'] for run in runs)}, {held_out}, " if runs else f"On logs {held_out}, "
    )
    ended = [run["stopped"] for run in runs if run["stopped"]]
    if ended:
        return f"{where}the simulation stopped early: {ended[0].rstrip('.')}.", False
    known = {channel: fit for channel, fit in fits[use].items() if fit is not None}
    if not known:
        return f"{where}there is no fit, as all channels are constant.", False
    before = fits["before"][use]
    worst = min(known, key=lambda channel: known[channel])
    start = "from a run that stopped early" if before[worst] is None else f"from {value_text(before[worst])} %"
    dropped = [
        channel for channel, fit in known.items() if before[channel] is not None and fit < before[channel] - FIT_DROP
    ]
    lower = f"; the fit of {join_words(dropped)} decreased" if dropped else ""
    word = quality(known[worst])
    change = f"the worst fit, that of {worst}, changed {start} to {value_text(known[worst])} % ({word}){lower}."
    return f"{where}{change}", False if dropped else FITS[word]


def weights(each: Model) -> dict[str, tuple[float, float]]:
    """Channel -> standard deviation by which its residuals were weighted, and that of its sensor noise."""
    cost = each["cost"] or {}
    return {name: (cost["noise_sd"][name], own) for name, own in cost.get("sensor_noise_sd", {}).items()}


def _residual_sentence(each: Model) -> Sentence:
    """Whether the residuals of the simulation are white noise of the sensors' level."""
    cost = each["cost"]
    if cost is None:
        why = each["beside"]["without"].rstrip(".")
        return f"The residuals of a simulation were not tested{f': {why}' if why else ''}.", False if why else None
    tests = each["residual_tests"]
    failed = [test for test in tests if not test["passed"]]
    found = f"{len(failed)} of {len(tests)} residual tests fail"
    larger = {name: sd / own for name, (sd, own) in weights(each).items() if sd > NOISE_FACTOR * own}
    if larger:
        worst = max(larger, key=lambda name: larger[name])
        return (
            f"The simulation does not fit within the noise: residuals are up to {value_text(larger[worst])} times the "
            f"sensor noise ({worst}), and {found}. True errors may exceed the standard deviations.",
            False,
        )
    if not cost["explained"]:
        return (
            f"The residuals exceed the noise: they have {value_text(cost['reduced'])} times its variance, and {found}. "
            "The standard deviations are scaled accordingly.",
            False,
        )
    if failed:
        test = max(failed, key=lambda test: test["largest"] or 0.0)
        return (
            f"The residuals are as small as the sensor noise, but {found}; the largest correlation is that of "
            f"{test['channel']} with {test['against']}.",
            False,
        )
    return "The residuals are sensor noise: no test finds structure that a better model could explain.", True


def value_at_end(tried: Model, end: Model) -> str:
    return quantity_in(end["value"], tried.get("file_unit", tried["unit"]), tried["unit"])


def range_sentence(each: Model, tried: Model) -> Sentence:
    """Effect of the range of one assumed parameter, and whether the estimates hold over it."""
    name = label(tried["name"])
    possible = [end for end in tried["ends"] if not end["excluded"]]
    excluded = [value_at_end(tried, end) for end in tried["ends"] if end["excluded"]]
    if not possible:
        return f"{name}: the log excludes both ends of its range, so it can be estimated (--free).", None
    moves = [
        (abs(end["parameters"][parameter] / p["value"] - 1.0) if p["value"] else 0.0, parameter, end)
        for end in possible
        for parameter, p in each["parameters"].items()
        if parameter in end["parameters"]
    ]
    if not moves:
        return f"{name}: the plant could not be simulated at the ends of its range.", False
    size, parameter, end = max(moves, key=lambda move: move[0])
    remark = f"; the log excludes {join_words(excluded)}" if excluded else ""
    words = f"{label(parameter)} changes by {value_text(100.0 * size, 1.0, 2)} %"
    return f"{name}: at {value_at_end(tried, end)}, which the log allows, {words}{remark}.", size < WELL
