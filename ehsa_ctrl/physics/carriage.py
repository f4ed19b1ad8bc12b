"""A carriage on a rail under a given drive force, as in the electro-mechanical positioning system of Janot et al.

F_M = M dv/dt + F_FR(v) + offset. M is the inertia of motor, screw and carriage, referred to the carriage.
"""


def net_force(F_M: float, F_D: float, offset: float) -> float:
    """Force on the carriage without friction [N]; a positive offset acts against the drive."""
    return F_M - offset - F_D


def acceleration(F_net: float, F_FR: float, M: float) -> float:
    """dv/dt [m/s2]."""
    return (F_net - F_FR) / M
