"""Tests of what friction makes of a design: does the rod break away, where does it stand, does it hunt."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, isfinite

import numpy as np

from .case import Case
from .finding import Finding, Verdict, judge

#: The current limit over the current at breakaway: at the first the rod may never move, below the second hardly.
MOVES, MOVES_WELL = 1.0, 1.5
#: An error whose patience is told, m, and how long it is looked at, samples.
ERROR, PATIENCE = 1e-4, 5000


def creep(case: Case) -> Iterator[Finding]:
    """With the shaft held by friction the load's oil leaks past the pump: v = -K_L dP / A, dP = F / A."""
    leak = case.entry("dP", "dP") / case.entry("dP", "v")
    area = case.entry("v", "dP") / case.inverse_mass
    if not (isfinite(leak) and isfinite(area)) or area == 0.0:
        return
    per_force = leak / area
    force = case.stiffness * case.known.reach
    words = f"{1e9 * per_force:.3g} um/s for each kN while the shaft stands"
    if isfinite(force) and force > 0:
        words += f", {1e6 * per_force * force:.3g} um/s at {1e3 * case.known.reach:.3g} mm against the spring"
    yield Finding("creep by leakage", words, "good")


def friction(case: Case) -> Iterator[Finding]:
    """Breakaway, the band in which the rod sticks, and whether the integral hunts in it."""
    static, coulomb = case.known.static, case.known.coulomb
    if not (isfinite(static) and static > 0):
        return
    limit = float(getattr(case.controller, "current_limit", inf))
    load = case.known.reach * -case.entry("v", "x") / case.entry("v", "dP")
    torque = case.entry("omega", "dP") / case.input("omega", "current")
    spring = abs(load * torque) if isfinite(load * torque) else 0.0
    needed = static + spring
    words = f"{static:.3g} A" + (f" + {spring:.3g} A for the spring" if spring else "")
    verdict: Verdict = "fault" if limit <= MOVES * needed else judge(limit < MOVES_WELL * needed)
    yield Finding(
        "breakaway",
        f"{words} of {limit:.3g} A that may be asked",
        verdict,
        "raise current_limit, or ask for less reach",
    )
    yield _band(case)
    if case.integrates:
        hunts = isfinite(coulomb) and static > coulomb and not case.cured
        yield Finding(
            "limit cycle of the integral",
            f"static friction is {100 * (static / coulomb - 1):.3g} % above Coulomb friction, "
            + ("the integral is held at rest" if case.cured else "nothing holds the integral at rest")
            if isfinite(coulomb) and coulomb > 0
            else "Coulomb friction is not known",
            judge(hunts),
            "add a [rest] band of some sizes of the smallest slip, or take the integral out",
        )


def _band(case: Case) -> Finding:
    """Which errors stand: at once, and how long."""
    band = case.known.static / case.at_once if case.at_once > 0 else inf
    words = f"an error up to {1e6 * band:.4g} um stands"
    if case.integrates:
        current = np.abs(case.standing(PATIENCE)) * ERROR
        late = np.flatnonzero(current >= case.known.static)
        after = f"{late[0] * case.sample_time:.3g} s" if late.size else f"more than {PATIENCE * case.sample_time:g} s"
        words += f" until the integral has built up, one of {1e6 * ERROR:g} um for {after}"
    else:
        words += " for good"
    if isfinite(case.known.slip):
        words += f"; the smallest slip is {1e6 * case.known.slip:.3g} um"
    return Finding(
        "stick band",
        words,
        judge(not case.integrates and not case.cured),
        "add [feedforward] of friction or a [rest] with a knocker",
    )
