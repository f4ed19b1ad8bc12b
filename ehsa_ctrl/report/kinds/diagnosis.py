"""The page of a diagnosis: the verdict, then signals, places, causes, other hypotheses, gaps, the next experiment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.files import read_json
from ...core.text import join_words, stems, unique_names
from ...diagnosis.diagnosis import MODEL_WORDS, models_shown
from ...physics.effects import PLACES
from ...plant.file import label
from ..chart import RegimeCurve
from ..closed_loop import closed_loop_section, closed_loop_sentences, replay_section
from ..outcome import OUTCOMES, after_model, after_words, outcome
from ..page import DOUBT, Facts, Kind, Page, Paragraph, Picture, Points, Section, Sentence, State, Table
from ..signals import BALANCES, channel_display, signal_display
from ..text import NOTHING, as_sentence, percent, quantity, unit, value_text
from ._charts import REGIMES, charted, free_run_chart, loop_replay_chart, regime_curves
from ._diagnosis_causes import cause_name, cause_section, causes_are_named, parameter_rows
from ._diagnosis_law import law_section
from ._tables import settings_of, steps_of

Content = Mapping[str, Any]
#: The sensor indicated by the balances is shown from this share of the gap on (engineering judgement).
SENSOR_SHARE = 0.05
#: Verdict -> state and heading of the page.
VERDICTS: dict[str, tuple[State, str]] = {
    "no_gap": (True, "no relevant gap"),
    "effect": (True, "the cause is identified"),
    "ambiguous": (DOUBT, "several causes that the data cannot distinguish"),
    "parameters": (True, "nominal values are wrong, no effect is needed"),
    "partly": (DOUBT, "the cause of part of the gap is identified"),
    "outside_catalogue": (False, "no known effect explains the gap"),
    "underdetermined": (DOUBT, "the data do not show the cause"),
}
#: The same where a law is proposed, whatever the verdict.
LAW_VERDICT: tuple[State, str] = (DOUBT, "a law that the catalogue lacks explains the gap")


def _read(content: Content, folder: Path) -> Page:
    closed = read_json(folder / "closed_loop.json") if (folder / "closed_loop.json").is_file() else None
    state, heading = VERDICTS.get(content["verdict"], (False, str(content["verdict"])))
    if content.get("law"):
        state, heading = LAW_VERDICT
    sentences: list[Sentence] = [(content["change"], None)] if "change" in content else []
    sentences += [(content["sentence"], state), *_summary(content)]
    if closed is not None:
        sentences += list(closed_loop_sentences(closed))
    sentences += [(f"Data quality: {str(words).rstrip('.')}.", DOUBT) for words in content["findings"]]
    # A picture, the numbers, why, where, what next; the same order whatever the verdict.
    ordered = [_signals(content, folder), _gaps(content)]
    if content["verdict"] != "no_gap":
        law = [law_section(content)] if content.get("law") else []
        ordered += [*law, _causes(content), _where(content), _next(content), _candidates(content)]
    model = f" ({content['model']})" if content.get("model") else ""
    return Page(
        title=f"Diagnosis of {_log(content)}: {heading}",
        sentences=sentences,
        notes=[
            f"{content.get('plant', 'The plant')}{model} is simulated in free run with the logged input. Held-out "
            f"data, which no fit uses: {content['held_out']}."
        ],
        sections=[
            *([_changed(content)] if "change" in content else []),
            *ordered,
            *([_replayed(content, folder)] if "closed_loop_replay" in content else []),
            *([closed_loop_section(closed)] if closed is not None else []),
            _recorded(content),
        ],
        facts=[
            ("log", ", ".join(_names(content)) if "logs" in content else str(content.get("log") or "not from a file")),
            *([("title", str(content["plant_title"]))] if "plant_title" in content else []),
            *settings_of(content),
            ("held out", str(content["held_out"])),
            ("relevant gap", f"{percent(content['threshold'])} or more"),
            ("computation", f"{value_text(content['seconds'], 1.0, 2)} s, {content['runs']} simulations"),
        ],
        versions=content["provenance"],
    )


def _log(content: Content) -> str:
    """Names of log and plant, as far as the file states them."""
    files = [Path(name) for name in (content.get("rests_on") or {}).get("files", {})]
    names = _names(content)
    if names:
        return f"{len(names)} logs on {content['plant']} together"
    log = Path(content["log"]).name if content.get("log") else next((f.name for f in files if f.suffix != ".toml"), "")
    plant = content.get("plant") or next((file.stem for file in files if file.suffix == ".toml"), "")
    return f"{log or 'a log'}{f' on {plant}' if plant else ''}"


def _summary(content: Content) -> Iterator[Sentence]:
    """Location, causes, reduction of the gap and next experiment, one sentence each."""
    if content["verdict"] == "no_gap":
        return
    if content["where"]:
        shares = [f"{w['place']} {percent(w['share'], 2)}" for w in content["where"] if w["share"] >= 0.01]
        yield f"Location: {', '.join(shares)} of the gap over the whole log.", None
    beside = (content.get("law") or {}).get("beside")
    for cause in content["effects"]:
        values = ", ".join(f"{name} = {value} {of}".rstrip() for name, value, _, of, _ in parameter_rows(cause))
        others = f"; or {' or '.join(cause['ambiguous_with'])}" if cause["ambiguous_with"] else ""
        word = "Cause" if beside is None or cause["id"] in beside else "Without the law"
        yield (
            f"{word}: {cause_name(cause)}, probability {value_text(cause['probability'], 1.0, 2)}: {values}{others}.",
            None,
        )
    if not content["effects"] and not content.get("law"):
        nearest = content.get("nearest_sentence")
        yield f"Cause: no effect of the catalogue{f'; {nearest}' if nearest else ''}.", None
    after = after_model(content["verdict"], content["gap"])
    if after is not None:
        gap = content["gap"]
        change = f"from {percent(gap['nominal']['total'], 2)} to {percent(gap[after]['total'], 2)}"
        words = after_words(content["verdict"], len(content["effects"]), content["gap"])
        yield f"Reduction: the total gap on held-out data falls {change} {words}.", None
    if content["next_experiment"]:
        yield f"Next experiment: {content['next_experiment'].rstrip('.')}.", None


def _changed(content: Content) -> Section:
    """Changes since an earlier log."""
    before = content["before"]
    rows = [
        [label(name), value_text(each["nominal"]), value_text(each["value"]), unit(each["unit"])]
        for name, each in before.get("parameters", {}).items()
    ]
    facts = [
        ("earlier log", f"{before['log'] or 'not from a file'}: {before['sentence']}"),
        ("plant at the earlier log", str(before["brought"])),
        ("later log", "all following sections, compared with the plant as it was at the earlier log"),
    ]
    table = Table("Plant at the earlier log", ["name", "nominal", "then", "unit"], rows)
    return Section("What changed", [Paragraph(content["change"]), Facts(facts), table], "changed")


def _signals(content: Content, folder: Path) -> Section:
    caption = (
        "Free runs, driven by the logged input alone. A gap is the RMS of measured minus simulated on held-out data, "
        "with the sensor noise subtracted, over the standard deviation of the signal; 0 % is within the noise. A run "
        "far from the measurement leaves its panel."
    )
    names = _names(content) or [""]
    pictures = [
        Picture(
            stem,
            f"Measured and simulated{f', {name}' if name else ''}",
            caption if stem == "signals" else "",
            bool(name),
        )
        for stem, name in zip(stems("signals", len(names)), names, strict=True)
    ]
    rows = content.get("logs") or [content]
    blocks: list[Any] = [Paragraph(_remaining_gap(content))]
    for picture, name, row in zip(pictures, names, rows, strict=True):
        chart = free_run_chart(
            folder, f"{picture.stem}.csv", [picture],
            after=after_words(content["verdict"], len(content["effects"]), content["gap"]),
            effect=_switched(content),
            shaded=[(float(start), float(end)) for start, end in row.get("held_spans", [])],
            regimes=_regimes(content, folder, name),
        )  # fmt: skip
        blocks += charted(chart, [picture])
    return Section("Measured and simulated", blocks, "signals")


def _replayed(content: Content, folder: Path) -> Section:
    """The replay in closed loop with its chart."""
    caption = "Top: measured minus simulated position. Bottom: the drive. Shaded: the held-out data."
    pictures = [Picture("closed_loop_replay", "Closed-loop replay", caption)]
    after = after_words(content["verdict"], len(content["effects"]), content["closed_loop"])
    spans = [(float(start), float(end)) for start, end in content.get("held_spans", [])]
    return replay_section(content, charted(loop_replay_chart(folder, pictures, after, spans), pictures))


def _switched(content: Content) -> str:
    """What the run "after" has and the run "before" lacks, for a button; empty if it is no cause."""
    if content.get("law"):
        return "the proposed law"
    return join_words([cause_name(cause) for cause in content["effects"]]) if causes_are_named(content) else ""


def _regimes(content: Content, folder: Path, log: str) -> list[RegimeCurve]:
    """The curves of the regimes, at the log that they are of."""
    location = content.get("location") or {}
    if location.get("log") and log and str(location["log"]) != log:
        return []
    return regime_curves(location.get("regimes", []), folder, REGIMES)


def _names(content: Content) -> list[str]:
    """Names of the logs that were diagnosed together; empty for a single log."""
    paths = [row["path"] for row in content.get("logs") or []]
    if all(paths):
        return unique_names(paths)
    return [Path(path).name if path else f"log {number}" for number, path in enumerate(paths, 1)]


def _remaining_gap(content: Content) -> str:
    """The signals that still have a relevant gap, as a sentence."""
    after = after_model(content["verdict"], content["gap"])
    gaps, limit = content["gap"][after or "nominal"], content["threshold"]
    left = [signal_display(name).words for name, gap in gaps.items() if name != "total" and (gap or 0.0) >= limit]
    model = "With the nominal parameters"
    if after is not None:
        words = after_words(content["verdict"], len(content["effects"]), content["gap"])
        model = as_sentence(words).rstrip(".")
    if not left:
        return f"{model}, the gap of every signal is below {percent(limit)} on held-out data."
    verb = "have" if len(left) > 1 else "has"
    return f"{model}, {join_words(left)} still {verb} a gap of {percent(limit)} or more on held-out data."


def _where(content: Content) -> Section:
    if not content["where"]:
        return Section("Location of the gap", [])
    location, named = content.get("location"), causes_are_named(content)
    balances = location["shares"] if location is not None else {}
    causes = {w["place"]: w["share"] for w in content["where"]} if named or location is None else {}
    columns = [("from the causes", causes)] * bool(causes) + [("from the balances", balances)] * bool(balances)
    rows = [[place, *(f"{100.0 * shares.get(place, 0.0):.0f} %" for _, shares in columns)] for place in PLACES]
    blocks: list[Any] = [
        Picture(
            "where",
            "Shares of the gap by place",
            "Whole log. Left: shares of the squared gap. The balances use no catalogue of effects: the unknown input "
            "of each balance is estimated and added to a simulation. Right: the gap over time, and the gap that "
            "remains with these inputs.",
        ),
        Table("Share of the gap over the whole log", ["place", *(head for head, _ in columns)], rows),
    ]
    if location is None:
        return Section("Location of the gap", blocks, "where")
    if location.get("log"):
        words = "Shares are weighted by the squared gaps of the logs; what is drawn over time is that of"
        blocks.append(Paragraph(f"{words} {location['log']}, which has the largest gap."))
    if location["sensor"] is not None and (balances.get("sensor") or 0.0) >= SENSOR_SHARE:
        blocks.append(Paragraph(f"Sensor indicated by the balances: {location['sensor']}."))
    by_signal = [
        [signal_display(name).words, percent(parts["gap"], 2),
         *(f"{round(100.0 * parts[place])} %" if parts.get(place) is not None else NOTHING for place in PLACES)]
        for name, parts in location["by_signal"].items()
    ]  # fmt: skip
    caption = "Gap of the nominal plant over the whole log, and the share of its square that each balance explains"
    regimes = [
        [
            BALANCES.get(regime["balance"], regime["balance"]),
            regime["words"],
            percent(regime["explained"], 2),
            _closed_share(regime["gap_closed"]),
        ]
        for regime in location["regimes"]
    ]
    blocks += [
        Table(caption, ["signal", "gap", *PLACES], by_signal),
        Picture(
            "unknown_inputs",
            "Unknown inputs of the balances",
            "The unknown input of each balance, smoothed, and the variable that it depends on: mean per bin, with a "
            "band of one standard deviation. A positive torque or flow assists the motion, a positive force resists "
            "extension; an input that opposes the motion is multiplied by the sign of the motion. The explained share "
            "refers to data that was not fitted.",
        ),
        Table(
            "Variables that the unknown inputs depend on",
            ["balance", "dependence", "explained", "squared gap\nclosed"],
            regimes,
        ),
    ]
    return Section("Location of the gap", blocks, "where")


def _closed_share(share: float | None) -> str:
    """Share of the squared gap that a curve alone closes; a dash if it was not tried."""
    if share is None or share != share:
        return NOTHING
    return f"{100.0 * share:.0f} %" if share >= 0.005 else "none"


def _causes(content: Content) -> Section:
    titles = {"outside_catalogue": "Effects in addition to the unknown cause", "underdetermined": "Candidates"}
    sections = [cause_section(cause, content) for cause in content["effects"]]
    title = titles.get(content["verdict"], "Causes")
    law = content.get("law")
    if law and not law["beside"]:
        title = "Effects that would explain part of the gap without the law"
    return Section(title, sections, "causes")


def _candidates(content: Content) -> Section:
    causes = {cause_name(cause): cause["ambiguous_with"] for cause in content["effects"]}
    rows = []
    for candidate in content.get("candidates") or []:
        members = candidate["members"]
        rows.append(
            [" + ".join(members) or "nominal parameters alone", value_text(candidate["evidence"], 1.0, 3),
             percent(candidate["gap"], 2), OUTCOMES[outcome(content["verdict"], causes, members)]]
        )  # fmt: skip
    head = ["causes", "2 Δ log-likelihood", "largest gap,\nheld out", "outcome"]
    caption = (
        "Twice the difference of the log-likelihood from that of the best hypothesis, with the nominal parameters "
        "refitted; logarithmic axis, a longer bar is a worse hypothesis. Right: its largest gap of a signal on "
        "held-out data."
    )
    blocks = [Picture("candidates", "Hypotheses", caption), Table("Fitted hypotheses", head, rows)]
    return Section("Hypotheses", blocks if rows else [], "candidates", folded=True)


def _gaps(content: Content) -> Section:
    gaps, limit = content["gap"], content["threshold"]
    whole = content.get("gap_whole_log", {})
    models = [model for model in models_shown(content["verdict"], gaps) if model in MODEL_WORDS]
    rows = []
    for name in gaps["nominal"]:
        words = name if name == "total" else signal_display(name).words
        marked = _marked([gaps[model].get(name) for model in models], limit)
        rows.append([words, percent(whole.get(name), 2), *marked])
    head = ["signal", "whole log\nnominal", *(f"held out\n{MODEL_WORDS[model]}" for model in models)]
    caption = (
        "Refit: the nominal parameters alone, far beyond their uncertainty. Bars much longer than the others are cut."
    )
    blocks: list[Any] = [
        Picture("shrinkage", "Gap of each model", caption),
        Table("Gap in % of the signal's standard deviation; ● marks a relevant gap", head, rows),
    ]
    if content.get("folds"):
        blocks.append(_by_third(content))
    if content.get("logs"):
        blocks.append(_by_log(content, models))
    if causes_are_named(content) and len(content["effects"]) > 1:
        parts = [[cause_name(cause), percent(cause["gap_closed"])] for cause in content["effects"]]
        caption = "Part of each cause: mean over all orders in which the causes can be added (Shapley value)"
        blocks.append(Table(caption, ["cause", "gap closed"], parts))
    return Section("Gap of each model", blocks, "gaps")


def _marked(gaps: Iterable[float | None], limit: float) -> list[str]:
    """Gaps in percent, with a mark where they are relevant."""
    return [f"{'● ' if gap is not None and gap >= limit else ''}{percent(gap, 2)}" for gap in gaps]


def _by_third(content: Content) -> Table:
    """Gaps with each third of the log held out in turn."""
    limit, rows = content["threshold"], []
    for fold in content["folds"]:
        for model in ("nominal", "with_effects"):
            rows.append([fold["part"], MODEL_WORDS[model], *_marked(fold["gap"][model].values(), limit)])
    signals = [n if n == "total" else signal_display(n).words for n in content["folds"][0]["gap"]["nominal"]]
    caption = "Thirds held out in turn: the gap there, and with the causes refitted to the rest of the log"
    return Table(caption, ["held out", "model", *signals], rows)


def _by_log(content: Content, models: Sequence[str]) -> Table:
    """Total gap of each log."""
    rows = [
        [name, percent(row["gap_whole_log"].get("total"), 2),
         *(percent(row["gap"].get(model, {}).get("total"), 2) for model in models)]
        for name, row in zip(_names(content), content["logs"], strict=True)
    ]  # fmt: skip
    head = ["log", "whole log\nnominal", *(f"held out\n{MODEL_WORDS[model]}" for model in models)]
    return Table("Total gap of each log; the gaps above are means of squares over the logs", head, rows)


def _next(content: Content) -> Section:
    words = [as_sentence(content["next_experiment"])] if content["next_experiment"] else []
    words += [as_sentence(each) for each in (content.get("location") or {}).get("untold", [])]
    return Section("Next experiment", [Paragraph(each) for each in words], "next")


def _recorded(content: Content) -> Section:
    """Data quality, preparation and noise of the log."""
    rows = []
    for channel, sd in content["noise_sd"].items():
        how = channel_display(channel)
        rows.append([how.words, value_text(sd, how.scale, 3), unit(how.unit)])
    findings, steps = content["findings"], steps_of(content)
    blocks: list[Any] = []
    if "samples" in content:
        spacing = quantity(1e3 * content["sample_time"], "ms")
        blocks.append(Facts([("samples", f"{content['samples']}, {spacing} apart")]))
    blocks += (
        [Paragraph("Data quality:"), Points(findings)]
        if findings
        else [Paragraph("The data quality check found nothing.")]
    )
    blocks += [Paragraph("Preparation:"), Points(steps)] if steps else []
    caption = "Noise estimated from the log, one standard deviation"
    return Section("The log", [*blocks, Table(caption, ["channel", "noise", "unit"], rows)], "log", folded=True)


KIND = Kind("diagnosis.json", "diagnosis", _read, page="diagnosis.html")
