"""The page of a measured frequency response beside those of the models."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..page import DOUBT, Facts, Kind, Page, Paragraph, Picture, Section, Sentence, Table
from ..text import percent, value_text

NOTE_PERIODIC = (
    "Best linear approximation at the excited lines of the multisine. The scatter between periods is noise; that "
    "between logs beyond the noise is nonlinearity, such as friction. Output at even lines, which an odd multisine "
    "does not excite, is an even nonlinearity."
)
NOTE_SPECTRAL = (
    "Averaged spectra (Welch). H1 is unbiased for noise at the output, H2 for noise at the drive. A coherence below 1 "
    "is noise, nonlinearity such as friction, or an input that was not logged."
)
#: Largest median distance of a model that counts as an agreement. Engineering judgement: 10 %, about 1 dB.
CLOSE = 0.1


def _read(content: Mapping[str, Any], folder: Path) -> Page:
    channels = content["channels"]
    periodic = content["method"] == "periodic"
    subspace = content.get("subspace")
    note = NOTE_PERIODIC if periodic else NOTE_SPECTRAL
    sections = [
        Section("Gain and phase", [Picture("response", "Frequency response", note)]),
        Section("Uncertainty and models", [_table(channels)]),
    ]
    if subspace:
        sections.append(Section("Subspace model", _subspace(subspace)))
    facts = [("logs", ", ".join(content["logs"])), ("sample time", f"{value_text(content['sample_time'], 1e-3)} ms")]
    if periodic:
        facts.append(("period", f"{value_text(content['period'])} s, {content['averages']} periods"))
    else:
        facts.append(("averages", f"{content['averages']} segments, {content['estimator']}"))
    return Page(
        title=f"Frequency response from {content['drive']}",
        sentences=[_sentence(name, each) for name, each in channels.items()],
        sections=[*sections, Section("Settings", [Facts(facts)])],
        versions=content["provenance"],
    )


def _share(channel: Mapping[str, Any], key: str) -> float | None:
    """Median of a standard deviation relative to the response."""
    shares = [
        sd / (re**2 + im**2) ** 0.5
        for sd, re, im in zip(channel[key], channel["real"], channel["imaginary"], strict=True)
        if sd is not None
    ]
    return sorted(shares)[len(shares) // 2] if shares else None


def _sentence(name: str, channel: Mapping[str, Any]) -> Sentence:
    """How far each model is from the measured response of an output."""
    words = name.replace("_", " ").capitalize()
    models = channel["models"]
    if not models:
        return f"{words}: measured at {len(channel['frequency'])} frequencies.", None
    distances = [each["distance"] for each in models.values() if each["distance"] is not None]
    if not distances:
        return f"{words}: hidden by noise at every frequency; drive harder or longer.", DOUBT
    listed = ", ".join(f"{percent(each['distance'], 2)} from the {model} model" for model, each in models.items())
    return f"{words}: {listed} (RMS over the reliable frequencies).", True if min(distances) <= CLOSE else DOUBT


def _table(channels: Mapping[str, Mapping[str, Any]]) -> Table:
    models = list(next(iter(channels.values()))["models"])
    head = ["output", "from", "to", "sd by\nnoise", "sd by\nnonlinearity", "even\nlines", "mean\ncoherence"]
    rows = []
    for name, each in channels.items():
        coherence = [value for value in each["coherence"] if value is not None]
        ends = (f"{value_text(each['frequency'][k])} Hz" for k in (0, -1))
        rows.append(
            [name.replace("_", " "), *ends,
             percent(_share(each, "noise_sd"), 2), percent(_share(each, "nonlinear_sd"), 2), percent(each["even"], 2),
             value_text(sum(coherence) / len(coherence), 1.0, 3) if coherence else "–",
             *(percent(each["models"][model]["distance"], 2) for model in models)]
        )  # fmt: skip
    return Table(
        "Medians over the frequencies, relative to the response", [*head, *(f"{m}\nmodel" for m in models)], rows
    )


def _subspace(subspace: Mapping[str, Any]) -> list[Any]:
    values = subspace["singular_values"][:12]
    rows = [[str(k + 1), value_text(value / values[0], 1.0, 3)] for k, value in enumerate(values)]
    fits = ", ".join(f"{name.replace('_', ' ')} {value_text(fit)} %" for name, fit in subspace["fit_percent"].items())
    return [
        Paragraph(f"Order {subspace['order']}, fit of its simulation: {fits}."),
        Table("Singular values of the impulse response, relative to the first", ["number", "value"], rows),
    ]


KIND = Kind("frequency_response.json", "frequency response", _read)
