"""A shipped definition's numbers carried over to another plant than the shipped EHSA, which they were chosen for.

What is a property of the plant stays the same share of it: a current limit of the motor's continuous current, a stroke
of the rod's, a weight of the position of the stroke, a sample time of the bench's period. For the shipped EHSA every
number stays as it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import floor, inf, log10, sqrt
from pathlib import Path
from typing import Any

from ..core.catalogue import shipped
from ..core.unit import factor, parse
from ..design.synthesis.kalman import Noise
from ..plant.motion_current import motion_current
from ..plant.plant import Plant, knows, load_plant, models_of, with_settings
from .ratings import BOUNDED, Rating, ratings

#: Size of a plant -> keys of controllers and scenarios that are a share of it.
SHARES = {
    "period": ("sample_time", "solver.deadline", "rest.knocker.width", "rest.knocker.period", "gains.T_f"),
    "rate": ("dither.frequency",),
    "bandwidth": ("speed.crossover", "position.crossover", "design.crossover", "tuning.crossover"),
    "samples": ("horizon",),
    "current": (
        "current_limit", "weights.current", "weights.current_rate", "limits.current_rate", "observer.current",
    ),
    "friction": (
        "observer.friction", "rest.knocker.first", "rest.knocker.growth", "rest.knocker.largest", "dither.amplitude",
    ),
    "speed": ("position.speed_limit", "limits.speed", "weights.speed", "observer.leak", "supervision.speed"),
    "rod_speed": ("trajectory.speed", "reference.velocity"),
    "acceleration": ("trajectory.acceleration", "reference.acceleration"),
    "pressure": ("limits.pressure", "weights.pressure", "supervision.pressure_max"),
    "level": ("schedule.nominal",),
    "reach": (
        "limits.stroke", "weights.position", "weights.integral", "reference.positions", "reference.position",
        "reference.amplitude", "supervision.position",
    ),
    # A soft limit is weighed against being 0.1 m off, squared.
    "reach2": ("limits.penalty",),
    "force": ("observer.load",),
    "slip": ("rest.band", "rest.release"),
    "gain": ("gains.k_p", "gains.k_i", "gains.k_d"),
    "noise_gain": ("tuning.noise_gain",),
    **{f"noise_{word}": (f"observer.{word}",) for word in ("speed", "pressure", "position")},
    **{word: (f"feedforward.{word}",) for word in ("inertia", "viscous", "stiffness", "coulomb", "static", "load")},
    "stribeck": ("feedforward.stribeck",),
}  # fmt: skip
#: Sensors of an [observer], by the plant's channels.
NOISY = {"speed": "speed", "pressure": "p1", "position": "position"}
SIZES = {key: size for size, keys in SHARES.items() for key in keys}
#: Continuous over peak current of a motor whose file states the peak torque alone: as the EHSA's.
CONTINUOUS = 0.187
#: What a definition that leaves these keys out has: numbers of the shipped EHSA too.
LEFT_OUT: dict[str, Any] = {
    "observer.speed": f"{Noise.speed:g} rad/s",
    "observer.pressure": f"{1e-3 * Noise.pressure:g} kPa",
    "observer.position": f"{1e6 * Noise.position:g} um",
    "limits.penalty": 10.0,
}


@dataclass(frozen=True)
class Carrier:
    """From the shipped EHSA to another plant.

    ratios: size -> the plant's over the EHSA's; without those of which the plant's file states nothing.
    allowed: see `ratings`.
    """

    ratios: Mapping[str, float]
    allowed: Mapping[str, Rating]

    def carry(self, key: str, value: Any) -> Any:
        """A key's value for the plant; the same object where it is no other number."""
        if isinstance(value, list):
            return [self.carry(key, item) for item in value]
        ratio = self.ratios.get(SIZES.get(key, ""), 1.0)
        if isinstance(value, str):
            number, _, unit = value.partition(" ")
            most = self.allowed.get(BOUNDED.get(key, ""))
            if most is not None and parse(value, most.unit) * ratio > most.value:
                return f"{_rounded(most.value / factor(unit, most.unit), down=True)} {unit}"
            return value if _same(ratio) else f"{_rounded(float(number) * ratio)} {unit}"
        if _same(ratio):
            return value
        return min(max(round(value * ratio), 2), 500) if isinstance(value, int) else float(_rounded(value * ratio))

    def changes(self, content: Mapping[str, Any], known: Iterable[str]) -> dict[str, Any]:
        """Dotted key -> value of what is another number for the plant; `known` are the keys that the form has."""
        there = {key: value for key, value in LEFT_OUT.items() if key in known} | dict(_leaves(content))
        carried = {key: self.carry(key, value) for key, value in there.items() if key in SIZES}
        return {key: value for key, value in carried.items() if value != there[key]}

    def unknown(self, content: Mapping[str, Any]) -> list[str]:
        """Keys that stay as they are because the plant's file does not state what they are a share of."""
        return [key for key, _ in _leaves(content) if key in SIZES and SIZES[key] not in self.ratios]


def carrier(plant: str | Path, settings: Mapping[str, str | float] | None = None) -> Carrier:
    """From the shipped EHSA to this plant, as it is believed with these settings. Raises InputError as load_plant."""
    here, there = _models(plant, settings or {}), _models(shipped("plants")["ehsa"], {})
    new, old = sizes(*here), sizes(*there)
    ratios = {size: new[size] / old[size] for size in new if old.get(size)}
    # A loop may be as fast as sampling and oil allow, a motion as fast as speed and current do.
    ratios["bandwidth"] = min(1.0, ratios["mode"], ratios["rate"])
    # The horizon lasts until the oil's mode has decayed.
    ratios["samples"] = ratios["rate"] / ratios["mode"]
    return Carrier(ratios, ratings(here[0]))


def sizes(linear: Plant, nonlinear: Plant) -> dict[str, float]:
    """How large everything is that a definition's numbers are a share of, SI units, by the names of SHARES.

    Friction is that of the nonlinear set; of limits that the file does not state nothing is said.
    """
    p, motion = linear.values, motion_current(nonlinear)
    found = {name: rating.value for name, rating in ratings(linear).items()}
    if "current_rms" in linear.limits:
        found["current"] = linear.limits["current_rms"].value
    elif "current" in found:
        found["current"] *= CONTINUOUS
    found |= {"period": linear.sample_time, "rate": 1.0 / linear.sample_time, "level": p["P_0"], **motion}
    oil, mass = 2.0 * p["beta"] / p["V"], p["M"] + p["m_L"]
    # Shaft and rod against the oil between them.
    found["mode"] = sqrt(oil * (p["D"] ** 2 / p["J_M"] + p["A"] ** 2 / mass))
    # What breaking away sets free goes into the oil.
    slip = (motion["static"] - motion["coulomb"]) / motion["load"] / (oil * p["A"] ** 2)
    noise = {f"noise_{word}": linear.sensors[channel].sd for word, channel in NOISY.items()}
    found |= {name: value for name, value in {"slip": slip, "friction": motion["coulomb"], **noise}.items() if value}
    if "current" in found:
        found["acceleration"] = found["current"] / motion["inertia"]
        found["rod_speed"] = min(found.get("rod_speed", inf), found["current"] / max(motion["viscous"], 1e-9))
    products = {
        "force": ("pressure", p["A"]),
        "reach2": ("reach", found.get("reach", 0.0)),
        "gain": ("current", 1.0 / found.get("reach", inf)),
        "noise_gain": ("current", 1.0 / found.get("noise_position", inf)),
    }
    return found | {name: found[of] * by for name, (of, by) in products.items() if of in found and by}


def _models(plant: str | Path, settings: Mapping[str, str | float]) -> tuple[Plant, Plant]:
    """The linear set, and the nonlinear one with those of the settings that it knows; the linear one where it is the
    only one."""
    linear = load_plant(plant, model="linear", settings=settings)
    if "nonlinear" not in models_of(plant):
        return linear, linear
    full = load_plant(plant)
    return linear, with_settings(full, {key: value for key, value in settings.items() if knows(full, key)})


def _leaves(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, item in content.items():
        if isinstance(item, Mapping):
            yield from _leaves(item, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", item


def _same(ratio: float) -> bool:
    return abs(ratio - 1.0) < 1e-9


def _rounded(value: float, *, down: bool = False) -> str:
    """Three significant digits, written out."""
    if down and value > 0.0:
        digit = 10.0 ** (floor(log10(value)) - 2)
        value = floor(value / digit * (1.0 + 1e-9)) * digit
    return f"{float(f'{value:.3g}'):.10g}"
