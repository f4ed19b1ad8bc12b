"""Exact derivatives of the rates with every effect in, by states, inputs and the effect's own numbers."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.hypothesis_model import effects_with_parameters
from ehsa_ctrl.physics.effects import EFFECTS
from ehsa_ctrl.plant.arrays import evaluate_tape
from ehsa_ctrl.plant.plain import evaluator
from ehsa_ctrl.plant.tangent import Tangent
from ehsa_ctrl.plant.tape import build_tape

#: Sliding, at unequal pressures, with the rod and the current off the middle.
STATES = {"omega": 90.0, "P_1": 2.6e6, "P_2": 1.3e6, "v": 0.07, "x": 0.012}
INPUTS = {"current": 1.3, "F_D": 40.0}


def exact(equations, values, point, seeds):
    """rate -> seed -> derivative, by the tape's tangent."""
    tape = build_tape(equations)
    tangent = Tangent(tape, seeds)
    found = {rate: tangent.of(tape.refs[rate]) for rate in equations.rates}
    refs = [ref for by_seed in found.values() for ref in by_seed.values()]
    entries = iter(evaluate_tape(tape, refs, {**values, **point}))
    return {rate: {seed: float(next(entries)) for seed in by_seed} for rate, by_seed in found.items()}


@pytest.mark.parametrize("effect", effects_with_parameters())
def test_derivatives_are_those_of_the_rates(effect):
    """Also of an effect that gives its result the name of what it changes, as a lag does with the current."""
    plant = ehsa_ctrl.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
    own = {p.name: p.typical for p in EFFECTS[effect].parameters if p.name != plant.structure.delay}
    plant = plant.with_effects(effect, **{name: value for name, value in own.items() if np.isfinite(value)})
    equations = plant.structure.equations
    numbers = [name for name in own if plant[name] != 0.0 and np.isfinite(plant[name])]
    extra = {s.name: 0.4 * s.scale for s in equations.states if s.name not in STATES}
    point = {**STATES, **extra, **INPUTS, **dict.fromkeys(equations.directions, 1.0)}
    changing = [*(s.name for s in equations.states), *equations.inputs]
    point = {name: point[name] for name in [*changing, *equations.directions]}
    seeds = [*changing, *numbers]

    found = exact(equations, plant.values, point, seeds)

    for seed in seeds:
        here = point[seed] if seed in point else plant[seed]
        step = 1e-6 * max(abs(here), 1e-3) if seed in point else 1e-6 * abs(here)
        sides = []
        for sign in (1.0, -1.0):
            moved = {**point, **({seed: here + sign * step} if seed in point else {})}
            values = {**plant.values, **({} if seed in point else {seed: here + sign * step})}
            sides.append(evaluator(equations, values)(**moved))
        for rate in equations.rates:
            difference = (sides[0][rate] - sides[1][rate]) / (2.0 * step)
            size = max(abs(sides[0][rate]) / max(abs(here), 1e-3), 1e-6)
            assert found[rate].get(seed, 0.0) == pytest.approx(difference, rel=1e-4, abs=1e-4 * size), (rate, seed)
