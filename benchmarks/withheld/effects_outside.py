"""Effects of the bench outside the catalogue."""

from __future__ import annotations

from dataclasses import replace

from cause import Conditions, Effect, set_parameter

OUTSIDE = "outside_catalogue"

#: Outside the catalogue: rig field -> range of sizes.
_RIG = {
    "flow_ripple": (0.01, 0.5), "coupling_play": (0.01, 1.5),
    "leak_growth": (1e-12, 8e-11), "one_way_leak": (1e-12, 8e-11), "wander": (10.0, 600.0),
    "drive_step": (0.02, 0.8), "heat_droop": (0.005, 0.3), "memory": (0.03, 0.9),
    "jam": (10.0, 700.0), "brake": (0.03, 0.5),
}  # fmt: skip
_SENSORS = {"mains": (5e3, 4e5), "spikes": (5e3, 4e5), "bow": (2e-5, 3e-3), "dropouts": (0.002, 0.4)}
#: Law -> balance that it changes.
PLACES = {
    **dict.fromkeys(("coupling_play", "heat_droop", "brake"), "torque"),
    **dict.fromkeys(("drive_step", "drive_slope"), "drive"),
    **dict.fromkeys(("wander", "memory", "jam"), "force"),
    **dict.fromkeys(_SENSORS, "sensor"),
    **dict.fromkeys(("flow_ripple", "leak_growth", "one_way_leak"), "flow"),
}
#: All of them.
LAWS = (*_RIG, "drive_slope", *_SENSORS)


def draw_outside(c: Conditions, law: str = "") -> Effect:
    """An effect without an id in the contract."""
    law = law or str(c.rng.choice(LAWS))
    if law in _SENSORS:
        return Effect(
            OUTSIDE, law, lambda b, s: replace(b, sensors=replace(b.sensors, **{law: s})), *_SENSORS[law],
            lambda b: {law: getattr(b.sensors, law)},
        )  # fmt: skip
    if law == "drive_slope":
        return Effect(
            OUTSIDE, law, lambda b, s: b.with_rig(drive_slope=1.0 / s), 1e-3, 0.3, lambda b: {law: b.rig.drive_slope}
        )
    fixed = {}
    if law == "coupling_play":
        fixed = {"coupling": 0.02}
    elif law == "flow_ripple":
        fixed = {"flow_order": float(c.rng.choice([1, 2, 3]))}
    elif law == "memory":
        fixed = {"memory_time": float(c.rng.uniform(0.05, 0.5))}
    elif law == "wander":
        fixed = {"wander_seed": float(c.rng.integers(1_000_000))}
    elif law == "jam":
        fixed = {"jam_time": float(c.rng.uniform(6.0, 14.0))}
    elif law == "brake":
        fixed = {"brake_current": float(c.rng.uniform(0.6, 1.2))}
    return set_parameter(OUTSIDE, law, law, *_RIG[law], **fixed)
