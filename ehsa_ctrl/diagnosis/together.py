"""Several logs of one rig in one diagnosis: what they must have in common, and where their gap lies together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core.errors import InputError
from ..core.log import TIME_TOLERANCE, Log
from ..core.text import join_words
from .gap_attribution import Location


def check_other(logs: Sequence[Log], validate: Log) -> None:
    """Raises InputError for a log for validation that is one of those to fit: it would validate nothing."""
    for log in logs:
        same_file = log.path is not None and validate.path is not None and log.path.resolve() == validate.path.resolve()
        if same_file or log is validate:
            raise InputError(
                f"{validate.path or 'the log for validation'}: is also the log that is fitted; give another log of the "
                "rig, or leave it out: a third of the log is held out then"
            )


def check_together(logs: Sequence[Log]) -> None:
    """Raises InputError for no log, a log given twice, or logs with other sample times or channels than the first."""
    if not logs:
        raise InputError("no log to diagnose; give at least one")
    first, *others = logs
    files = [log.path.resolve() for log in logs if log.path is not None]
    twice = next((file for file in files if files.count(file) > 1), None)
    if twice is not None or any(a is b for i, a in enumerate(logs) for b in logs[:i]):
        raise InputError(f"{twice or 'a log'}: is given twice; give each log once")
    for log in others:
        name, reference = log.path or "a log", first.path or "the first log"
        if abs(log.sample_time / first.sample_time - 1.0) > TIME_TOLERANCE:
            raise InputError(
                f"{name}: has a sample time of {1e3 * log.sample_time:.4g} ms, but {reference} one of "
                f"{1e3 * first.sample_time:.4g} ms; logs that are diagnosed together need the same, for instance with "
                f"--resample {1.0 / max(log.sample_time, first.sample_time):.4g}"
            )
        missing = [channel for channel in first.channels if channel not in log.channels]
        more = [channel for channel in log.channels if channel not in first.channels]
        if missing or more:
            lacks, has = (name, reference) if missing else (reference, name)
            raise InputError(
                f"{lacks}: has no channel {join_words(missing or more)}, but {has} has; logs that are diagnosed "
                "together need the same channels: leave the column out of the others, or diagnose this log alone"
            )


def joint_location(locations: Mapping[str, Location], gaps: Sequence[float]) -> Location:
    """The place of a gap over several logs: shares weighted by the squared gap of each log.

    locations: name of the log -> its location. gaps: total gap of the nominal plant over each whole log. Unknown inputs
    and regimes are those of the log with the largest gap.
    """
    found = list(locations.values())
    if len(found) == 1:
        return found[0]
    weights = np.square(gaps) / max(float(np.sum(np.square(gaps))), 1e-300)
    largest = int(np.argmax(weights))
    places = dict.fromkeys(place for one in found for place, _ in one.shares)
    shares = {p: _mean([dict(one.shares).get(p, 0.0) for one in found], weights) for p in places}
    signals = dict.fromkeys(name for one in found for name in one.by_signal)
    by_signal: dict[str, dict[str, float]] = {}
    for name in signals:
        own = np.square([one.by_signal.get(name, {}).get("gap", 0.0) for one in found])
        parts = dict.fromkeys(part for one in found for part in one.by_signal.get(name, {}))
        by_signal[name] = {
            part: float(np.sqrt(np.mean(own)))
            if part == "gap"
            else _mean([one.by_signal.get(name, {}).get(part, 0.0) for one in found], own / max(own.sum(), 1e-300))
            for part in parts
        }
    return replace(
        found[largest],
        shares=tuple(sorted(shares.items(), key=lambda row: -row[1])),
        by_signal=by_signal,
        explained=_mean([one.explained for one in found], weights),
        log=list(locations)[largest],
    )


def _mean(values: Sequence[float], weights: np.ndarray) -> float:
    return float(np.dot(values, weights))
