"""Errors of a sensor, each with the channel that it concerns: bias, scale, delay and first-order filter."""

from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber, from_sensors
from ._effect import Effect


def biases(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor; a bias of the position shows only under a load that depends on the position."""

    def bias(channel: str, sd: float) -> FreeNumber:
        return FreeNumber(f"bias.{channel}", context.sensors[channel]["bias"], 0.03 * sd, -20.0 * sd, 20.0 * sd)

    found = from_sensors(effect, context, bias)
    return [c for c in found if c.channel != "position" or context.value("K_S") != 0.0]


def scales(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor that a simulation has too."""

    def scale(channel: str, sd: float) -> FreeNumber:
        return FreeNumber(f"scale.{channel}", context.sensors[channel]["scale"], 0.02, 0.2, 5.0)

    return from_sensors(effect, context, scale)


def delays(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor, the drive's too. Slow logs may combine clocks of their own: up to 25 samples."""
    dt = context.log.sample_time
    size, longest = max(1e-3, 0.25 * dt), max(0.1, 25.0 * dt)
    return from_sensors(
        effect, context, lambda channel, _: FreeNumber(f"delay.{channel}", 0.0, size, 0.0, longest), 2.0, drive=True
    )


def filters(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """Every sensor, the drive's too."""
    return from_sensors(
        effect, context, lambda channel, _: FreeNumber(f"filter.{channel}", 0.0, 1e-3, 0.0, 0.2), 2.0, drive=True
    )


effects = (
    Effect(
        name="sensor_bias",
        place="sensor",
        summary="constant error of a sensor",
        fingerprint="one channel is off by a constant, the balances without it close",
        sensor="bias",
        candidates=biases,
        source="definition",
    ),
    Effect(
        name="sensor_scale",
        place="sensor",
        summary="wrong scale of a sensor",
        fingerprint="one channel is off in proportion to itself",
        sensor="scale",
        candidates=scales,
        source="definition",
    ),
    Effect(
        name="sensor_delay",
        place="sensor",
        summary="late reading of a sensor",
        fingerprint="one channel is late against all others",
        sensor="delay",
        candidates=delays,
        source="definition",
    ),
    Effect(
        name="sensor_filter",
        place="sensor",
        summary="first-order filter in a sensor",
        fingerprint="one channel is late and smooth against all others",
        sensor="filter",
        candidates=filters,
        source="definition",
    ),
)
