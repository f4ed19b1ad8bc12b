"""Tests of the linear loop: is it stable, by how much, what does it leave standing, is there time for it."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite

import numpy as np

from ..analysis.closed import INPUTS, OUTPUTS
from .case import Case
from .finding import Finding, judge

#: What is asked of a loop: largest |S|, smallest disk margin, samples in a period of the crossover.
MS, DISK, SAMPLES = 1.6, 0.6, 10.0
#: Share of the sample time that a solver may take at most, and share of the current limit that noise may.
SOLVER_SHARE, NOISE_SHARE = 0.5, 0.02


def stable(case: Case) -> Iterator[Finding]:
    radius = float(np.max(np.abs(case.loop.poles), initial=0.0))
    yield Finding(
        "closed loop stable",
        f"largest |pole| {radius:.5f}" + ("" if case.loop.stable else ": NOT STABLE"),
        judge(not case.loop.stable, "fault"),
        "lower the gains or the crossover; check the sign of the feedback",
    )
    own = np.linalg.eigvals(case.law.A) if case.law.nstates else np.zeros(1)
    inner = float(np.max(np.abs(own)))
    yield Finding(
        "controller stable by itself",
        f"largest |pole| {inner:.5f}" + (" (integral action)" if abs(inner - 1.0) < 1e-9 else ""),
        judge(inner > 1.0 + 1e-9),
        "an unstable law runs away where the current is limited: lower the crossover or detune the observer",
    )


def margins(case: Case) -> Iterator[Finding]:
    loop = case.loop
    if not loop.stable:
        return
    yield Finding(
        "Ms", f"{loop.Ms:.3g}, asked at most {MS:g}", judge(loop.Ms > MS), "lower the crossover or ask for more phase"
    )
    yield Finding(
        "disk margin",
        f"{loop.disk_margin:.3g}, asked at least {DISK:g}",
        judge(loop.disk_margin < DISK),
        "lower the crossover or ask for more phase",
    )
    samples = loop.delay_margin / case.sample_time
    yield Finding(
        "delay margin",
        f"{1e3 * loop.delay_margin:.3g} ms, {samples:.3g} samples",
        judge(samples < 2.0, "fault" if samples < 1.0 else "warning"),
        "one sample of extra delay is soon there: lower the crossover or sample faster",
    )
    if loop.crossover > 0:
        turn = 2 * np.pi / (loop.crossover * case.sample_time)
        yield Finding(
            "sampling", f"{turn:.3g} samples a period of the crossover", judge(turn < SAMPLES), "sample faster"
        )


def worst(case: Case) -> Iterator[Finding]:
    if case.robust is None:
        return
    worst = case.robust.worst["disk_margin"]
    yield Finding(
        "worst disk margin",
        f"{case.robust.disk_margin:.3g} over {len(case.robust.loops)} plants, at {worst.label}",
        judge(case.robust.disk_margin < DISK, "warning" if case.robust.stable else "fault"),
        "lower the crossover, or know that parameter better",
    )
    worst = case.robust.worst["Ms"]
    yield Finding(
        "worst Ms",
        f"{case.robust.Ms:.3g} over {len(case.robust.loops)} plants, at {worst.label}",
        judge(not case.robust.Ms <= MS, "warning" if case.robust.stable else "fault"),
        "lower the crossover, or know that parameter better",
    )


def standing(case: Case) -> Iterator[Finding]:
    """What a linear loop leaves standing: reference, load, spring."""
    if not case.loop.stable:
        return
    closed, row = case.closed, OUTPUTS.index("position")
    column = INPUTS.index("r_position")
    gain = float(closed.C[row] @ np.linalg.solve(np.eye(closed.nstates) - closed.A, closed.B[:, column]))
    yield Finding(
        "reaches its target",
        f"{100 * (1 - gain):.3g} % short in the long run" if abs(1 - gain) > 1e-6 else "without error, linearly",
        judge(abs(1 - gain) > 1e-3),
        "add integral action, an estimate of the disturbance, or a reference gain",
    )
    static = abs(case.loop.static_compliance)
    words = f"{1e9 * static:.3g} um for each kN that lasts" if static > 1e-15 else "none"
    if case.stiffness > 0:
        words += f", with a spring of {1e-3 * case.stiffness:.4g} kN/m"
    yield Finding("droop under load", words, judge(static > 1e-7), "add integral action or an estimate of the load")


def noise(case: Case) -> Iterator[Finding]:
    limit = float(getattr(case.controller, "current_limit", inf))
    if not isfinite(case.loop.current_noise):
        return
    share = case.loop.current_noise / limit if isfinite(limit) else 0.0
    yield Finding(
        "noise in the current",
        f"{1e3 * case.loop.current_noise:.3g} mA rms" + (f", {100 * share:.2g} % of the limit" if share else ""),
        judge(share > NOISE_SHARE),
        "filter the derivative more, or trust the model more in the observer",
    )


def solver(case: Case) -> Iterator[Finding]:
    h = case.sample_time
    if isfinite(case.known.solver_time):
        share = case.known.solver_time / h
        yield Finding(
            "solver time",
            f"at most {1e3 * case.known.solver_time:.3g} ms of {1e3 * h:.3g} ms a sample",
            judge(share > SOLVER_SHARE, "fault" if share > 1.0 else "warning"),
            "shorten the horizon, choose a faster solver or set a deadline",
        )
    horizon = getattr(case.feedback, "horizon", None)
    if horizon is None or not case.loop.stable:
        return
    rise = case.rise_time
    yield Finding(
        "horizon",
        f"{horizon} samples are {1e3 * horizon * h:.4g} ms, the loop rises in {1e3 * rise:.4g} ms",
        judge(bool(horizon * h < rise)),
        "lengthen the horizon; with a terminal cost it is the limits beyond it that are not seen",
    )
