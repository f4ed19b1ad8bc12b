"""The section of a diagnosis' page on the law that it proposes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...physics.effects import ADDENDS
from ..page import Paragraph, Picture, Section, Table
from ..text import percent, unit, value_text

#: A law that explains less of the unknown input than this is not seen in its curve. Engineering judgement.
SEEN = 0.1


def law_section(content: Mapping[str, Any]) -> Section:
    """The forms of the law with their numbers; empty without a law."""
    law = content.get("law")
    if not law:
        return Section("Law", [])
    rows = [[f["expression"], value_text(f["probability"], 1.0, 2), percent(f["gap_closed"], 2)] for f in law["forms"]]
    numbers = [
        [name, value_text(p["value"], 1.0, 4), value_text(p["sd"], 1.0, 2), unit(p["unit"])]
        for name, p in law["forms"][0]["parameters"].items()
    ]
    ranges = "; ".join(f"{name} {low:.3g} to {high:.3g}" for name, (low, high) in law["range"].items())
    beside = f"It acts beside {', '.join(law['beside'])}. " if law.get("beside") else ""
    words = [
        f"No effect of the catalogue has this law. It is a {ADDENDS[law['place']].meaning}. {beside}Forms that the "
        f"log can't tell apart are listed together. Seen in the log, in SI units: {ranges or 'no variable'}.",
    ]
    if law["explained"] < SEEN:
        words.append(
            f"The law explains {percent(max(law['explained'], 0.0), 2)} of the unknown input, so that the left curve "
            "hardly shows it: it acts for some samples at a time, such as a valve, or while the rig stands still. The "
            "evidence for it is the simulation, whose gap it closes."
        )
    if law.get("proposal"):
        words.append(
            f"{law['proposal']} is the first form as an effect, with status proposed. The improved plant has it: "
            "simulate and run with both where they are, or copy the file to effects/ of the project. Outside the "
            "range above the law is not known; a second log confirms it by `ehsa-ctrl effects confirm`."
        )
    caption = (
        "Left: unknown input in bins of the variable, mean with its standard deviation (each passage through a bin "
        "counts once), and the law. Right: what the law leaves. The sign of dry friction, and of the flow of a "
        "displacement, follows the motion; where it depends on another variable than the speed, both directions are "
        "drawn apart."
    )
    return Section(
        "Law",
        [
            *map(Paragraph, words),
            Picture("law", "Law along its variable", caption),
            Table("Forms, the most probable first", ["expression", "probability", "gap closed,\nheld out"], rows),
            Table("Numbers of the first form", ["name", "value", "sd", "unit"], numbers),
        ],
        "law",
    )
