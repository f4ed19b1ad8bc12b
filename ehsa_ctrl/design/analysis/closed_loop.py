"""A sampled plant with a sampled control law: closed loop, frequency response, step responses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.controller_interface import INPUTS as LAW_INPUTS
from ...core.controller_interface import MEASURED, REFERENCE, Controller
from ...core.errors import InputError
from .contact import loop_model
from .sampled import drive_unit_of, sampled_plant

if TYPE_CHECKING:
    import control

#: Inputs of a closed loop: reference, noise on each reading, force on the rod, additional current.
INPUTS = (*(f"r_{name}" for name in REFERENCE), *(f"n_{name}" for name in MEASURED), "F_D", "extra")
#: Outputs: the plant's readings without noise, and the current of the law.
OUTPUTS = (*MEASURED, "current")


def law_state_space(law: Any, sample_time: float) -> control.StateSpace:
    """A feedback law without limits in state space: discrete, inputs [*REFERENCE, *MEASURED], output current [A].

    Such a law is linear in its inputs and its memory, so that one sample from a unit of each gives a column of the
    matrices. The samples start from the memory after a first one with zero inputs, which sets flags of the law.

    law: a design.controller.Law whose settings contain no finite limit.
    """
    import control

    settings, inputs = law.settings(), np.zeros(len(LAW_INPUTS))

    def sample(inputs: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Memory and current after one sample."""
        after = memory.copy()
        references = len(REFERENCE)
        target = np.append(inputs[:references], 0.0)
        return np.append(after, law.function(target, inputs[references:], after, settings, 0.0, 0.0))

    start = sample(inputs, law.initial_memory())[:-1]
    rest, n = sample(inputs, start), start.size
    columns = [sample(inputs, start + unit) - rest for unit in np.eye(n)]
    columns += [sample(unit, start) - rest for unit in np.eye(inputs.size)]
    matrix = np.column_stack(columns)
    parts = matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]
    return control.ss(*parts, sample_time, inputs=list(LAW_INPUTS), outputs=["current"])


def linear_law(controller: Any) -> control.StateSpace:
    """The controller's linear law without structurally unreachable or unobservable states.

    An integrator with zero gain would otherwise add a pole on the unit circle to every closed loop. Only the pattern of
    nonzero entries counts, so that no tolerance is needed.

    Raises InputError for a controller without a linear law, or with one of the wrong shape or sample time.
    """
    import control

    if not hasattr(controller, "linear"):
        raise InputError(f"controller {controller.name} has no linear law to analyse; expected a method linear()")
    law = control.ss(controller.linear())
    if (law.ninputs, law.noutputs) != (len(REFERENCE) + len(MEASURED), 1):
        raise InputError(
            f"the linear law of {controller.name} has {law.ninputs} inputs and {law.noutputs} outputs; expected "
            f"{len(REFERENCE) + len(MEASURED)}, {', '.join((*REFERENCE, *MEASURED))}, and the current"
        )
    if not np.isclose(law.dt, controller.sample_time, rtol=1e-9) or law.isctime():
        raise InputError(
            f"the linear law of {controller.name} has dt = {law.dt}; expected its sample time, "
            f"{controller.sample_time:g} s"
        )
    edges = law.A != 0.0
    reachable, observable = np.any(law.B != 0.0, axis=1), np.any(law.C != 0.0, axis=0)
    for _ in range(law.nstates):
        reachable, observable = reachable | (edges @ reachable), observable | (edges.T @ observable)
    used = np.flatnonzero(reachable & observable)
    return control.ss(law.A[np.ix_(used, used)], law.B[used], law.C[:, used], law.D, controller.sample_time)


def closed_loop_matrix(a: np.ndarray, b: np.ndarray, c: np.ndarray, law: control.StateSpace) -> np.ndarray:
    """State matrix of the closed loop, from the sampled plant's A, B (current first) and C."""
    current, k_y, d_y = b[:, :1], law.B[:, len(REFERENCE) :], law.D[:, len(REFERENCE) :]
    return np.block([[a + current @ d_y @ c, current @ law.C], [k_y @ c, law.A]])


def closed_loop(plant: control.StateSpace, law: control.StateSpace) -> control.StateSpace:
    """Closed loop of current = law(reference, readings + noise) + extra, with INPUTS and OUTPUTS.

    plant: as `sampled_plant` returns it. law: as `linear_law` returns it.
    """
    import control

    references = len(REFERENCE)
    k_r, k_y = law.B[:, :references], law.B[:, references:]
    d_r, d_y = law.D[:, :references], law.D[:, references:]
    current, force = plant.B[:, :1], plant.B[:, 1:]
    a = closed_loop_matrix(plant.A, plant.B, plant.C, law)
    b = np.block([[current @ d_r, current @ d_y, force, current], [k_r, k_y, np.zeros((law.nstates, 2))]])
    c = np.block([[plant.C, np.zeros((len(MEASURED), law.nstates))], [d_y @ plant.C, law.C]])
    d = np.zeros((len(OUTPUTS), len(INPUTS)))
    d[-1, : law.ninputs] = law.D[0]
    return control.ss(a, b, c, d, plant.dt, inputs=list(INPUTS), outputs=list(OUTPUTS))


def close_loop(
    system: control.StateSpace, controller: Any, delay: float = 0.0
) -> tuple[control.StateSpace, control.StateSpace, control.StateSpace]:
    """Sampled plant, linear law and closed loop of a controller with a continuous model; `delay` [s] of the current.

    Raises InputError as `linear_law` and `sampled_plant` do.
    """
    law = linear_law(controller)
    plant = sampled_plant(loop_model(system, controller), controller.sample_time, delay=delay)
    return plant, law, closed_loop(plant, law)


def spectral_radius(a: np.ndarray) -> float:
    """Largest |eigenvalue| of a (n, n); 0 without states."""
    return float(np.max(np.abs(np.linalg.eigvals(a)), initial=0.0))


def transfer(a: np.ndarray, b: np.ndarray, c: np.ndarray, z: np.ndarray) -> np.ndarray:
    """C (zI - A)^-1 B (m, outputs, inputs) at the points z (m,).

    One batched solve for all points: for small systems about ten times as fast as python-control's loop over them.
    """
    shifted = z[:, None, None] * np.eye(a.shape[0]) - a
    return np.asarray(c @ np.linalg.solve(shifted, np.broadcast_to(b, (z.size, *b.shape))))


def discrete_response(system: control.StateSpace, omega: Any) -> np.ndarray:
    """Frequency response (n, outputs, inputs) of a discrete system at omega (n,) [rad/s]."""
    z = np.exp(1j * np.atleast_1d(np.asarray(omega, dtype=float)) * float(system.dt))
    if system.nstates == 0:
        return np.broadcast_to(system.D.astype(complex), (z.size, *system.D.shape))
    return transfer(system.A, system.B, system.C, z) + system.D


def unit_step(system: control.StateSpace, source: int, outputs: list[int], samples: int) -> np.ndarray:
    """Response (samples, outputs) of a discrete system to a unit step of the input `source`.

    An own recursion, because scipy's dlsim can't do systems without states, such as a proportional law.
    """
    x, found = np.zeros(system.nstates), np.empty((samples, len(outputs)))
    for k in range(samples):
        found[k] = system.C[outputs] @ x + system.D[outputs, source]
        x = system.A @ x + system.B[:, source]
    return found


@dataclass(frozen=True)
class StepResponse:
    """Step responses of the linear loop, without trajectory, limits and friction.

    Attributes
    ----------
    controller: its name. time: (N,) s.
    position [m], current: "reference" -> (N,) after a step of 1 m, "force" -> (N,) after a step of 1 N on the rod.
    drive_unit: SI unit of `current`, the drive: A, for a carriage N.
    """

    controller: str
    time: np.ndarray
    position: dict[str, np.ndarray]
    current: dict[str, np.ndarray]
    drive_unit: str = "A"

    @property
    def overshoot(self) -> float:
        """Overshoot as a fraction of the reference step."""
        return float(max(np.max(self.position["reference"]) - 1.0, 0.0))

    @property
    def settling_time(self) -> float:
        """Time [s] after which the position stays within 2 % of the reference step; inf if it does not."""
        outside = np.flatnonzero(np.abs(self.position["reference"] - 1.0) > 0.02)
        last = -1 if outside.size == 0 else int(outside[-1])
        return float(self.time[last + 1]) if last + 1 < self.time.size else float("inf")


def step_response(system: control.StateSpace, controller: Controller, duration: float = 1.0) -> StepResponse:
    """Step responses over `duration` [s] of a continuous linear model with the controller's linear law.

    Raises InputError for an unstable loop, and as `close_loop` does.
    """
    _, _, closed = close_loop(system, controller)
    if spectral_radius(closed.A) >= 1.0:
        raise InputError(f"the loop with {controller.name} is not stable, so that it has no step response")
    samples = max(round(duration / controller.sample_time), 1) + 1
    rows = [OUTPUTS.index("position"), OUTPUTS.index("current")]
    found = {
        name: unit_step(closed, INPUTS.index(source), rows, samples)
        for name, source in (("reference", "r_position"), ("force", "F_D"))
    }
    return StepResponse(
        controller.name,
        controller.sample_time * np.arange(samples),
        {name: y[:, 0] for name, y in found.items()},
        {name: y[:, 1] for name, y in found.items()},
        drive_unit_of(system),
    )
