"""Scheduled MPC: an MPC that depends on position, pressure level or load through a table.

The law is in _scheduled_mpc_law.py: the plans of the MPCs at the points around are interpolated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from ...core.errors import InputError
from ..analysis.sampled import drive_unit_of
from ..stages.scheduling import Schedule
from ._kind import ControllerKind
from ._scheduled_mpc_law import ScheduledMpc
from .mpc import MpcLoopFile, with_limits
from .scheduled_lqr import design_over_schedule

if TYPE_CHECKING:
    import control


class ScheduledMpcFile(MpcLoopFile):
    """A scheduled MPC's TOML: the keys of every MPC, and a [schedule]."""

    kind: Literal["scheduled_mpc"] = Field(description="type of feedback law")
    schedule: Schedule = Field(description="variables, and points with their changes of the linear model")


def design_scheduled_mpc(name: str, file: ScheduledMpcFile, system: control.StateSpace) -> ScheduledMpc:
    """An MPC at each point, for the linear model at that operating point.

    Raises InputError as `design_over_schedule`, and for limits below what the planned motion needs, with the point.
    """
    regulator = design_over_schedule(name, file, file.schedule, system)
    laws = []
    for point, feedback in zip(file.schedule.points, regulator.laws, strict=True):
        try:
            laws.append(with_limits(feedback, file, drive_unit_of(system)))
        except InputError as error:
            raise InputError(f"[schedule] at {point}: {error}") from None
    return ScheduledMpc(regulator, tuple(laws))


kind = ControllerKind(
    "scheduled_mpc",
    "model predictive control over position, pressure level or load",
    ScheduledMpcFile,
    design_scheduled_mpc,
)
