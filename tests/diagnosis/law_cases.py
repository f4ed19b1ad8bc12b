"""Unknown forces of a known form, for tests of laws."""

from dataclasses import replace

import numpy as np

from ehsa_ctrl.diagnosis.law.grammar import Grammar, LawVariable
from ehsa_ctrl.diagnosis.regimes import Windows

TIME = 0.004 * np.arange(6001)


def case(unknown):
    """Grammar and windows of a force that is this function of x, v and the direction, with 5 % of white noise."""
    x = 0.03 * np.sin(1.3 * TIME) + 0.012 * np.sin(3.1 * TIME + 1.0)
    v = np.gradient(x, TIME)
    known = {"x": x[:-1], "v": v[:-1], "d_R": np.where(v[:-1] < 0.0, -1.0, 1.0)}
    units = {"x": "m", "v": "m/s", "d_R": "1"}
    variables = LawVariable("v", "m/s", known["v"], speed=True), LawVariable("x", "m", known["x"], position=True)
    grammar = Grammar("force", variables, known, units, "d_R", known["v"], 0.0, 1.0)
    values = unknown(known["x"], known["v"], known["d_R"])
    noise = np.random.default_rng(0).standard_normal(values.size)
    windows = Windows(values + 0.05 * np.std(values) * noise, 0.004)
    return grammar, windows, np.zeros((windows.values.size, 0))


def with_memories(case, *memories):
    """The case with terms that remember, at 250 Hz."""
    grammar, windows, nuisance = case
    return replace(grammar, memories=tuple(memories), sample_time=0.004), windows, nuisance
