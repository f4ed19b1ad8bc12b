"""Effects that are a wrong parameter of the plant: no equations of their own, the numbers of (1) to (12) change."""

from collections.abc import Mapping

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, from_symbols, starting_points
from ._effect import Effect


def scaled_current(found: Mapping[str, float], plant: Mapping[str, float], flow: float) -> dict[str, str]:
    """The current is known from its sensor alone."""
    return {"sensor_scale": "a logged current that is scaled acts as another torque constant"}


def laminar_drop(found: Mapping[str, float], plant: Mapping[str, float], flow: float) -> dict[str, str]:
    """More viscous friction of the rod may be a laminar drop in the lines."""
    if found.get("B_FR", 0.0) <= plant["B_FR"]:
        return {}
    return {"line_pressure_drop": "a laminar drop between pump ports and chambers acts as viscous rod friction"}


def force_or_cell_bias(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """A force behind the load cell, or one on the rod itself, which the cell misses as if it had a bias."""
    found = from_symbols(effect, context)
    if found and "force" in context.channels:
        free = (*found[0].free, FreeNumber("bias.force", 0.0, 20.0))
        found.append(CandidateEffect(effect, free, starting_points(free, 0.0)))
    return found


effects = (
    Effect(
        name="torque_constant",
        place="torque",
        summary="torque constant, or gain of the drive, differs from nominal",
        fingerprint="torque error in proportion to the current",
        symbols={"K_T": 0.0},
        equivalent_effects=scaled_current,
        source="paper, (1)",
    ),
    Effect(
        name="rotor_inertia",
        place="torque",
        summary="inertia of motor, pump and coupling differs from nominal",
        fingerprint="torque error in proportion to the shaft's acceleration",
        symbols={"J_M": 0.0},
        source="paper, (1)",
    ),
    Effect(
        name="motor_friction",
        place="torque",
        summary="dry friction of the shaft is missing or differs from nominal",
        fingerprint="torque error ~ sign(omega), and more at standstill",
        symbols={"A_FM": 0.1, "C_FM": 0.02},
        groups=(("A_FM", "C_FM"),),
        also=("tau_FM",),
        from_balances=True,
        source="paper, (8), (9)",
    ),
    Effect(
        name="motor_viscous_friction",
        place="torque",
        summary="viscous friction of the shaft differs from nominal",
        fingerprint="torque error ~ omega",
        symbols={"B_FM": 1e-4},
        source="paper, (9)",
    ),
    Effect(
        name="pump_displacement",
        place="flow",
        summary="pump displacement differs from nominal",
        fingerprint="flow error ~ omega, whatever the pressure; also a torque error ~ dP",
        symbols={"D": 0.0},
        source="paper, (2), (3)",
    ),
    Effect(
        name="internal_leakage",
        place="flow",
        summary="laminar leakage of pump and piston differs from nominal",
        fingerprint="flow error ~ dP",
        symbols={"K_L": 0.0},
        wears={"K_L": 5e-13},
        source="paper, (2)",
    ),
    Effect(
        name="bulk_modulus",
        place="flow",
        summary="bulk modulus of the oil differs from nominal",
        fingerprint="flow errors ~ pressure rates; it differs from V only through the stroke",
        symbols={"beta": 0.0},
        source="paper, (4)",
    ),
    Effect(
        name="rod_friction",
        place="force",
        summary="dry friction of the rod is missing or differs from nominal",
        fingerprint="force error ~ sign(v), and more at breakaway",
        symbols={"A_FR": 100.0, "C_FR": 50.0},
        groups=(("A_FR", "C_FR"),),
        also=("tau_FR",),
        from_balances=True,
        source="paper, (8), (10)",
    ),
    Effect(
        name="rod_viscous_friction",
        place="force",
        summary="viscous friction of the rod differs from nominal",
        fingerprint="force error ~ v",
        symbols={"B_FR": 500.0},
        from_balances=True,
        equivalent_effects=laminar_drop,
        source="paper, (10)",
    ),
    Effect(
        name="payload_mass",
        place="force",
        summary="moving mass at the rod, or behind the load cell, differs from nominal",
        fingerprint="force error ~ rod acceleration; hardly any in the shaft's speed",
        symbols={"M": 0.0, "m_L": 20.0},
        groups=(("M",), ("m_L",)),
        source="paper, (5)",
    ),
    Effect(
        name="constant_force",
        place="force",
        summary="constant force on the rod: gravity, a hanging load",
        fingerprint="constant force error; the rod drifts one way",
        symbols={"F_0": 50.0},
        candidates=force_or_cell_bias,
        from_balances=True,
        source="paper, (5)",
    ),
    Effect(
        name="load_spring",
        place="force",
        summary="spring of the load is missing or differs from nominal",
        fingerprint="force error ~ position",
        symbols={"K_S": 2e3},
        source="paper, (5)",
    ),
    Effect(
        name="spring_hardening",
        place="force",
        summary="spring of the load hardens with k_3 x^3",
        fingerprint="force error ~ cube of the position",
        symbols={"k_3": 2e6},
        source="paper, (5)",
    ),
)
