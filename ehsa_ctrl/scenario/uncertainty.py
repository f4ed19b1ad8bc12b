"""Uncertain parameters of a plant and its load, and random draws of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from ..core.errors import InputError, shown
from ..core.unit import unit_suffix
from ..plant.draws import plausible_range, read_covariance
from ..plant.file import key_of, label, symbol_of
from ..plant.load import read_settings
from ..plant.plant import Plant

#: Normal distributions are truncated at this many standard deviations: engineering judgement, as estimates are rarely
#: normal in their tails.
TRUNCATION = 3.0
#: Attempts to draw within the bounds before the bounds are reported as incompatible with the distribution.
MAX_DRAWS = 10_000


def _validate_spread(value: Any) -> Any:
    """A standard deviation ("10 %", "50 N"), or the range [low, high] of a uniform distribution."""
    quantity = str | int | float
    if isinstance(value, str) or (isinstance(value, int | float) and not isinstance(value, bool) and value == 0):
        return str(value)
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(item, quantity) for item in value):
        return tuple(str(item) for item in value)
    raise ValueError(f"{shown(value)}; expected a standard deviation ('10 %', '50 N') or a range ['0 N/m', '100 kN/m']")


Spread = Annotated[str | tuple[str, str], BeforeValidator(_validate_spread)]


@dataclass(frozen=True)
class UncertainParameter:
    """A random parameter, SI units: normal around `value`, truncated at the bounds, or uniform if sd is None."""

    name: str
    value: float
    lower: float
    upper: float
    sd: float | None = None
    unit: str = ""

    def __str__(self) -> str:
        if self.sd is None:
            return f"{label(self.name)} uniform from {self.lower:g} to {self.upper:g}{unit_suffix(self.unit)}"
        return f"{label(self.name)} = {self.value:g}{unit_suffix(self.unit)}, sd {self.sd:g}"


@dataclass(frozen=True)
class ParameterUncertainty:
    """All random parameters; correlation (k, k) of the normal ones in their order, None if independent."""

    parameters: tuple[UncertainParameter, ...]
    correlation: np.ndarray | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """One draw: symbol -> SI value. Raises InputError if no draw lies within the bounds."""
        normal = [p for p in self.parameters if p.sd is not None]
        values = {p.name: float(rng.uniform(p.lower, p.upper)) for p in self.parameters if p.sd is None}
        root = None if self.correlation is None else np.linalg.cholesky(self.correlation)
        for _ in range(MAX_DRAWS):
            z = rng.standard_normal(len(normal))
            z = z if root is None else root @ z
            found = {p.name: p.value + float(p.sd or 0.0) * float(at) for p, at in zip(normal, z, strict=True)}
            if np.all(np.abs(z) <= TRUNCATION) and all(p.lower <= found[p.name] <= p.upper for p in normal):
                return {name: {**values, **found}[name] for name in self.names}
        raise InputError(
            f"none of {MAX_DRAWS} draws lies within the bounds of {', '.join(p.name for p in normal)}; widen the "
            "bounds or reduce the standard deviations"
        )


def uncertainty_of(
    plant: Plant, spread: Mapping[str, str | tuple[str, str]], identification: Path | None = None
) -> ParameterUncertainty:
    """Uncertainty of a plant's parameters from its file, overridden by a scenario's [spread].

    A parameter with a standard deviation is normal within its bounds; one with bounds only is uniform. Keys of
    `spread` are symbols and load.KEY; "0" fixes a parameter at its value.

    Parameters
    ----------
    identification: path of an identification.json, whose parameters are drawn with its covariance.

    Raises
    ------
    InputError: an unknown key, an invalid value, or an empty range.
    """
    found: dict[str, UncertainParameter] = {}
    for name, p in plant.parameters.items():
        if p.sd is not None and 0.0 < p.sd < np.inf:
            found[name] = UncertainParameter(name, p.value, *plausible_range(plant, name), sd=p.sd, unit=p.unit)
        elif np.isfinite([p.lower, p.upper]).all() and p.lower < p.upper and p.source != "given":
            found[name] = UncertainParameter(name, p.value, p.lower, p.upper, unit=p.unit)
    correlation: dict[tuple[str, str], float] = {}
    if identification is not None:
        estimated, correlation = _estimated_parameters(plant, identification)
        # Estimated parameters first; all others are independent, so the rest of the matrix is the identity.
        found = {**estimated, **{name: u for name, u in found.items() if name not in estimated}}
    for key, given in spread.items():
        name, uncertain = _parse_spread(plant, key, given)
        found.pop(name, None)
        if uncertain is not None:
            found[name] = uncertain
    parameters = tuple(found.values())
    normal = [p.name for p in parameters if p.sd is not None]
    matrix = np.array([[correlation.get((a, b), float(a == b)) for b in normal] for a in normal])
    return ParameterUncertainty(parameters, matrix if correlation else None)


def _parse_spread(plant: Plant, key: str, given: str | tuple[str, str]) -> tuple[str, UncertainParameter | None]:
    """Symbol and distribution of one entry of [spread]; None for a parameter that it fixes."""
    name = symbol_of(key)

    def read(text: str) -> float:
        try:
            return read_settings(plant, {key: text})[name]
        except InputError as error:
            raise InputError(f"[spread] {error}") from None

    if isinstance(given, tuple):
        low, high = (read(text) for text in given)
        kind = next(kind for kind in plant.structure.equations.parameters if kind.name == name)
        if not kind.lower <= low < high <= kind.upper:
            raise InputError(
                f"[spread] {key}: {given[0]} to {given[1]}; expected an increasing range within {kind.lower:g} to "
                f"{kind.upper:g}{unit_suffix(kind.unit)}"
            )
        return name, UncertainParameter(name, plant[name], low, high, unit=kind.unit)
    if given.strip().endswith("%"):
        read("0" if key_of(name) != name else str(plant.parameters[name].value) if name in plant.parameters else "0")
        try:
            sd = abs(plant[name]) * float(given.strip()[:-1]) / 100.0
        except ValueError:
            raise InputError(f"[spread] {key}: {given!r} is not a percentage; write it like '10 %'") from None
    else:
        sd = read(given)
    if not 0.0 <= sd < np.inf:
        raise InputError(f"[spread] {key}: {given!r}; a standard deviation must be at least 0")
    return name, UncertainParameter(
        name, plant[name], *plausible_range(plant, name), sd=sd, unit=plant.parameters[name].unit
    ) if sd > 0 else None


def _estimated_parameters(
    plant: Plant, path: Path
) -> tuple[dict[str, UncertainParameter], dict[tuple[str, str], float]]:
    """Parameters and pairwise correlations of an identification.json."""
    found = read_covariance(path)
    names, covariance = found.names, found.matrix
    unknown = [name for name in names if name not in plant.parameters]
    if unknown or not np.isfinite(covariance).all():
        raise InputError(
            f"{path}: its covariance does not fit the {plant.model} model of {plant.name} ({unknown or list(names)})"
        )
    sd = np.sqrt(np.diag(covariance))
    correlation = {
        (a, b): float(covariance[i, j] / (sd[i] * sd[j])) for i, a in enumerate(names) for j, b in enumerate(names)
    }
    estimated = {
        name: UncertainParameter(
            name, plant[name], *plausible_range(plant, name), float(deviation), plant.parameters[name].unit
        )
        for name, deviation in zip(names, sd, strict=True)
    }
    return estimated, correlation
