"""Controllers from Python objects: a linear system of python-control, a function, an object with a method `step`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.controller_interface import INPUTS
from ..core.errors import InputError, choices, shown
from .controller import Law
from .kinds import ControllerFile
from .python_law import PythonLaw
from .state_space.linear_law import LinearLaw, anti_windup_gain

if TYPE_CHECKING:
    import control

#: Method of discretisation -> its name in scipy.signal.cont2discrete.
METHODS = {"tustin": "bilinear", "zoh": "zoh", "foh": "foh", "euler": "euler", "backward": "backward_diff"}
#: Input of a linear law beside INPUTS: reference minus position.
ERROR = "error"
#: Names that python-control gives to unnamed systems.
UNNAMED = "sys["


def is_linear_system(given: Any) -> bool:
    """Whether this is a StateSpace or TransferFunction of python-control; imports nothing."""
    return any(each.__name__ in ("StateSpace", "TransferFunction") for each in type(given).__mro__)


def is_python_law(given: Any) -> bool:
    """Whether this is a function, or an object with a method `step`, but no class."""
    return not isinstance(given, type) and (callable(getattr(given, "step", None)) or callable(given))


def name_of(given: Any) -> str:
    """Name of an object for tables: its own, else that of its type."""
    name = getattr(given, "name", None) or getattr(given, "__name__", None)
    if not isinstance(name, str) or name.startswith(UNNAMED) or name == "<lambda>":
        return "function" if callable(given) and name == "<lambda>" else type(given).__name__
    return name


def law_of(given: Any, name: str, file: ControllerFile, method: str) -> Law:
    """The feedback law of an object, with the sample time and limit of `file`.

    Raises InputError for an object that is no controller, in one sentence.
    """
    if is_linear_system(given):
        return linear_law_of(given, name, file, method)
    if is_python_law(given):
        return PythonLaw(given, name, file.sample_time, file.current_limit)
    if isinstance(given, type):
        raise InputError(f"controller {given.__name__} is a class; give an object of it, {given.__name__}(...)")
    raise InputError(
        f"controller is {shown(given)}; expected a name, a path, a dictionary, a control.StateSpace or "
        "TransferFunction, a function f(t, y, r), or an object with a method step(t, y, r)"
    )


def linear_law_of(given: Any, name: str, file: ControllerFile, method: str) -> LinearLaw:
    """A linear system as feedback law; a continuous one is discretised by `method`.

    given: one input, the position error [m], or inputs named as in core.controller_interface.INPUTS or "error"; one
        output, the current [A].

    Raises InputError for another number of inputs or outputs, an improper transfer function, numbers that are not
    finite, an unknown method, and a discrete system of another sample time.
    """
    from scipy.signal import cont2discrete

    what = f"controller {name}"
    if method not in METHODS:
        raise InputError(f"method = {shown(method)}; {choices(method, METHODS)}")
    system = _state_space(given, what)
    names = list(system.input_labels) if system.ninputs > 1 else [ERROR]
    unknown = [each for each in names if each not in (*INPUTS, ERROR)]
    if system.noutputs != 1 or unknown:
        raise InputError(
            f"{what} has {system.ninputs} input{'s' if system.ninputs > 1 else ''} and {system.noutputs} "
            f"output{'s' if system.noutputs > 1 else ''}; expected one output, the current, and one input, the "
            f"position error, or inputs named from {ERROR}, {', '.join(INPUTS)}"
        )
    matrices = tuple(np.asarray(each, dtype=float) for each in (system.A, system.B, system.C, system.D))
    if not all(np.isfinite(each).all() for each in matrices):
        raise InputError(f"{what} has coefficients that are not finite; expected numbers")
    period, order = file.sample_time, system.nstates
    if order == 0:
        words = "static"
    elif system.isctime():
        words = f"{method} at {period:g} s"
        matrices = cont2discrete(matrices, period, METHODS[method])[:4]
    elif system.dt is True or not np.isclose(system.dt, period, rtol=1e-9):
        raise InputError(
            f"{what} has dt = {system.dt}; expected the sample time of the loop, {period:g} s: design it for that, or "
            "give another sample_time"
        )
    else:
        words = f"discrete, {period:g} s"
    a, given_b, c, given_d = matrices
    b, d = np.zeros((order, len(INPUTS))), np.zeros((1, len(INPUTS)))
    position = INPUTS.index("position")
    for column, label in enumerate(names):
        error = {INPUTS.index("reference_position"): 1.0, position: -1.0}
        for place, sign in (error if label == ERROR else {INPUTS.index(label): 1.0}).items():
            b[:, place] += sign * given_b[:, column]
            d[:, place] += sign * given_d[:, column]
    if not np.isfinite(np.concatenate([a.ravel(), b.ravel(), d.ravel()])).all():
        raise InputError(f"{what}: {method} gives no finite discrete law at {period:g} s; choose another method")
    try:
        gain = anti_windup_gain(a, b, c, d)
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
    text = f"linear law from {', '.join(names)}, order {order}, {words}"
    return LinearLaw(a, b, c, d, gain, file.current_limit, period, text)


def _state_space(given: Any, what: str) -> control.StateSpace:
    """The system in state space. Raises InputError for a transfer function with several inputs, or an improper one."""
    import control

    if isinstance(given, control.StateSpace):
        return given
    if (given.ninputs, given.noutputs) != (1, 1):
        raise InputError(
            f"{what} is a transfer function with {given.ninputs} inputs and {given.noutputs} outputs; expected one of "
            "each, from the position error [m] to the current [A]; for several measurements give a StateSpace whose "
            "inputs are named"
        )
    numerator, denominator = (np.trim_zeros(np.atleast_1d(each[0][0]), "f") for each in (given.num, given.den))
    if not (np.isfinite(numerator).all() and np.isfinite(denominator).all()):
        raise InputError(f"{what} has coefficients that are not finite; expected numbers")
    if numerator.size > denominator.size:
        raise InputError(
            f"{what} is improper: its numerator has degree {numerator.size - 1}, its denominator "
            f"{denominator.size - 1}; add a filter with a pole above the crossover"
        )
    return control.ss(given)
