"""What an identification comes to, in sentences: is each parameter determined, does it hold elsewhere, what is left."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from ..core.text import join_words
from ..identification.comparison import quality
from ..identification.identification import Identification
from ..identification.initial_state import sensor_sd
from ..plant.file import both
from .kinds._result import FITS, Sentence, worst_of
from .number import number

#: A channel weighed by more than this times its sensor's noise was weighed by its residual: the model does not fit.
OWN = 1.05
#: A fit that is lower by more than so many points than before has fallen.
FELL = 1.0


class Verdict(NamedTuple):
    """Sentences, and whether all is well with each, see kinds._result.Sentence."""

    sentences: tuple[Sentence, ...]

    @property
    def state(self) -> bool | Literal["doubt"] | None:
        return worst_of(self.sentences)


def verdict(identification: Identification) -> Verdict:
    """How many parameters are determined, what the fit became, whether residuals are noise; in this order."""
    doubts = tuple((f"{sentence[0].upper()}{sentence[1:]}.", False) for sentence in identification.search_warnings)
    sentences = (_determined(identification), *doubts, _reached(identification), _left(identification))
    if identification.interrupted:
        interrupted = ("The search was interrupted: this is the best that it had, not the minimum.", False)
        return Verdict((interrupted, *sentences))
    return Verdict(sentences)


def weights(identification: Identification) -> list[tuple[str, float, float]]:
    """Channel, standard deviation by which it was weighed and its sensor's own noise, SI units."""
    log = identification.train.after[0].log
    return [
        (channel, sd, sensor_sd(identification.plant, log, channel))
        for channel, sd in identification.noise_sd.items()
        if channel in identification.train.fit_percent
    ]


def _determined(identification: Identification) -> tuple[str, bool]:
    estimates = identification.estimates
    well = [e for e in estimates if e.identifiable]
    many = f"{len(well)} of {len(estimates)} parameters are well determined"
    if identification.method == "balances" and identification.balances is not None:
        fits = identification.balances.balances
        closing = [f"{number(100.0 * fit.relative_error)} % ({fit.name})" for fit in fits]
        many += f" from balances that close within {join_words(closing)} of their leading terms"
    others: dict[str, list[str]] = {}
    for estimate in estimates:
        if not estimate.identifiable:
            others.setdefault(estimate.verdict, []).append(both(estimate.name))
    return "; ".join([many, *(f"{word}: {join_words(names)}" for word, names in others.items())]) + ".", not others


def _reached(identification: Identification) -> Sentence:
    """The worst channel's fit before and after, on logs held out if there are any."""
    held_out = bool(identification.validation.after)
    reach = identification.validation if held_out else identification.train
    names = join_words([run.log.name for run in reach.after])
    where = f"In free run on {names}, {'held out' if held_out else 'used to identify as none was held out'}, "
    ended = [run.stopped for run in reach.after if run.stopped]
    if ended:
        return f"{where}the simulation ended early: {ended[0].rstrip('.')}.", False
    known = {channel: fit for channel, fit in reach.fit_percent.items() if not math.isnan(fit)}
    if not known:
        return f"{where}no channel moved, so that there is no fit.", False
    worst = min(known, key=lambda channel: known[channel])
    before = reach.fit_percent_before[worst]
    came = "from a run that ended early" if math.isnan(before) else f"from {number(before)} %"
    fell = [channel for channel, fit in known.items() if fit < reach.fit_percent_before[channel] - FELL]
    lower = f"; the fit of {join_words(fell)} fell" if fell else ""
    reached = f"{number(known[worst])} % ({quality(known[worst])})"
    state = False if fell else FITS[quality(known[worst])]
    return f"{where}the worst fit, that of {worst}, went {came} to {reached}{lower}.", state


def _left(identification: Identification) -> tuple[str, bool | None]:
    """Whether residuals of the simulation are noise."""
    fit = identification.fit
    if fit is None:
        why = identification.no_simulation.rstrip(".")
        return f"Residuals of a simulation were not tested{f': {why}' if why else ''}.", False if why else None
    tests = identification.residual_tests
    failed = [test for test in tests if not test.passed]
    found = f"{len(failed)} of {len(tests)} tests find something left in them"
    larger = {channel: sd / noise for channel, sd, noise in weights(identification) if sd > OWN * noise}
    if larger:
        worst = max(larger, key=lambda channel: larger[channel])
        return (
            f"No parameters make the simulation fit within the noise: residuals are up to {number(larger[worst])} "
            f"times the sensor's noise ({worst}), and {found}. True errors may be larger than the standard deviations.",
            False,
        )
    if not identification.explained:
        return (
            f"More than noise is left: residuals have {number(fit.reduced_cost)} times its variance, and {found}. "
            "Standard deviations are from the residuals.",
            False,
        )
    if failed:
        worst_test = max(failed, key=lambda test: test.largest)
        return (
            f"Residuals are as small as the sensors' noise, but {found}, most in {worst_test.channel} with "
            f"{worst_test.against}.",
            False,
        )
    return "Residuals are the sensors' noise: no test finds anything left that a better model could explain.", True
