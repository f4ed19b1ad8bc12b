"""The watchdog of a link: what acts when the other side is silent. Definitions of plants and controllers have one."""

from __future__ import annotations

from pydantic import Field

from .definition import Definition, Drive, Second


class Watchdog(Definition):
    """[watchdog]: safe output of `serve` when the other side of the link is silent."""

    timeout: Second = Field(
        default=0.04,
        gt=0,
        description="time without a valid packet after which the safe output acts, until the end of the run",
    )
    safe_current: Drive = Field(
        default=0.0,
        description="safe output: the current, or the plant's other drive in its unit (N, V); zero lets friction lock "
        "the actuator",
    )
