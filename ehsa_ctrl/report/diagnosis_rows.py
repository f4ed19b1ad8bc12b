"""Rows of the tables on the page of a diagnosis, as they are written."""

from __future__ import annotations

import math

from ..diagnosis.changed import Change
from ..diagnosis.diagnosis import Diagnosis
from ..diagnosis.gap_attribution import PLACES
from ..diagnosis.signals import SIGNALS
from ..plant.file import both
from .channel import shown
from .diagnosis_signals import models_shown, signal_shown
from .figures.candidates import candidate_name, fate
from .figures.diagnosis import percent
from .figures.unknown_inputs import NAMES
from .number import NOTHING, number, unit

#: What became of a hypothesis, as the table says it, with its mark.
MARKS = {
    "named": "✓ named", "can't be told from it": "△ can't be told from it", "excluded": "✗ excluded",
    "more than is needed": "more than is needed", "tried": "✗ does not explain it", "possible": "△ possible",
}  # fmt: skip


def places(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Place, its share by the causes found, and by the balances."""
    if not diagnosis.where:
        return []
    named = diagnosis.verdict in ("effect", "ambiguous")
    causes = dict(diagnosis.where) if named or diagnosis.location is None else {}
    balances = dict(diagnosis.location.shares) if diagnosis.location is not None else {}

    def share(shares: dict[str, float], place: str) -> str:
        return f"{100.0 * shares.get(place, 0.0):.0f} %" if shares else NOTHING

    return [(place, share(causes, place), share(balances, place)) for place in PLACES]


def by_signal(diagnosis: Diagnosis) -> list[tuple[str, str, list[str]]]:
    """Signal, its gap as believed, and what each place takes away of its square when put in."""
    if diagnosis.location is None:
        return []
    return [
        (
            signal_shown(name).words,
            percent(parts["gap"]),
            [f"{round(100.0 * parts[place])} %" if place in parts else NOTHING for place in PLACES],
        )
        for name, parts in diagnosis.location.by_signal.items()
    ]


def regimes(diagnosis: Diagnosis) -> list[tuple[str, str, str, str]]:
    """Balance, what its unknown input follows, how much of it that explains, and how much of the gap it closes."""
    if diagnosis.location is None:
        return []
    return [
        (
            NAMES[regime.balance],
            regime.words,
            f"{100.0 * regime.explained:.0f} %",
            _closed(regime.gap_closed),
        )
        for regime in diagnosis.location.regimes
    ]


def _closed(share: float) -> str:
    """What a curve alone takes off the squared gap; not tried is a dash."""
    if math.isnan(share):
        return NOTHING
    return f"{100.0 * share:.0f} %" if share >= 0.005 else "nothing"


def suspected(diagnosis: Diagnosis) -> str | None:
    """The sensor that the balances suspect, where it has a part of the gap."""
    location = diagnosis.location
    if location is None or location.sensor is None or dict(location.shares).get("sensor", 0.0) < 0.05:
        return None
    return location.sensor


def candidates(diagnosis: Diagnosis) -> list[tuple[str, str, str, str, bool]]:
    """Members, evidence against them, their largest gap, what became of them, whether they are named."""
    rows = []
    for candidate in diagnosis.candidates:
        word = fate(diagnosis, candidate)
        evidence = number(float(f"{candidate.evidence:.3g}"))
        rows.append((candidate_name(candidate), evidence, percent(candidate.gap), MARKS[word], word == "named"))
    return rows


def gaps(diagnosis: Diagnosis) -> list[tuple[str, str, list[tuple[str, bool]]]]:
    """Signal, the gap as believed over the whole log, and that of each model on held-out data, whether it matters."""
    limit = diagnosis.threshold
    models = models_shown(diagnosis)
    return [
        (
            name if name == "total" else signal_shown(name).words,
            percent(diagnosis.whole[name]) if name in diagnosis.whole else NOTHING,
            [(percent(diagnosis.gap[model][name]), diagnosis.gap[model][name] >= limit) for model in models],
        )
        for name in (*SIGNALS, "total")
        if name in diagnosis.gap["nominal"]
    ]


def noise(diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Channel, standard deviation of its noise, unit."""
    rows = []
    for channel, sd in diagnosis.noise_sd.items():
        how = shown(channel)
        rows.append((how.words, number(float(f"{sd / how.scale:.3g}")), unit(how.unit)))
    return rows


def changes(change: Change) -> list[tuple[str, str, str, str]]:
    """Symbol, value as believed, value of the rig when the first log was made, unit; of what differs."""
    nominal, rig = change.before.plant, change.rig
    return [
        (both(name), number(nominal[name]), number(parameter.value), unit(parameter.unit))
        for name, parameter in rig.parameters.items()
        if name in nominal.parameters and abs(parameter.value - nominal[name]) > 1e-6 * abs(nominal[name])
    ]


def facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """What was diagnosed, and what it took."""
    log, plant = diagnosis.log, diagnosis.plant
    given = ", ".join(
        f"{both(p.name)} = {number(p.value)} {unit(p.unit)}".rstrip()
        for p in plant.parameters.values()
        if p.source == "given"
    )
    return [
        ("log", str(log.path or "not from a file")),
        ("samples", f"{len(log)}, {number(1e3 * log.sample_time)} ms apart"),
        ("plant", f"{plant.name} ({plant.model}): {plant.title}"),
        ("set for this run", given or "nothing"),
        ("held out", diagnosis.held_out),
        ("a gap matters from", f"{100.0 * diagnosis.threshold:g} % on"),
        ("it took", f"{number(float(f'{diagnosis.seconds:.2g}'))} s, {diagnosis.runs} simulations"),
    ]
