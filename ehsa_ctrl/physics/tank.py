"""The safety circuit's connection between each chamber and the tank (section 2 of the paper), closed by default.

Valves and external leakage are effects that change these flows; they count positive into the chamber.
"""


def closed() -> float:
    """No oil is exchanged with the tank: Q_T = 0 m3/s, as in (12)."""
    return 0.0
