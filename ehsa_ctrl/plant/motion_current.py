"""Coefficients of the current, or other drive, that a rod motion needs, for feedforward."""

from __future__ import annotations

from ..core.errors import InputError
from .plant import Plant

#: Units of the coefficients, as in a controller's [feedforward]; of a carriage with N for A.
UNITS = {
    "inertia": "A s2/m", "viscous": "A s/m", "stiffness": "A/m", "preload": "A", "coulomb": "A", "static": "A",
    "load": "A/N", "stribeck": "m/s",
}  # fmt: skip


def has_motion_current(plant: Plant) -> bool:
    """Whether a current moves shaft and rod together: the system has pump, piston and load."""
    return {"K_T", "D", "A", "M", "m_L"} <= plant.parameters.keys()


def is_carriage(plant: Plant) -> bool:
    """Whether the plant is a carriage under a given drive force."""
    return plant.structure.system_name == "positioning"


def motion_current(plant: Plant) -> dict[str, float]:
    """Coefficients of I = inertia a + viscous v + stiffness x + preload + sign(v) (coulomb .. static).

    From (9) and (10) with v = (D / A) omega: masses, viscous friction and load are reflected to the shaft and divided
    by K_T; leakage and compressibility are neglected. Units as in UNITS; `stribeck` is the smaller Stribeck speed of
    the two contacts. Of a carriage they are those of its drive force, in N for A.

    Raises InputError for a system other than these two.
    """
    if is_carriage(plant):
        return _motion_force(plant)
    if not has_motion_current(plant):
        raise InputError(f"{plant.name} is a {plant.structure.system_name!r} system; it has no motor current")
    p = plant.values
    travel = p["D"] / p["A"]
    per_force = travel / p["K_T"]
    numbers = {
        "inertia": per_force * (p["M"] + p["m_L"]) + p["J_M"] / travel / p["K_T"],
        "viscous": per_force * p["B_FR"] + p["B_FM"] / travel / p["K_T"],
        "stiffness": per_force * p["K_S"],
        "preload": per_force * (p["F_pre"] + p["F_0"]),
    }
    coulomb = p.get("A_FM", 0.0) / p["K_T"] + per_force * p.get("A_FR", 0.0)
    extra = p.get("C_FM", 0.0) / p["K_T"] + per_force * p.get("C_FR", 0.0)
    speeds = [travel * p["tau_FM"] if "tau_FM" in p else None, p.get("tau_FR")]
    known = [speed for speed in speeds if speed]
    return numbers | {
        "coulomb": coulomb,
        "static": coulomb + extra,
        "load": per_force,
        # Without Stribeck friction: 10 mm/s, the default of a controller's [feedforward].
        "stribeck": min(known) if known else 0.01,
    }


def _motion_force(plant: Plant) -> dict[str, float]:
    """The coefficients of a carriage's drive force, from its balance F_M = M a + Fv v + Fc sign(v) + offset."""
    p = plant.values
    coulomb = p.get("Fc", 0.0)
    return {
        "inertia": p["M"],
        "viscous": p.get("Fv", 0.0),
        "stiffness": 0.0,
        "preload": p["offset"],
        "coulomb": coulomb,
        "static": coulomb + p.get("C_FR", 0.0),
        "load": 1.0,
        "stribeck": p.get("tau_FR", 0.0) or 0.01,
    }
