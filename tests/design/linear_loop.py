"""A law on its own design model, sample by sample: the linear loop without the package's simulator."""

import numpy as np

from ehsa_ctrl import load_controller

#: Controllers of these tests; those of the catalogue may be tuned without touching a test.
LQR = """
schema = 1
kind = "lqr"
title = "LQR"
sample_time = "4 ms"
current_limit = "6 A"
offset_free = "disturbance"
[weights]
position = "0.5 mm"
current = "1 A"
[observer]
current = "0.1 A"
friction = "1 A"
load = "200 N"
leak = "2 rad/s"
"""
LQI = """
schema = 1
kind = "lqr"
title = "LQI"
sample_time = "4 ms"
current_limit = "6 A"
offset_free = "integral"
[weights]
position = "0.5 mm"
current = "1 A"
integral = "0.1 mm s"
[observer]
current = "0.3 A"
"""
MPC = (
    LQR.replace('"lqr"', '"mpc"').replace('"LQR"', '"MPC"')
    + """
[limits]
current_rate = "600 A/s"
speed = "350 rad/s"
pressure = "150 bar"
stroke = "95 mm"
[solver]
name = "daqp"
"""
).replace("[weights]", "horizon = 20\n[weights]")
TEXTS = {"lqr": LQR, "lqi": LQI, "mpc": MPC}


def load(text, system, folder):
    """A controller from the text of its file."""
    file = folder / "mine.toml"
    file.write_text(text)
    return load_controller(str(file), system)


def run(law, reference, *, load=0.0, friction=0.0, start=None, extra=0.0, hold=0.0, spoil=None, plant=None):
    """True position, asked current and memory of every sample.

    reference: (N, 3). load [N], friction [A]: constant, from the start on. extra, hold: (N,) or a number.
    spoil: function (k, measured) that changes what the law reads. plant: another model than the law's.
    """
    model = plant or getattr(law, "feedback", law).model
    n = len(reference)
    extra, hold = np.broadcast_to(extra, n), np.broadcast_to(hold, n)
    force = np.zeros(model.E.shape[1])
    for name, value in (("friction", friction), ("load", load)):
        if value:
            k = model.disturbances.index(name)
            force[k] = value / model.disturbance_scale[k]
    x = np.zeros(len(model.A)) if start is None else np.array(start) / model.scale
    memory, settings = law.initial_memory(), law.settings()
    position, current, memories = np.empty(n), np.empty(n), []
    for k in range(n):
        speed, dP, position[k] = model.C @ x
        measured = np.array([speed, 20e5 + dP / 2, 20e5 - dP / 2, position[k], 0.0])
        if spoil:
            spoil(k, measured)
        current[k] = law.function(reference[k], measured, memory, settings, extra[k], hold[k])
        memories.append(memory.copy())
        x = model.A @ x + model.B * current[k] + model.E @ force
    return position, current, np.array(memories)


def still(samples, position=0.0):
    """A reference that rests."""
    return np.column_stack([np.full(samples, position), np.zeros((samples, 2))])


def parabola(samples, T, acceleration):
    """A reference of constant acceleration from rest."""
    t = T * np.arange(samples)
    return np.column_stack([0.5 * acceleration * t**2, acceleration * t, np.full(samples, acceleration)])
