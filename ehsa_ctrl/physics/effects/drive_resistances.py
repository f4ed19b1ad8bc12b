"""Resistances of a voltage drive that differ from nominal: of the supply, and of the winding with its bridge.

With a supply resistance the voltage falls with the current that the drive takes. Both are parameters of systems with a
voltage drive, see `plant/systems/pendulum.py`.
"""

from ._effect import Effect

SOURCE = "averaged model of a bridge with pulse width modulation"

effects = (
    Effect(
        name="supply_resistance",
        place="drive",
        summary="resistance of the supply differs from nominal",
        fingerprint="torque error at high duty cycle, proportional to the current",
        symbols={"R_S": 0.0},
        # Engineering judgement: 0.2 ohm at 1 A is a few percent of the supply of a small servo.
        wear_scales={"R_S": 0.2},
        source=SOURCE,
    ),
    Effect(
        name="winding_resistance",
        place="drive",
        summary="resistance of winding and bridge differs from nominal",
        fingerprint="torque error proportional to the voltage, and a back EMF that brakes more or less",
        symbols={"R": 0.0},
        source=SOURCE,
    ),
)
