"""Controllers from TOML, designed on a linear model, and from dictionaries and Python objects."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.catalogue import controllers
from ..core.definition import merged, validate
from ..core.errors import InputError, choices, shown
from ..core.files import read_toml
from ..core.pressure_difference import has_both_pressures, level_matters, reduce_to_difference
from .analysis.sampled import drive_unit_of
from .controller import SampledController
from .from_object import law_of, name_of
from .kinds import CONTROLLER_KINDS, ControllerFile, ControllerKind, PositionControllerFile
from .state_space.mpc_own_problem import with_own_problem

if TYPE_CHECKING:
    import control

#: Keys of a definition that become fields of the controller, if its kind has them.
SHARED = ("sample_time", "current_limit", "trajectory", "feedforward", "rest", "dither", "watchdog")


def _shared(file: ControllerFile) -> dict[str, Any]:
    return {key: getattr(file, key) for key in SHARED if key in type(file).model_fields}


def read_controller(
    path: Path, sample_time: float | None = None, drive_unit: str = ""
) -> tuple[ControllerKind, ControllerFile]:
    """Read and validate a controller's TOML; sample_time [s] applies if the file states none.

    drive_unit: as for `read_content`. Raises InputError with file and key.
    """
    return read_content(read_toml(path), str(path), sample_time, drive_unit)


def read_content(
    content: Mapping[str, Any], where: str, sample_time: float | None = None, drive_unit: str = "", *, si: bool = False
) -> tuple[ControllerKind, ControllerFile]:
    """Validate the content of a controller's TOML.

    where: file, for messages. drive_unit: SI unit of the plant's drive, if the controller must be one for this plant.
    si: whether numbers without a unit are in SI units.

    Raises InputError with file and key, and for a controller of another drive.
    """
    content = dict(content)
    if sample_time is not None:
        content.setdefault("sample_time", f"{sample_time:.9g} s")
    word = content.get("kind")
    if not isinstance(word, str) or word not in CONTROLLER_KINDS:
        raise InputError(f"{where}: kind = {shown(word)}; {choices(word, CONTROLLER_KINDS)}")
    kind = CONTROLLER_KINDS[word]
    return kind, validate(content, kind.file, where, context={"si": si, "drive_unit": drive_unit})


def load_controller(
    name: Any,
    system: control.StateSpace | None = None,
    *,
    sample_time: float | None = None,
    method: str = "tustin",
    label: str = "",
    problem: Callable[[Any], Any] | None = None,
    compiled: bool | None = None,
    **keys: Any,
) -> SampledController:
    """A controller from a definition, designed on a linear model, or from a Python object.

    Parameters
    ----------
    name: catalogue name or path; or a dictionary with the keys of a controller's TOML, of which schema and title may be
        left out; or a law of your own:

        - a control.StateSpace or TransferFunction from the position error [m] to the current [A], or a StateSpace with
          inputs named "error" or as in core.controller_interface.INPUTS; continuous ones are discretised by `method`;
        - a function f(t, y, r) -> current [A], or an object with a method step(t, y, r): t [s], the measurements
          y.speed, y.p1, y.p2, y.position, y.force, the reference r.position, r.velocity, r.acceleration, SI units. Each
          run gets its own copy of the object.
    system: linear model with the current as first input and an output x, e.g. `three_state(plant)`; a definition is
        designed on it, a law of your own takes the unit of the drive from it.
    sample_time: s, the plant's, for a definition without one and for a law of your own; 4 ms by default.
    method: "tustin", "zoh", "foh", "euler" or "backward".
    label: the controller's name in tables; by default that of the file, of the system or of the function.
    problem: for an MPC: a function that returns a cost, or (cost, constraints), in cvxpy, in place of [weights] and the
        soft [limits]; its argument is a design.state_space.mpc_terms.MpcTerms with the predicted signals. The hard
        limits of the current apply as well.
    compiled: whether cvxpygen compiles `problem`, once for each problem, which takes half a minute: True requires it,
        False does without; None compiles where cvxpygen is installed, and a failure is a warning.
    keys: keys of the definition, in place of those in the file or dictionary: current_limit="5 A", a table as a
        dictionary. Numbers are in SI units. A law of your own requires current_limit and may have the stages
        trajectory, feedforward, rest and dither.

    Raises InputError for a missing or invalid file or key, for an infeasible design, and for an object that is no
    controller.
    """
    period = {} if sample_time is None else {"sample_time": f"{sample_time:.9g} s"}
    if compiled is not None and problem is None:
        raise InputError("compiled: is for an MPC with a problem of your own; give one, problem=f")
    if problem is not None and not isinstance(name, str | Path | Mapping):
        raise InputError("problem: is for an MPC by name, path or dictionary")
    if isinstance(name, str | Path):
        path = controllers.find(name)
        content, where, label = merged(read_toml(path), keys), str(path), label or path.stem
    elif isinstance(name, Mapping):
        label = label or "own"
        where = f"controller {label}"
        content = merged({"schema": 1, "title": label, **name}, keys)
    else:
        label = label or name_of(name)
        content = {"schema": 1, "title": label, "kind": "own", **period, **keys}
        unit = drive_unit_of(system) if system is not None else ""
        file = validate(
            content, PositionControllerFile, f"controller {label}", context={"si": True, "drive_unit": unit}
        )
        law = law_of(name, label, file, method)
        return SampledController(label, "own", law=law, drive_unit=unit or "A", **_shared(file))
    if system is None:
        raise InputError(f"{where}: is designed on a linear model; give one, load_controller(name, three_state(plant))")
    si = bool(keys) or isinstance(name, Mapping)
    controller = controller_of(content, where, label, system, sample_time, si=si)
    if problem is None:
        return controller
    return replace(controller, law=with_own_problem(controller.law, problem, compiled))


def controller_of(
    content: dict[str, Any],
    where: str,
    name: str,
    system: control.StateSpace,
    sample_time: float | None = None,
    *,
    si: bool = False,
) -> SampledController:
    """The controller of a TOML's content; `where` is its file, for messages. Other arguments as in `load_controller`.

    si: whether numbers without a unit are in SI units.

    Raises InputError as `load_controller` does.
    """
    kind, definition = read_content(content, where, sample_time, drive_unit_of(system), si=si)
    try:
        return build_controller(name, kind, definition, system)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def build_controller(
    name: str, kind: ControllerKind, definition: ControllerFile, system: control.StateSpace
) -> SampledController:
    """Design a controller from its definition on a linear model. Raises InputError as `load_controller` does."""
    note, unit = "", drive_unit_of(system)
    if has_both_pressures(system):
        level = "; the model is that of a constant level" if level_matters(system) else ""
        note = f"designed on dP = P_1 - P_2: the mode of P_1 + P_2 is left out, the current does not reach it{level}"
        system = reduce_to_difference(system)
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            law = kind.design(name, definition, system)
            controller = SampledController(name, kind.name, law=law, note=note, drive_unit=unit, **_shared(definition))
            finite = not np.isnan(controller.settings()).any()
    except InputError:
        raise
    except (ArithmeticError, ValueError, RuntimeWarning, np.linalg.LinAlgError):
        finite = False
    if not finite:
        raise InputError(
            "the design overflows: a number is too large or too small; check the powers of ten of its weights, gains, "
            "limits and times"
        )
    return controller
