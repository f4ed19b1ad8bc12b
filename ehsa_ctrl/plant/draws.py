"""Random plants, drawn from the uncertainty of the parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError, choices
from ..core.files import read_json
from ..core.unit import unit_suffix
from .conditions import Condition, operating_points
from .file import label
from .plant import Plant

if TYPE_CHECKING:
    import control

#: Attempts to draw a value within the bounds. Engineering judgement: if all fail, value and bounds contradict.
TRIES = 10_000
#: Differences from the nominal plant that a label names.
DIFFERENCES = 4


@dataclass(frozen=True)
class Covariance:
    """Covariance (k, k) of the parameters `names` in SI units, from an identification."""

    names: tuple[str, ...]
    matrix: np.ndarray


def read_covariance(path: str | Path) -> Covariance:
    """Read the covariance of an identification.json; null (an undetermined parameter) is an infinite variance.

    Raises InputError for a missing file, and for one without a covariance.
    """
    path = Path(path)
    content = read_json(path)
    try:
        found = content["correlation"]
        names, rows = tuple(found["names"]), found["covariance"]
        matrix = np.array([[math.inf if entry is None else float(entry) for entry in row] for row in rows])
    except (ValueError, LookupError, TypeError, ArithmeticError):
        raise InputError(f"{path}: has no covariance; expected an identification.json that `identify` wrote") from None
    if matrix.shape != (len(names), len(names)) or not names:
        raise InputError(f"{path}: the covariance has the shape {matrix.shape}; expected one row for each name")
    return Covariance(names, matrix)


def draw(
    plant: Plant,
    n: int,
    *,
    seed: int = 0,
    within: float = 2.0,
    covariance: Covariance | None = None,
    names: Iterable[str] | None = None,
    unknown: float = 0.0,
    assumed: bool = False,
) -> list[Plant]:
    """Plants (n,) with parameters drawn from their uncertainty, each within its bounds.

    Parameters of `covariance` are drawn jointly, with their correlation; one with its own sd is drawn from a normal
    distribution around its value. The others are constant, unless `unknown` or `assumed` includes them.

    Parameters
    ----------
    n: number of plants. seed: of the random generator.
    within: normal draws beyond this many standard deviations are repeated. For a covariance, the limit applies to the
        Mahalanobis distance and is chosen to keep the same share of draws.
    covariance: of parameters of this plant; others are ignored.
    names: parameters to draw; all by default.
    unknown: relative standard deviation of identified parameters whose file states none.
    assumed: also draw assumed parameters uniformly between their bounds. Identified parameters depend on them (the
        inertia on the torque constant), so such draws deviate more than any plant that fits the logs.

    Raises InputError for an unknown name, for bounds that exclude all draws, and if no parameter has an uncertainty.
    """
    if n < 1 or within <= 0 or unknown < 0:
        raise InputError(
            f"draw(n={n}, within={within:g}, unknown={unknown:g}): expected n >= 1, within > 0, unknown >= 0"
        )
    chosen = list(plant.parameters) if names is None else list(names)
    for name in chosen:
        if name not in plant.parameters:
            raise InputError(
                f"{plant.name} ({plant.model}) has no parameter {name!r}; {choices(name, plant.parameters)}"
            )
    joint: list[str] = []
    factor = np.zeros((0, 0))
    if covariance is not None:
        finite = [k for k, name in enumerate(covariance.names) if math.isfinite(covariance.matrix[k, k])]
        kept = [k for k in finite if covariance.names[k] in chosen]
        joint = [covariance.names[k] for k in kept]
        if not joint:
            raise InputError(
                f"the covariance is of {', '.join(covariance.names)}, but {plant.name} has none of them; give that of "
                "this plant"
            )
        factor = _root(covariance.matrix[np.ix_(kept, kept)])
    rng = np.random.default_rng(seed)
    radius = _radius(within, len(joint))
    single = {
        name: spread for name in chosen if name not in joint and (spread := _spread(plant, name, unknown, assumed))
    }
    if not joint and not single:
        raise InputError(
            f"no parameter of {plant.name} ({plant.model}) has an uncertainty: give sd in its TOML, the covariance of "
            "an identification, or a relative deviation for identified parameters"
        )
    return [plant.set(**_values(plant, rng, joint, factor, single, within, radius)) for _ in range(n)]


def _spread(plant: Plant, name: str, unknown: float, assumed: bool) -> float:
    """Standard deviation of a parameter; inf for a uniform distribution between its bounds, 0 for a constant."""
    parameter = plant.parameters[name]
    if parameter.sd is not None and math.isfinite(parameter.sd):
        return parameter.sd
    if parameter.source == "identified":
        return unknown * abs(parameter.value)
    bounded = math.isfinite(parameter.lower) and math.isfinite(parameter.upper)
    return math.inf if assumed and bounded else 0.0


def _root(matrix: np.ndarray) -> np.ndarray:
    """R with R R' = matrix, from the eigenvalues of the correlation: the covariance itself spans many decades."""
    sd = np.sqrt(np.diag(matrix))
    size = np.where(sd > 0.0, sd, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    return np.asarray(size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _radius(within: float, k: int) -> float:
    """Radius that contains the same share of k normal variables as `within` does of one."""
    from scipy.stats import chi2

    return float(np.sqrt(chi2.ppf(chi2.cdf(within**2, 1), k))) if k else 0.0


def _values(
    plant: Plant,
    rng: np.random.Generator,
    joint: Sequence[str],
    factor: np.ndarray,
    single: Mapping[str, float],
    within: float,
    radius: float,
) -> dict[str, float]:
    """Symbol -> value of one draw. Raises InputError if no draw lies inside the bounds."""
    values: dict[str, float] = {}
    if joint:
        centre = np.array([plant[name] for name in joint])
        for _ in range(TRIES):
            together = rng.standard_normal(len(joint))
            drawn = dict(zip(joint, map(float, centre + factor @ together), strict=True))
            if together @ together <= radius**2 and all(_inside(plant, *one) for one in drawn.items()):
                values.update(drawn)
                break
        else:
            raise InputError(
                f"no draw of {', '.join(joint)} lies inside their bounds; widen the bounds of {plant.name}"
            )
    for name, sd in single.items():
        parameter = plant.parameters[name]
        if math.isinf(sd):
            values[name] = float(rng.uniform(parameter.lower, parameter.upper))
            continue
        for _ in range(TRIES):
            normal = float(rng.standard_normal())
            if abs(normal) <= within and _inside(plant, name, parameter.value + sd * normal):
                values[name] = parameter.value + sd * normal
                break
        else:
            raise InputError(f"no draw of {name} lies inside its bounds; widen the bounds of {plant.name}")
    return values


def plausible_range(plant: Plant, name: str) -> tuple[float, float]:
    """Smallest and largest value of a parameter that is both plausible and physically possible."""
    parameter = plant.parameters[name]
    (kind,) = [kind for kind in plant.structure.equations.parameters if kind.name == name]
    lower = max(parameter.lower, kind.lower)
    if kind.lower_open and lower == kind.lower:
        lower = float(np.nextafter(lower, np.inf))
    return lower, min(parameter.upper, kind.upper)


def _inside(plant: Plant, name: str, value: float) -> bool:
    lower, upper = plausible_range(plant, name)
    return bool(lower <= value <= upper)


def difference(plant: Plant, nominal: Plant) -> str:
    """The largest relative differences from the nominal plant, largest first: "M +12 %, J_M -3 %"."""
    parts = []
    for name, parameter in plant.parameters.items():
        before = nominal[name]
        if parameter.value == before:
            continue
        relative = (parameter.value - before) / abs(before) if before else math.inf
        words = f"{100 * relative:+.2g} %" if before else f"{parameter.value:g}{unit_suffix(parameter.unit)}"
        parts.append((abs(relative), f"{label(name)} {words}"))
    ordered = [words for _, words in sorted(parts, key=lambda part: -part[0])]
    return ", ".join(ordered[:DIFFERENCES] + ["..."] * (len(ordered) > DIFFERENCES)) or "nominal"


def drawn_models(
    plant: Plant, plants: Iterable[Plant], conditions: Sequence[Condition] = (Condition(),)
) -> dict[str, control.StateSpace]:
    """Label -> linear model: of a plant at each condition, and of each drawn plant at the conditions in turn.

    Labels give the difference: "K_S (load.stiffness) = 50 kN/m", "draw 7 at beta = 0.5 GPa: M +12 %, ...".
    """
    if not conditions:
        raise InputError("conditions is empty; expected at least one, from conditions()")
    models = operating_points(plant, conditions)
    for k, drawn in enumerate(plants):
        at = conditions[k % len(conditions)]
        place = f" at {at}" if str(at) else ""
        models[f"draw {k + 1}{place}: {difference(drawn, plant)}"] = at.model(drawn)
    return models
