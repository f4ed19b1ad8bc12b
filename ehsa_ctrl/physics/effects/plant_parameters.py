"""Effects that are a wrong parameter of the plant: they have no equation, but change the parameters of (1) to (12)."""

from collections.abc import Mapping
from typing import Any

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, from_symbols, starting_points
from ._effect import Effect
from .maxwell_slip import sliders


def scaled_current(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """The current is known only from its sensor."""
    return {"sensor_scale": "a scale error of the logged current acts as another torque constant"}


def laminar_drop(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """Additional viscous friction of the rod may be a laminar drop in the lines."""
    # A rod with friction under another name has no lines.
    if found.get("B_FR", 0.0) <= plant.get("B_FR", 0.0):
        return {}
    return {"line_pressure_drop": "a laminar drop between pump ports and chambers acts as viscous rod friction"}


def offset_is_level(found: Mapping[str, float], plant: Mapping[str, float], speed: float) -> dict[str, str]:
    """Where there is dry friction, its level may differ by direction instead."""
    return {
        "asymmetric_friction": "while the rod slides, a constant force is a friction level that differs by direction"
    }


def force_or_cell_bias(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A force behind the load cell; or one on the rod itself, which the cell misses, as with a bias of the cell."""
    found = from_symbols(effect, context)
    if found and "force" in context.channels:
        free = (*found[0].free, FreeNumber("bias.force", 0.0, 20.0))
        found.append(CandidateEffect(effect, free, starting_points(free, 0.0)))
    return found


def dry_or_elastic(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Another level of dry friction; or of one that sets in gradually, where elastic sliders slip one after another."""
    found, slip = from_symbols(effect, context), sliders(context)
    if found and slip is not None and context.value("A_FR") + context.value("C_FR") > 0.0:
        free = (*found[0].free, slip)
        levels = found[0].starts[0]
        found.append(CandidateEffect(effect, free, ((*levels, slip.nominal + slip.scale),)))
    return found


def wrong(name: str, place: str, summary: str, fingerprint: str, source: str, **more: Any) -> Effect:
    """An effect that is a wrong parameter of the plant."""
    return Effect(name, place, summary, fingerprint, source=f"paper, {source}", **more)


effects = (
    wrong(
        "torque_constant", "torque", "torque constant, or gain of the drive, differs from nominal",
        "torque error proportional to the current", "(1)", symbols={"K_T": 0.0}, equivalent_effects=scaled_current,
    ),
    wrong(
        "rotor_inertia", "torque", "inertia of motor, pump and coupling differs from nominal",
        "torque error proportional to the acceleration of the shaft", "(1)", symbols={"J_M": 0.0},
    ),
    wrong(
        "motor_friction", "torque", "dry friction of the shaft is missing or differs from nominal",
        "torque error ~ sign(omega), and more at standstill", "(8), (9)", symbols={"A_FM": 0.1, "C_FM": 0.02},
        groups=(("A_FM", "C_FM"),), related_symbols=("tau_FM",), from_balances=True,
    ),
    wrong(
        "motor_viscous_friction", "torque", "viscous friction of the shaft differs from nominal",
        "torque error ~ omega", "(9)", symbols={"B_FM": 1e-4},
    ),
    wrong(
        "pump_displacement", "flow", "pump displacement differs from nominal",
        "flow error ~ omega, independent of pressure; also a torque error ~ dP", "(2), (3)", symbols={"D": 0.0},
    ),
    wrong(
        "internal_leakage", "flow", "laminar leakage of pump and piston differs from nominal",
        "flow error ~ dP", "(2)", symbols={"K_L": 0.0}, wear_scales={"K_L": 5e-13},
    ),
    wrong(
        "bulk_modulus", "flow", "bulk modulus of the oil differs from nominal",
        "flow errors ~ pressure rates; distinct from V only through the stroke", "(4)", symbols={"beta": 0.0},
    ),
    wrong(
        "rod_friction", "force", "dry friction of the rod is missing or differs from nominal",
        "force error ~ sign(v), and more at breakaway", "(8), (10)", symbols={"A_FR": 100.0, "C_FR": 50.0},
        groups=(("A_FR", "C_FR"),), related_symbols=("tau_FR",), candidates=dry_or_elastic, from_balances=True,
    ),
    wrong(
        "rod_viscous_friction", "force", "viscous friction of the rod differs from nominal",
        "force error ~ v", "(10)", symbols={"B_FR": 500.0}, from_balances=True, equivalent_effects=laminar_drop,
    ),
    wrong(
        "payload_mass", "force", "moving mass at the rod, or behind the load cell, differs from nominal",
        "force error ~ rod acceleration; little effect on the shaft speed", "(5)", symbols={"M": 0.0, "m_L": 20.0},
        groups=(("M",), ("m_L",)),
    ),
    wrong(
        "constant_force", "force", "constant force on the rod: gravity, a hanging load",
        "constant force error; the rod drifts one way", "(5)", symbols={"F_0": 50.0}, candidates=force_or_cell_bias,
        from_balances=True, equivalent_effects=offset_is_level,
    ),
    wrong(
        "load_spring", "force", "spring of the load is missing or differs from nominal",
        "force error ~ position", "(5)", symbols={"K_S": 2e3},
    ),
    wrong(
        "spring_hardening", "force", "spring of the load hardens with k_3 x^3",
        "force error ~ cube of the position", "(5)", symbols={"k_3": 2e6},
    ),
)  # fmt: skip
