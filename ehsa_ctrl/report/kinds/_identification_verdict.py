"""The verdict on an identification in sentences, from its JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ...core.text import join_words
from ...identification.comparison import quality
from ...plant.file import label
from ..page import Sentence
from ..text import as_sentence, percent, quantity_in, value_text
from ._tables import FITS

Model = Mapping[str, Any]

#: Residuals this many times the sensor's noise served as weights: the model does not fit within the noise.
OWN = 1.05
#: A fit that is lower than before by more than so many points has fallen.
FELL = 1.0
#: An estimate that moves by more than this share over the range of an assumed parameter is no longer well determined.
MATTERS = 0.1


def determined(each: Model) -> int:
    return sum(p["identifiable"] for p in each["parameters"].values())


def verdict(each: Model) -> Iterator[Sentence]:
    if each["interrupted"]:
        yield "The search was interrupted: this is the best point so far, not the minimum.", False
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
    """How many parameters are determined, and which are not."""
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


def weights(each: Model) -> dict[str, tuple[float, float]]:
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
    larger = {name: sd / own for name, (sd, own) in weights(each).items() if sd > OWN * own}
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


def value_at_end(tried: Model, end: Model) -> str:
    return quantity_in(end["value"], tried.get("file_unit", tried["unit"]), tried["unit"])


def range_sentence(each: Model, tried: Model) -> Sentence:
    """What follows from the range of one assumed parameter, and whether the estimates hold over it."""
    name = label(tried["name"])
    possible = [end for end in tried["ends"] if not end["excluded"]]
    excluded = [value_at_end(tried, end) for end in tried["ends"] if end["excluded"]]
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
    return f"{name}: at {value_at_end(tried, end)}, which the log allows, {words}{against}.", size < MATTERS
