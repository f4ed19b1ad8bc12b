"""Rescale a shipped controller or scenario, whose numbers are chosen for the shipped EHSA, to another plant.

Each number keeps its ratio to a characteristic value of the plant: a current limit to the motor's continuous current, a
travel or a position weight to the stroke, a sample time to the plant's sample time. For the shipped EHSA no number
changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import floor, inf, log10, sqrt
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ..core.catalogue import is_shipped, shipped
from ..core.definition import InDrive, drive_quantities
from ..core.files import read_toml
from ..core.unit import factor, parse
from ..design.state_space.kalman import Observer
from ..design.tuning.constraints import Tuning
from ..plant.load import has_setting, load_plant, models_of, with_settings
from ..plant.motion_current import has_motion_current, is_carriage, motion_current
from ..plant.plant import Plant
from .plant_data import BOUNDED, Rating, plant_with_drive, ratings

#: Characteristic value of a plant -> keys of controllers and scenarios that scale with it.
SCALES_WITH = {
    "period": ("sample_time", "solver.deadline", "rest.knocker.width", "rest.knocker.period", "gains.T_f"),
    "rate": ("dither.frequency",),
    "bandwidth": (
        "speed.crossover", "position.crossover", "design.crossover", "tuning.crossover", "adrc.bandwidth",
        "sliding_mode.bandwidth",
    ),
    "samples": ("horizon",),
    "current": (
        "current_limit", "weights.current", "weights.current_rate", "limits.current_rate", "observer.current",
    ),
    "friction": (
        "observer.friction", "sliding_mode.disturbance", "sliding_mode.reaching", "rest.knocker.first",
        "rest.knocker.growth", "rest.knocker.largest", "dither.amplitude",
    ),
    "speed": ("position.speed_limit", "limits.speed", "weights.speed", "observer.leak", "supervision.speed"),
    "rod_speed": ("trajectory.speed", "reference.velocity"),
    "acceleration": ("trajectory.acceleration", "reference.acceleration"),
    "pressure": ("limits.pressure", "weights.pressure", "supervision.pressure_max"),
    "level": ("schedule.nominal",),
    "reach": (
        "limits.stroke", "weights.position", "weights.integral", "reference.positions", "reference.position",
        "reference.amplitude", "supervision.position", "cycle.limit",
    ),
    # The cost compares the penalty of a soft limit with the squared position error.
    "reach2": ("limits.penalty",),
    "force": ("observer.load",),
    "slip": ("rest.band", "rest.release", "cycle.deadband"),
    "gain": ("gains.k_p", "gains.k_i", "gains.k_d"),
    "noise_gain": ("tuning.noise_gain",),
    **{f"noise_{word}": (f"observer.{word}",) for word in ("speed", "pressure", "position")},
    **{word: (f"feedforward.{word}",) for word in ("stiffness", "coulomb", "static")},
    **{word: (f"feedforward.{word}", f"feedforward.adaptation.{word}") for word in ("inertia", "viscous", "load")},
    "stribeck": ("feedforward.stribeck",),
}  # fmt: skip
#: Keys of [observer] that are sensor noise -> channel of the plant.
NOISE_CHANNELS = {"speed": "speed", "pressure": "p1", "position": "position"}
VALUE_OF = {key: name for name, keys in SCALES_WITH.items() for key in keys}
#: Continuous over peak current of a plant that states only the peak torque: the ratio of the EHSA.
CONTINUOUS_RATIO = 0.187
#: Admissible horizon of an MPC, as in `design.kinds.mpc`.
MIN_HORIZON, MAX_HORIZON = 2, 500
#: Keys of what the shipped EHSA has and a carriage has not, besides [limits]: a shaft, a load cell.
EHSA_ALONE = ("position.speed_limit", "feedforward.load")
#: Default values of optional keys that are specific to the shipped EHSA.
DEFAULTS: dict[str, Any] = {
    "observer.speed": f"{Observer().speed:g} rad/s",
    "observer.pressure": f"{1e-3 * Observer().pressure:g} kPa",
    "observer.position": f"{1e6 * Observer().position:g} um",
    "limits.penalty": 10.0,
}


@dataclass(frozen=True)
class Rescaling:
    """Rescaling from the shipped EHSA to another plant.

    ratios: characteristic value -> ratio of the plant's to the EHSA's, if the plant's file determines it.
    ratings: of the plant, see `plant_data.ratings`. drive: SI unit of the plant's drive, how much of it stands for an
    ampere of the EHSA's, and the keys with units of the drive; for a plant with another drive than a current.
    """

    ratios: Mapping[str, float]
    ratings: Mapping[str, Rating]
    drive: tuple[str, float, Mapping[str, InDrive]] | None = None

    def to_drive(self, current: str, limit: str, unit: str, form: type[BaseModel]) -> Rescaling:
        """The same for a plant whose drive has another unit: what is a current keeps its ratio to the largest drive.

        current: limit of the shipped controller. limit: largest drive of the plant. form: of the controller's file.
        Raises InputError for another unit.
        """
        keys = {f"tuning.{key}": quantity for key, quantity in drive_quantities(Tuning).items()}
        per_ampere = parse(limit, unit) / parse(current, "A")
        return replace(self, drive=(unit, per_ampere, keys | drive_quantities(form)))

    def scale(self, key: str, value: Any) -> Any:
        """The value of a key for the plant; the same object if it does not change."""
        if isinstance(value, list):
            return [self.scale(key, item) for item in value]
        of = VALUE_OF.get(_own_key(key), "")
        ratio = self.ratios.get(of, 1.0)
        if isinstance(value, str):
            number, _, unit = value.partition(" ")
            if self.drive is not None and key in self.drive[2]:
                quantity = self.drive[2][key]
                by = ratio if of in self.ratios else self.drive[1]
                return f"{_round(parse(value, quantity.unit) * by)} {quantity.unit_with(self.drive[0])}"
            most = self.ratings.get(BOUNDED.get(key, ""))
            if most is not None and parse(value, most.unit) * ratio > most.value:
                return f"{_round(most.value / factor(unit, most.unit), down=True)} {unit}"
            return value if abs(ratio - 1.0) < 1e-9 else f"{_round(float(number) * ratio)} {unit}"
        if abs(ratio - 1.0) < 1e-9:
            return value
        if isinstance(value, int):
            return min(max(round(value * ratio), MIN_HORIZON), MAX_HORIZON)
        return float(_round(value * ratio))

    def changes(self, content: Mapping[str, Any], known: Iterable[str]) -> dict[str, Any]:
        """Dotted key -> new value of the numbers that change; `known`: keys of the file's schema."""
        original = {key: value for key, value in DEFAULTS.items() if key in known} | dict(_leaves(content))
        scaled = {key: self.scale(key, value) for key, value in original.items() if _own_key(key) in VALUE_OF}
        return {key: value for key, value in scaled.items() if value != original[key]}

    def foreign(self, content: Mapping[str, Any]) -> list[str]:
        """Keys that hold for the shipped EHSA alone: of its load cell, and limits of shaft, pressures and stroke."""
        if self.drive is None:
            return []
        unknown = [key for key in self.unknown(content) if _own_key(key).startswith("limits.")]
        return unknown + [key for key, _ in _leaves(content) if _own_key(key) in EHSA_ALONE]

    def unknown(self, content: Mapping[str, Any]) -> list[str]:
        """Keys that keep their value because the plant's file does not determine the characteristic value."""
        known = self.drive[2] if self.drive is not None else {}
        keys = [key for key, _ in _leaves(content) if _own_key(key) in VALUE_OF and key not in known]
        return [key for key in keys if VALUE_OF[_own_key(key)] not in self.ratios]


def is_for_shipped_ehsa(path: Path) -> bool:
    """Whether this is a shipped controller whose drive is a current, so that its numbers are those of the EHSA."""
    return is_shipped("controllers", path) and plant_with_drive(read_toml(path).get("current_limit")) == "ehsa"


def rescaling_to(plant: str | Path, settings: Mapping[str, str | float] | None = None) -> Rescaling:
    """Rescaling from the shipped EHSA to a plant with some settings. Raises InputError as `load_plant` does."""
    target, ehsa = _models(plant, settings or {}), _models(shipped("plants")["ehsa"], {})
    if not has_motion_current(target[0]):
        # Another machine shares the sample time with the EHSA and nothing else.
        rate = ehsa[0].sample_time / target[0].sample_time
        ratios = {"period": 1.0 / rate, "rate": rate, "bandwidth": min(1.0, rate), "samples": rate}
        if is_carriage(target[1]):
            new, old = motion_current(target[1]), motion_current(ehsa[1])
            ratios |= {name: new[name] / old[name] for name in new if old[name]}
        return Rescaling(ratios, {})
    new, old = characteristic_values(*target), characteristic_values(*ehsa)
    ratios = {name: new[name] / old[name] for name in new if old.get(name)}
    # The sample rate and the hydraulic mode limit the bandwidth.
    ratios["bandwidth"] = min(1.0, ratios["mode"], ratios["rate"])
    # The prediction horizon covers the decay of the hydraulic mode.
    ratios["samples"] = ratios["rate"] / ratios["mode"]
    return Rescaling(ratios, ratings(target[0]))


def characteristic_values(linear: Plant, nonlinear: Plant) -> dict[str, float]:
    """Characteristic values (SI units) by the names of SCALES_WITH, as far as the plant's file determines them.

    Friction comes from the nonlinear parameter set.
    """
    p, motion = linear.values, motion_current(nonlinear)
    found = {name: rating.value for name, rating in ratings(linear).items()}
    if "current_rms" in linear.limits:
        found["current"] = linear.limits["current_rms"].value
    elif "current" in found:
        found["current"] *= CONTINUOUS_RATIO
    found |= {"period": linear.sample_time, "rate": 1.0 / linear.sample_time, "level": p["P_0"], **motion}
    oil_stiffness, mass = 2.0 * p["beta"] / p["V"], p["M"] + p["m_L"]
    # Natural frequency [rad/s] of shaft and rod on the oil column.
    found["mode"] = sqrt(oil_stiffness * (p["D"] ** 2 / p["J_M"] + p["A"] ** 2 / mass))
    # Smallest slip [m]: at breakaway the friction drops from static to Coulomb and the oil column expands.
    slip = (motion["static"] - motion["coulomb"]) / motion["load"] / (oil_stiffness * p["A"] ** 2)
    noise = {f"noise_{word}": linear.sensors[channel].sd for word, channel in NOISE_CHANNELS.items()}
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
    """The linear and the nonlinear set of a plant with the settings that apply; the linear one twice if it is alone."""
    linear = load_plant(plant, model="linear", settings=settings)
    if "nonlinear" not in models_of(plant):
        return linear, linear
    full = load_plant(plant)
    return linear, with_settings(full, {key: value for key, value in settings.items() if has_setting(full, key)})


def _own_key(key: str) -> str:
    """The key within a controller; that of a base has its table before it."""
    return key.removeprefix("base.")


def _leaves(content: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, item in content.items():
        if isinstance(item, Mapping):
            yield from _leaves(item, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", item


def _round(value: float, *, down: bool = False) -> str:
    """A value with three significant digits, without exponent; `down` rounds towards zero."""
    if down and value > 0.0:
        digit = 10.0 ** (floor(log10(value)) - 2)
        value = floor(value / digit * (1.0 + 1e-9)) * digit
    return f"{float(f'{value:.3g}'):.10g}"
