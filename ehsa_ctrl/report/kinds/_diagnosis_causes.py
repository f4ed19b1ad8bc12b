"""Sections for the causes of a diagnosis: parameters, closed gap, indistinguishable effects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...core.text import join_words
from ...diagnosis.diagnosis import NAMING
from ...plant.file import label
from ..page import DOUBT, Facts, Paragraph, Points, Section, Table
from ..signals import signal_display, unit_of_number
from ..text import as_sentence, percent, uncertain, unit, value_text

Content = Mapping[str, Any]
INFINITE = float("inf")


def cause_name(cause: Content) -> str:
    return str(cause["id"]) + (f" ({cause['channel']})" if cause["channel"] else "")


def causes_are_named(content: Content) -> bool:
    """Whether the verdict names causes."""
    return content["verdict"] in NAMING


def cause_section(cause: Content, content: Content) -> Section:
    blocks: list[Any] = []
    if "summary" in cause:
        blocks.append(Paragraph(f"{as_sentence(cause['summary'])} In a log: {cause['fingerprint']}."))
    head = ["name", "found", "nominal", "unit", "meaning"]
    blocks.append(Table("Parameters, with one standard deviation", head, parameter_rows(cause)))
    facts = [("place", str(cause["place"]))] if "place" in cause else []
    if causes_are_named(content):
        part = ", as the part of this cause" if len(content["effects"]) > 1 else ""
        facts.append(("gap closed", f"{percent(cause['gap_closed'])} of the total gap on held-out data{part}"))
        words = "of this reduction, which a refit of the nominal parameters alone would also achieve"
        facts.append(("absorbed by a refit", f"{percent(cause['absorbed_by_refit'])} {words}"))
    alone = [
        f"{signal_display(n).words} {percent(gap, 2)}" for n, gap in cause.get("alone", {}).items() if n != "total"
    ]
    if alone:
        facts.append(("gap due to this cause alone", f"{', '.join(alone)}; the larger of fitted and held-out data"))
    blocks.append(Facts(facts))
    why = cause.get("why_same", {})
    similar = [other for other in cause["ambiguous_with"] if other not in why]
    if similar:
        blocks.append(
            Paragraph(f"The data cannot distinguish it from {join_words(similar)}; another excitation is needed.")
        )
    equivalent = [f"{other}: {why[other]}" for other in cause["ambiguous_with"] if other in why]
    if equivalent:
        blocks += [Paragraph("No log with these channels can distinguish it from:"), Points(equivalent)]
    certain = cause["probability"] >= 0.9 and not cause["ambiguous_with"]
    heading = f"{cause_name(cause)}: probability {cause['probability']:.2f}"
    return Section(heading, blocks, state=True if certain else DOUBT)


def parameter_rows(cause: Content) -> list[list[str]]:
    """Name, value found, nominal value, unit and meaning of each parameter of a cause, in display units."""
    rows = []
    for name, number in cause["parameters"].items():
        sd = INFINITE if number["sd"] is None else number["sd"]
        usual, scale = number["unit"], 1.0
        if number.get("belongs_to") != "plant":
            usual, scale = unit_of_number(number["unit"], number["value"])
        nominal = number.get("nominal")
        words = "absent" if nominal is None and "nominal" in number else value_text(nominal, scale)
        value = uncertain(number["value"] / scale, sd / scale)
        if number["sd"] is None:
            value += " (not determined)"
        rows.append([label(number.get("name", name)), value, words, unit(usual), number.get("meaning", "")])
    return rows
