"""The text of an identification: parameters and their accuracy, fits, and residual tests."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ..core.unit import unit_suffix
from ..physics.effects import EFFECTS
from ..plant.file import label
from .comparison import fit_cell, fit_words
from .uncertainty import Estimate

if TYPE_CHECKING:
    from .identification import Identification


def identification_text(found: Identification) -> str:
    """The result as text for a terminal."""
    return "\n".join(_lines(found))


def _lines(found: Identification) -> Iterator[str]:
    free_run = "free run" if found.window is None else f"windows of {found.window:.3g} s"
    by_balances = found.balances if found.method == "balances" else None
    how = free_run if by_balances is None else f"balances, {by_balances.method}"
    used = ", ".join(run.log.name for run in found.train.after)
    yield f"{found.plant.name} ({found.plant.model}) identified from {used}, {how}; computed in {found.seconds:.1f} s"
    if found.interrupted:
        yield "  interrupted: this is the best result so far, not the minimum"
    yield from _parameter_lines(found)
    yield from _typical_lines(found)
    if by_balances is not None:
        for balance in by_balances.balances:
            yield f"  {balance.name} balance: relative error {100 * balance.relative_error:.2f} %"
        yield from _other_method_lines(found, free_run)
    elif found.fit is not None:
        yield (
            f"  residuals {found.noise_ratio:.3g} times the noise's variance"
            + ("" if found.explained else "; standard deviations are computed from the residuals")
            + (", and so are the channels' weights" if found.fit.weighted else "")
        )
    yield from (f"  warning: {sentence}" for sentence in found.warnings)
    yield "  fit in free run, %   " + "".join(f"{channel:>11}" for channel in found.train.fit_percent)
    for name, runs in (("used", found.train), ("held out", found.validation)):
        for word, fits in (("before", runs.fit_percent_before), ("after", runs.fit_percent)):
            if runs.after:
                yield f"    {name + ', ' + word:<19}" + "".join(f"{fit_cell(value):>11}" for value in fits.values())
    where, runs = ("held out", found.validation) if found.validation.after else ("on the logs used", found.train)
    if words := fit_words(runs.fit_percent):
        yield f"  fit {where}: {words}"
    failed = [test for test in found.residual_tests if not test.passed]
    if failed:
        largest = ", ".join(f"{test.channel} with {test.against} ({test.largest:.2g})" for test in failed[:4])
        more = f" and {len(failed) - 4} more" if len(failed) > 4 else ""
        yield f"  residuals are correlated, largest coefficients: {largest}{more}"


def _parameter_lines(found: Identification) -> Iterator[str]:
    width = max(12, *(len(label(e.name)) for e in found.estimates))
    yield f"  {'':<{width}} {'value':>11} {'sd':>9} {'':>8} {'start':>11} {'unit':<10}"
    for e in found.estimates:
        relative = f"{100 * e.relative_sd:.2g} %" if e.relative_sd < 10 else "-"
        words: str = "" if e.identifiable else e.verdict
        if e.at_bound:
            words += f", at its {e.at_bound} bound"
        if e.trades and not e.identifiable:
            words += f", correlated with {', '.join(map(label, e.trades))}"
        numbers = f"  {label(e.name):<{width}} {e.value:>11.5g} {_sd_cell(e):>9} {relative:>8} {e.start:>11.5g}"
        yield f"{numbers} {e.unit:<10} {words}".rstrip()


def _typical_lines(found: Identification) -> Iterator[str]:
    """Effects whose size is a typical value, because the plant's file gives none."""
    estimated = {e.name for e in found.estimates}
    for effect in found.plant.structure.effects:
        for size in EFFECTS[effect].parameters[:1]:
            given = found.plant.parameters[size.name]
            if size.name not in estimated and given.note == f"typical of {effect}":
                held = f"{size.name} = {given.value:g}{unit_suffix(size.unit)}"
                yield f"  {held}, typical of {effect}; --free {size.name} estimates it"


def _other_method_lines(found: Identification, free_run: str) -> Iterator[str]:
    """The estimate by simulation for comparison with that from balances, and why they may differ."""
    if found.no_simulation:
        yield f"  no estimate by simulation: {found.no_simulation}"
    if not found.other_estimates:
        return
    yield f"  by simulation ({free_run}):"
    for e in found.other_estimates:
        words = "" if e.identifiable else e.verdict
        yield f"    {label(e.name):<10} {e.value:>11.5g} {_sd_cell(e):>9} {e.unit:<10} {words}".rstrip()
    differ = ", ".join(map(label, found.differing))
    yield (
        (f"  {differ} differ: " if differ else "  no parameter differs by more than two standard deviations: ")
        + "balances weight the error of a force at every instant, the simulation its accumulated effect, so that model "
        "errors bias different parameters in each"
    )


def _sd_cell(estimate: Estimate) -> str:
    return f"{estimate.sd:.2g}" if math.isfinite(estimate.sd) else "-"
