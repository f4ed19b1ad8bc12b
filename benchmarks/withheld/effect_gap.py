"""The gap that one effect or parameter error causes alone: it decides what counts as a cause."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from cause import Bench, Effect
from equivalent_ids import equivalents
from gap import gap, largest, of_samples
from plant import simulate
from rig import Rig

THRESHOLD = 0.03
COARSE = 40  # steps a sample where nothing is stiff: 100 us
FINE = 80

#: Parameters that may be wrong in the nominal model, and the id that reports each.
UNCERTAIN = {
    "J_M": "rotor_inertia", "K_T": "torque_constant", "A_FM": "motor_friction", "B_FM": "motor_viscous_friction",
    "C_FM": "motor_friction", "tau_FM": "motor_friction", "K_L": "internal_leakage",
    "V_10": "chamber_volume_variation", "V_20": "chamber_volume_variation", "beta": "bulk_modulus",
    "M": "payload_mass", "A_FR": "rod_friction", "B_FR": "rod_viscous_friction", "C_FR": "rod_friction",
    "tau_FR": "rod_friction", "K_S": "load_spring",
}  # fmt: skip


@dataclass(frozen=True)
class Cause:
    """An effect at a size, and the gap that it causes alone in each signal."""

    effect: Effect
    size: float
    alone: dict[str, float]

    @property
    def counts(self) -> bool:
        return largest(self.alone) >= THRESHOLD


NO_LEAD = np.empty(0)


def simulated_signals(
    bench: Bench, current: np.ndarray, steps: int = FINE, lead: np.ndarray = NO_LEAD
) -> dict[str, np.ndarray]:
    """Signals of a bench driven by a current, through its sensors, without noise.

    lead: the current between rest and the begin of the log; its signals are left out.
    """
    run = simulate(bench.rig, np.concatenate([lead, current]), steps=steps).after(lead.size)
    return of_samples(bench.sensors.clean(run, np.random.default_rng(current.size)))


def drive_command(bench: Bench, logged: np.ndarray) -> np.ndarray:
    """The current command behind a logged current."""
    return (logged - bench.sensors.bias.get("current", 0.0)) / bench.sensors.scale.get("current", 1.0)


@dataclass(frozen=True)
class EffectGap:
    """Gaps between the nominal model with and without one effect, for a logged current and that before the log."""

    nominal_rig: Rig
    current: np.ndarray
    lead: np.ndarray = field(default_factory=lambda: NO_LEAD)

    @cached_property
    def nominal(self) -> dict[str, np.ndarray]:
        return simulated_signals(Bench(self.nominal_rig), self.current, COARSE, self.lead)

    def of_effect(self, effect: Effect, size: float) -> Cause:
        """Gap of the nominal model to itself with the effect at that size, at the same logged current."""
        bench = effect.apply(Bench(self.nominal_rig), size)
        rig = bench.rig
        stiff = rig.bristle > 0.0 or rig.width > 0.0 or rig.x_stop < 1.0 or rig.coupling > 0.0 or rig.T_d > 0.0
        moved = simulated_signals(bench, drive_command(bench, self.current), FINE if stiff else COARSE, self.lead)
        return Cause(effect, size, gap(moved, self.nominal))

    def scaled_to(self, effect: Effect, target: float) -> Cause:
        """The size at which the effect alone causes the target gap, within its range."""
        low, high = float(np.log(effect.smallest)), float(np.log(effect.largest))
        best, miss = self.of_effect(effect, effect.smallest), np.inf
        while low < high and miss > 0.1 and high - low > 0.02:
            middle = 0.5 * (low + high)
            found = self.of_effect(effect, float(np.exp(middle)))
            ratio = max(largest(found.alone) / target, 1e-9)
            if not np.isfinite(ratio):
                high = middle
                continue
            if abs(np.log(ratio)) < miss:
                best, miss = found, abs(float(np.log(ratio)))
            low, high = (low, middle) if ratio > 1.0 else (middle, high)
        return best

    def of_parameter_error(self, name: str, error: float) -> Cause:
        """A relative parameter error as a cause."""
        effect = Effect(
            UNCERTAIN[name],
            f"{name} off",
            lambda b, s: b.with_rig(**{name: getattr(b.rig, name) * (1.0 + s)}),
            0.01,
            0.15,
            lambda b: {name: getattr(b.rig, name)},
            counts_as=equivalents(UNCERTAIN[name], more_drag=error > 0.0),
        )
        return self.of_effect(effect, error)
