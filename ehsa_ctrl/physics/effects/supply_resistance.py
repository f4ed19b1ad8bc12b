"""A supply that gives way: its voltage falls with the current that the drive takes from it.

It is a parameter of systems with a supply, see `plant/systems/pendulum.py`.
"""

from ._effect import Effect

effect = Effect(
    name="supply_resistance",
    place="drive",
    summary="resistance of the supply differs from nominal",
    fingerprint="torque error at high duty cycle, proportional to the current",
    symbols={"R_S": 0.0},
    # Engineering judgement: 0.2 ohm at 1 A is a few percent of the supply of a small servo.
    wear_scales={"R_S": 0.2},
    source="averaged model of a bridge with pulse width modulation",
)
