"""Find the cause of a run that is too stiff: its fastest mode, and the parameters that determine it."""

from __future__ import annotations

import numpy as np

from ..core.unit import unit_suffix
from ..plant.file import label
from ..plant.linearise import OperatingPoint, jacobian
from ..plant.plain import evaluator
from ..plant.plant import Plant

#: Rate [1/s] above which a mode is stiff. The fastest mode of an actuator with steep valves is near 1e5.
STIFF = 1e6

#: Relative change of the fastest rate per relative change of a parameter from which the parameter counts as a cause.
#: Engineering judgement.
COUNTS = 0.3


def stiffest(plant: Plant, states: np.ndarray, inputs: np.ndarray, modes: np.ndarray) -> str:
    """Sentence on the stiffest mode at the point where a run stopped; empty if none is stiff.

    states: (n,) at that point. inputs: (2,). modes: (contacts,) sliding directions.
    """
    equations = plant.structure.equations
    point = OperatingPoint(
        dict(zip((state.name for state in equations.states), states.tolist(), strict=True)),
        dict(zip(equations.inputs, inputs.tolist(), strict=True)),
        dict(zip(equations.directions, modes.tolist(), strict=True)),
    )
    scales = np.array([state.scale for state in equations.states])
    try:
        fastest, state = _fastest(plant, point, plant.vector, scales)
        signals = evaluator(equations, plant.values)(**point.states, **point.inputs, **point.directions)
        rates = np.abs([signals[rate] for rate in equations.rates]) / scales
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return ""
    # A value set far from the file's is the most likely mistake.
    far = "".join(f"; {parameter.far}" for parameter in plant.parameters.values() if parameter.far)
    driven = int(np.argmax(np.where(np.isfinite(rates), rates, np.inf)))
    if rates[driven] > max(fastest, STIFF):
        off = equations.states[driven]
        drives = " and ".join(f"{word} = {value:g}" for word, value in point.inputs.items())
        return f"{off.name} changes by {rates[driven] * scales[driven]:.2g} {off.unit} per second under {drives}{far}"
    if not fastest > STIFF:
        return ""
    causes = []
    for index, name in enumerate(equations.parameter_names):
        value = plant.vector[index]
        moved = plant.vector.copy()
        moved[index] *= 1.001
        share = (_fastest(plant, point, moved, scales)[0] / fastest - 1.0) * 1e3
        if abs(share) > COUNTS:
            causes.append((abs(share), f"{label(name)} = {value:g}{unit_suffix(plant.parameters[name].unit)}"))
    named = [words for _, words in sorted(causes, reverse=True)[:3]]
    mode = f"the fastest mode is that of {equations.states[state].name}, at {fastest:.2g} 1/s"
    return f"{mode}, set by {', '.join(named)}{far}"


def _fastest(plant: Plant, point: OperatingPoint, parameters: np.ndarray, scales: np.ndarray) -> tuple[float, int]:
    """Largest modulus of the eigenvalues [1/s] at a point, and the state that is largest in its eigenvector."""
    J, _ = jacobian(plant, point, parameters)
    values, vectors = np.linalg.eig(J * scales / scales[:, None])
    first = int(np.argmax(np.abs(values)))
    return float(np.abs(values[first])), int(np.argmax(np.abs(vectors[:, first])))
