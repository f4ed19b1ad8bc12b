"""Errors of a sensor: bias, scale, delay and first-order filter; each candidate is one error of one channel."""

from collections.abc import Callable

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, from_sensors
from ._effect import Effect

Candidates = Callable[[Effect, DiagnosisContext], list[CandidateEffect]]


def biases(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor. A position is scored by its slope, so its bias shows only under a load that depends on it."""

    def bias(channel: str, sd: float) -> FreeNumber:
        return FreeNumber(f"bias.{channel}", context.sensors[channel]["bias"], 0.03 * sd, -20.0 * sd, 20.0 * sd)

    found = from_sensors(effect, context, bias)
    return [c for c in found if c.channel not in context.slopes or context.value("K_S") != 0.0]


def scales(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor whose signal a simulation has."""

    def scale(channel: str, sd: float) -> FreeNumber:
        return FreeNumber(f"scale.{channel}", context.sensors[channel]["scale"], 0.02, 0.2, 5.0)

    return from_sensors(effect, context, scale)


def delays(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor, also that of the drive. Up to 25 samples, because slow logs may combine several clocks."""
    dt = context.log.sample_time
    size, longest = max(1e-3, 0.25 * dt), max(0.1, 25.0 * dt)

    def delay(channel: str, sd: float) -> FreeNumber:
        return FreeNumber(f"delay.{channel}", 0.0, size, 0.0, longest)

    return from_sensors(effect, context, delay, 2.0, drive=True)


def filters(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor, also that of the drive."""

    def time_constant(channel: str, sd: float) -> FreeNumber:
        return FreeNumber(f"filter.{channel}", 0.0, 1e-3, 0.0, 0.2)

    return from_sensors(effect, context, time_constant, 2.0, drive=True)


def sensor_error(setting: str, summary: str, fingerprint: str, candidates: Candidates) -> Effect:
    """An effect that is a wrong setting of a sensor."""
    return Effect(
        f"sensor_{setting}", "sensor", summary, fingerprint, sensor=setting, drifts=setting == "bias",
        candidates=candidates, source="definition",
    )  # fmt: skip


effects = (
    sensor_error(
        "bias", "constant error of a sensor", "one channel is off by a constant; balances without it are zero", biases
    ),
    sensor_error("scale", "wrong scale of a sensor", "one channel is off in proportion to itself", scales),
    sensor_error("delay", "late reading of a sensor", "one channel lags all others", delays),
    sensor_error("filter", "first-order filter in a sensor", "one channel lags all others and is smoother", filters),
)
