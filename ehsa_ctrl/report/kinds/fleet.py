"""The page of a fleet: which rigs changed, every rig's parameters and causes over time, and the fleet's parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from ...core.text import join_words
from ..grid import Grid, GridColumn, GridRow
from ..page import DOUBT, FileLink, Kind, Links, Page, Paragraph, Points, Section, Sentence, Table
from ..text import NOTHING, unit, value_text
from .diagnosis import KIND as DIAGNOSIS

Content = Mapping[str, Any]

#: Changed rigs that have a sentence at the top; changes of a rig, and rigs, in the table; logs that could not be used
#: and are listed.
NAMED, MOST_SIZES, MOST_RIGS, MOST_FAILED = 12, 2, 400, 50
#: Logs that the table links to: 250 kB of a page. Of each rig the newest, at least two.
MOST_LINKS = 2000
DAY = 86400.0
STATES = {"changed": "changed", "unlike": "unlike the fleet", "": "no change"}


def _read(content: Content, folder: Path) -> Page:
    counts, rate = content["counts"], f"{100.0 * content['rate']:g} %"
    return Page(
        title=f"Fleet of {counts['rigs']} rigs of {content['plant']}: "
        + (f"{counts['changed']} changed" if counts["changed"] else "none changed"),
        sentences=list(_sentences(content, rate)),
        notes=[
            "Each log is scored against the nominal plant: deviations of its parameters and the size of each cause. A "
            "rig changed if its logs differ by more than their uncertainty, and the fleet is tested as a whole."
        ],
        sections=[
            Section("Rigs", list(_rigs(content)), "rigs"),
            Section("Drifts", [_drifts(content["drifts"])], "drifts"),
            Section("Parameters of the fleet", [_parameters(content["parameters"])], "parameters"),
            Section("Logs that could not be used", [Points(list(content["failed"].values())[:MOST_FAILED])], "failed"),
        ],
        facts=[
            ("plant", str(content["plant"])), ("rigs", str(counts["rigs"])), ("logs", str(counts["logs"])),
            ("false-discovery rate", rate),
            ("causes tested", ", ".join(content["causes"])),
        ],
        versions=content["provenance"],
        covers=[rig["diagnosis"]["folder"] for rig in content["rigs"] if (rig["diagnosis"] or {}).get("folder")],
    )  # fmt: skip


def _sentences(content: Content, rate: str) -> Iterator[Sentence]:
    counts, changed = content["counts"], [rig for rig in _ordered(content["rigs"]) if rig["changed"]]
    words = f"{len(changed)} of {counts['rigs']} rigs changed (false-discovery rate {rate})."
    yield words, None if changed else True
    for rig in changed[:NAMED]:
        since = f"drifts from {_day(rig['since'])} on" if rig["kind"] == "drift" else f"since {_day(rig['since'])}"
        also = "".join(f"; {_day(one['since'])}: {_causes(one)}" for one in rig["further"])
        yield f"{rig['name']} {since}: {_causes(rig)}{also}.", DOUBT
    if len(changed) > NAMED:
        yield f"And {len(changed) - NAMED} more, in the table.", DOUBT
    unlike = [rig["name"] for rig in content["rigs"] if rig["unlike"]]
    if unlike:
        more = f" and {len(unlike) - NAMED} more" if len(unlike) > NAMED else ""
        yield f"Unlike the fleet from the first log on: {join_words(unlike[:NAMED])}{more}.", DOUBT
    if content["failed"]:
        many = len(content["failed"])
        yield f"{many} log{'s' if many > 1 else ''} could not be used.", DOUBT
    yield from ((str(note), None) for note in content["notes"])
    if content["score"]:
        score = content["score"]
        good = score["found"] == score["changed"] and score["false"] <= 1
        yield (
            f"Virtual fleet, against its truth: {score['found']} of {score['changed']} changed rigs found, "
            f"{score['dated']} with the right log, {score['named']} with the right cause; {score['false']} false.",
            good or DOUBT,
        )


def _ordered(rigs: Sequence[Content]) -> list[Content]:
    """Changed rigs first, the most significant before the others; then those unlike the fleet; then by name."""
    return sorted(rigs, key=lambda rig: (not rig["changed"], rig["p"] if rig["changed"] else 0.0, not rig["unlike"]))


def _state(rig: Content) -> str:
    return "changed" if rig["changed"] else "unlike" if rig["unlike"] else ""


def _causes(change: Content) -> str:
    """What changed, with what explains it as well."""
    return " or ".join([change["cause"], *change["same"]])


def _day(date: str) -> str:
    return date[:10]


def _what(rig: Content) -> str:
    """What changed and by how much by the score test, or in what the rig is unlike the fleet."""
    if not rig["changed"]:
        return f"△ unlike the fleet: {rig['unlike']}" if rig["unlike"] else ""
    also = [f"{_day(one['since'])}: {_causes(one)}\n{_sizes(one)}" for one in rig["further"]]
    return "\n".join([f"△ {_causes(rig)}\n{_sizes(rig)}".strip(), *also])


def _sizes(change: Content) -> str:
    """The first changes of its parameters, a line each."""
    return "\n".join(
        f"{name} {'+' if each['change'] > 0 else ''}{value_text(each['change'], 1.0, 2)} {unit(each['unit'])}".rstrip()
        for name, each in list(change["size"].items())[:MOST_SIZES]
    )


def _rigs(content: Content) -> Iterator[Any]:
    rigs = _ordered(content["rigs"])
    if len(rigs) > MOST_RIGS:
        words = f"The {MOST_RIGS} most significant of {len(rigs)} rigs; rigs.csv has all of them."
        yield Paragraph(words)
    shown = rigs[:MOST_RIGS]
    if not shown:
        return
    head = ["rig", "changed in", "since", "q", "diagnosis", "logs"]
    linked = max(MOST_LINKS // len(shown), 2)
    rows = [
        [rig["name"], _what(rig), _day(rig["since"]) + ("\ndrift" if rig["kind"] == "drift" else ""),
         value_text(rig["q"] if rig["changed"] or not rig["unlike"] else rig["unlike_q"], 1.0, 2),
         _diagnosis(rig), _logs(rig, linked)]
        for rig in shown
    ]  # fmt: skip
    caption = (
        "Changed rigs first. Small lines over time: sizes of causes, and parameters around the mean of the fleet; "
        "framed where the rig changed"
    )
    columns = _columns(content, shown)
    names = [column.name for column in columns]
    start = min((_days(log["date"]) for rig in shown for log in rig["logs"]), default=0.0)
    yield Grid(
        Table(caption, head, rows), columns,
        [
            GridRow(
                _state(rig), [_days(log["date"]) - start for log in rig["logs"]],
                [_series(rig, name, len(rig["logs"])) for name in names],
                names.index(_marked(rig)) if _marked(rig) in names else -1,
                _days(rig["since"]) - start if rig["since"] else float("nan"),
            )
            for rig in shown
        ],
        {state: words for state, words in STATES.items() if any(_state(rig) == state for rig in shown)},
    )  # fmt: skip
    yield Paragraph(
        "Each log with the rms of its residuals at the nominal plant, and with the parameters refitted, in units of "
        f"noise; ehsa-ctrl compare LOG --plant {content['plant']} shows one in full."
    )


def _marked(rig: Content) -> str:
    """The quantity that shows a rig's change: the cause, or the parameter by which a nominal value changed."""
    return next((name for name in (rig["scored"], *rig["size"]) if name in rig["series"]), "")


def _columns(content: Content, rigs: Sequence[Content]) -> list[GridColumn]:
    """What changed in most rigs first, then other causes, then the parameters of the plant."""
    parameters = {one["name"]: one for one in content["parameters"]}
    present = dict.fromkeys(name for rig in rigs for name in rig["series"])
    hits = [_marked(rig) for rig in rigs if rig["changed"]]
    units = {rig["scored"]: each["unit"] for rig in rigs for each in list(rig["size"].values())[:1]}
    columns = []
    for name in sorted(present, key=lambda name: (-hits.count(name), name in parameters)):
        if (one := parameters.get(name)) is not None:
            columns.append(GridColumn(name, one["unit"], one["mean"] - one["nominal"]))
        else:
            columns.append(GridColumn(name, units.get(name, ""), 0.0))
    return columns


def _series(rig: Content, name: str, logs: int) -> list[float] | None:
    """Values of a quantity in the rig's logs, nan where a log does not determine it; None if it was not scored."""
    values = rig["series"].get(name)
    if values is None or len(values) != logs:
        return None
    return [np.nan if value is None or sd is None else float(value) for value, sd in values]


def _days(date: str) -> float:
    """Days since 1970 of an ISO date."""
    return datetime.fromisoformat(date).timestamp() / DAY


def _diagnosis(rig: Content) -> str:
    """Verdict of the full diagnosis with a link to its page; why there is none."""
    found = rig["diagnosis"]
    if not found:
        return ""
    if found["error"]:
        return f"✗ {found['error']}"
    words = str(found["verdict"]).replace("_", " ")
    page = Path(found["folder"]) / DIAGNOSIS.page
    # Not looked up: the page is made in a folder of its own before it is put beside the others.
    inside = found["folder"] and not page.is_absolute() and ".." not in page.parts
    return FileLink(words, page.as_posix()) if inside else words


def _logs(rig: Content, most: int) -> str:
    """The newest logs of a rig, each a link to its file."""
    logs = rig["logs"][-most:]
    links = [
        FileLink(f"{_day(log['date'])}: {' → '.join(value_text(rms, 1.0, 2) for rms in log['rms'])}", log["place"])
        for log in reversed(logs)
        # A file on another drive has no place, and an edited JSON leads nowhere.
        if log["place"] and not Path(log["place"]).is_absolute()
    ]
    many = len(rig["logs"])
    words = f"{many} log{'s' if many != 1 else ''}" + (f", newest {len(logs)}" if len(logs) < many else "")
    return Links(words, links) if links else words


def _drifts(drifts: Sequence[Content]) -> Table:
    rows = [
        [each["rig"], each["parameter"], f"{value_text(365.25 * each['slope'], 1.0, 2)} {unit(each['unit'])}",
         value_text(365.25 * each["sd"], 1.0, 2), value_text(each["q"], 1.0, 2)]
        for each in drifts
        # A step explains the others better; its rig is among the changed ones.
        if not each["since"]
    ]  # fmt: skip
    return Table("Parameters that move with time", ["rig", "parameter", "slope a year", "its sd", "q"], rows)


def _parameters(parameters: Sequence[Content]) -> Table:
    rows = [
        [one["name"], value_text(one["nominal"]), value_text(one["mean"]), value_text(one["mean_sd"], 1.0, 2),
         NOTHING if one["spread"] is None else value_text(one["spread"], 1.0, 2), unit(one["unit"])]
        for one in parameters
    ]  # fmt: skip
    head = ["parameter", "nominal", "mean of\nthe fleet", "its sd", "spread\nbetween units", "unit"]
    return Table("Mean and spread between units; –: the logs do not determine it", head, rows)


KIND = Kind("fleet.json", "fleet", _read)
