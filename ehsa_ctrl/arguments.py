"""Convert and check the arguments of public functions: load names and paths, raise InputError for anything unsuitable.

An argument name has the same meaning in all public functions, so one table (ARGUMENTS) defines what each accepts; the
few exceptions are in OVERRIDES. Only calls through the names in `ehsa_ctrl` convert; inside the package, functions get
the types of their annotations.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar

import numpy as np

from .core.controller_interface import Controller
from .core.errors import InputError, shown

P = ParamSpec("P")
R = TypeVar("R")
Given = Mapping[str, Any]

#: Largest magnitude of a number, in SI units, as in `core.definition`.
LARGEST = 1e30
#: Functions for which a plant given by name is its linear set.
LINEAR = ("four_state", "three_state")
#: Arguments that are converted first, because others are loaded with them.
FIRST = ("plant", "system")
#: Current limit [A] of a law that is analysed without a plant.
NO_LIMIT = 1e9
LOADED = ("Plant", "Log", "SampledController", "Scenario")


class MisfitError(Exception):
    """An argument does not accept a value. The text, if any, replaces the value in the message."""


@dataclass(frozen=True, eq=False)
class ArgumentKind:
    """A kind of argument.

    expected: what it accepts, for messages. convert: (value, other arguments) -> converted value; raises MisfitError.
    """

    expected: str
    convert: Callable[[Any, Given], Any]

    def __or__(self, other: ArgumentKind) -> ArgumentKind:
        """A kind that accepts what either of the two accepts."""

        def convert(value: Any, given: Given) -> Any:
            try:
                return self.convert(value, given)
            except MisfitError as misfit:
                try:
                    return other.convert(value, given)
                except MisfitError:
                    raise misfit from None

        return ArgumentKind(f"{self.expected}, or {other.expected}", convert)


def where(expected: str, fits: Callable[[Any], bool]) -> ArgumentKind:
    """A kind that accepts the values with `fits`, unchanged."""
    return ArgumentKind(expected, lambda value, given: _checked(value, fits(value)))


def _checked(value: Any, fits: bool) -> Any:
    if not fits:
        raise MisfitError
    return value


def instance(name: str, expected: str = "") -> ArgumentKind:
    """Instances of a class, recognised by its name, so that nothing is imported."""
    return where(expected or f"a {name}", lambda value: _is(value, name))


def one_of(*words: str) -> ArgumentKind:
    return where(" or ".join(map(repr, words)), lambda value: isinstance(value, str) and value in words)


def dictionary(item: ArgumentKind) -> ArgumentKind:
    """Dictionaries with strings as keys and values of one kind."""

    def convert(value: Any, given: Given) -> Any:
        if not isinstance(value, Mapping):
            raise MisfitError
        found = {}
        for key, content in value.items():
            try:
                found[key] = item.convert(content if isinstance(key, str) else object(), given)
            except MisfitError:
                raise MisfitError(f"a dictionary with {shown(content)} under {shown(key)}") from None
        return found

    return ArgumentKind(f"a dictionary: each name with {item.expected}", convert)


def several(item: ArgumentKind) -> ArgumentKind:
    """Lists, tuples and other iterables of one kind; a single name or path is a list of one."""

    def convert(value: Any, given: Given) -> Any:
        if isinstance(value, str | os.PathLike):
            value = [value]
        if isinstance(value, Mapping) or not isinstance(value, Iterable):
            raise MisfitError
        return [item.convert(each, given) for each in value]

    return ArgumentKind(f"several, each {item.expected}", convert)


def _is(value: Any, name: str) -> bool:
    return any(each.__name__ == name for each in type(value).__mro__)


def _is_number(value: Any, kind: type) -> bool:
    """Whether a value is a number of this kind, not nan and at most LARGEST."""
    if not isinstance(value, kind) or isinstance(value, bool | np.bool_):
        return False
    number: Any = value
    return bool(-LARGEST <= number <= LARGEST) and (kind is Real or -(2**63) <= number < 2**63)


def _is_array(value: Any) -> bool:
    try:
        array = np.asarray(value)
        return array.dtype.kind in "fiu" and array.ndim > 0
    except (TypeError, ValueError, OverflowError):
        return False


def _to_whole(value: Any, given: Given) -> int:
    if isinstance(value, float) and value.is_integer() and 0 <= value < 2**53:
        return int(value)
    return int(_checked(value, _is_number(value, Integral)))


def _to_seed(value: Any, given: Given) -> int:
    seed = _to_whole(value, given)
    return int(_checked(seed, seed >= 0))


def _to_array(value: Any, given: Given) -> np.ndarray:
    # Rejected, because numpy would stack the signals of a time response of python-control.
    return np.asarray(_checked(value, _is_array(value) and not _is(value, "TimeResponseData")))


def _to_numbers(value: Any, given: Given) -> tuple[float, ...]:
    _checked(value, _is_array(value) and np.ndim(value) == 1)
    return tuple(np.asarray(value, dtype=float).tolist())


def _to_names(value: Any, given: Given) -> Sequence[str]:
    """Several names, or one string of names separated by commas."""
    if isinstance(value, str):
        return tuple(name.strip() for name in value.split(",") if name.strip())
    if isinstance(value, Mapping) or not isinstance(value, Iterable):
        raise MisfitError
    names = value if isinstance(value, Sequence) else list(value)
    if not all(isinstance(name, str) for name in names):
        raise MisfitError
    return names


def as_plant(value: Any, given: Given) -> Any:
    """A plant. A name or path gives its nonlinear set, or its linear set for the functions in LINEAR."""
    if isinstance(value, str | os.PathLike):
        from .plant.load import load_plant

        return load_plant(os.fspath(value), model="linear" if given.get("") in LINEAR else "nonlinear")
    return _checked(value, _is(value, "Plant"))


def as_log(value: Any, given: Given) -> Any:
    """A log. A path is read with the [log] mapping of the argument `plant`."""
    plant: Any = given.get("plant")
    if isinstance(value, str | os.PathLike) and _is(plant, "Plant"):
        from .identification.plant_log import read_plant_log

        return read_plant_log(os.fspath(value), plant)
    return _checked(value, _is(value, "Log"))


def as_system(value: Any, given: Given) -> Any:
    """A linear model. A name, path or linear plant gives (7) with the position."""
    from .plant.conditions import linear_model
    from .plant.load import load_plant

    if isinstance(value, str | os.PathLike):
        value = load_plant(os.fspath(value), model="linear")
    if _is(value, "Plant") and value.model == "linear":
        return linear_model(value)
    return _checked(value, _is(value, "StateSpace"))


def _is_controller_source(value: Any) -> bool:
    """Whether `load_controller` takes this: name, path, dictionary, linear system, function, or object with a step."""
    linear = _is(value, "StateSpace") or _is(value, "TransferFunction")
    named = isinstance(value, str | os.PathLike | Mapping | type)
    return named or linear or callable(value) or callable(getattr(value, "step", None))


def _to_controller_source(value: Any, given: Given) -> Any:
    return _checked(value, isinstance(value, Controller) or _is_controller_source(value))


def as_controller(value: Any, given: Given) -> Any:
    """A controller. A name is designed on the argument `system`, or on the linear model of `plant` (of `diagnosis`)."""
    if isinstance(value, Controller):
        return value
    _checked(value, _is_controller_source(value))
    from .design.load import load_controller

    system: Any = given.get("system")
    plant: Any = given.get("plant") or getattr(given.get("diagnosis"), "plant", None)
    period = None
    if _is(plant, "Plant"):
        from .plant.conditions import design_model

        period = plant.sample_time
        system = design_model(plant) if system is None else system
        if not isinstance(value, str | os.PathLike):
            from .scenario.plant_data import own_controller

            return own_controller(value, plant, system)
    if isinstance(value, str | os.PathLike | Mapping) or system is not None:
        _checked(system, _is(system, "StateSpace"))
    if isinstance(value, str | os.PathLike):
        return load_controller(os.fspath(value), system, sample_time=period)
    # Without a plant there is no rating; the analysis of a linear law does not depend on its limit.
    limit: dict[str, Any] = {} if isinstance(value, Mapping) else {"current_limit": NO_LIMIT}
    return load_controller(value, system, **limit)


def _is_pair(value: Any, *, open_ended: bool = False) -> bool:
    fits = isinstance(value, tuple | list) and len(value) == 2
    return fits and all(_is_number(item, Real) or (open_ended and item is None) for item in value)


NUMBER = where("a finite number in SI units", lambda value: _is_number(value, Real))
ANY_NUMBER = where(
    NUMBER.expected, lambda value: isinstance(value, Real | np.number) and not isinstance(value, bool | np.bool_)
)
WHOLE = ArgumentKind("a whole number", _to_whole)
SEED = ArgumentKind("a whole number, 0 or more", _to_seed)
FLAG = where("True or False", lambda value: isinstance(value, bool | np.bool_))
TEXT = where("a string", lambda value: isinstance(value, str))
PATH = where("a path", lambda value: isinstance(value, os.PathLike))
NONE = where("None", lambda value: value is None)
ARRAY = ArgumentKind("an array of numbers", _to_array)
NUMBERS = ArgumentKind("an array of numbers", _to_numbers)
NAMES = ArgumentKind("names", _to_names)
FUNCTION = where("a function", callable)
TUPLE = where("a tuple", lambda value: isinstance(value, tuple | list) and all(isinstance(item, str) for item in value))
PAIR = where("a tuple", _is_pair)
SPAN = where("a tuple", lambda value: _is_pair(value, open_ended=True))
PLANT = ArgumentKind('a plant: its name, the path of its TOML, or what load_plant("ehsa") gives', as_plant)
LOG = ArgumentKind(
    "a log: the path of its file, or what read_plant_log(path, plant) or Log.from_pandas(table) gives", as_log
)
SYSTEM = ArgumentKind(
    'a linear model: a plant\'s name, or what three_state(load_plant("ehsa", model="linear")) gives', as_system
)
CONTROLLER = ArgumentKind(
    "a controller: its name, the path of its TOML, a dictionary of its keys, a control.StateSpace or TransferFunction, "
    "a function f(t, y, r), an object with such a step, or what load_controller(name, system) gives",
    as_controller,
)
CONTROLLER_SOURCE = ArgumentKind(CONTROLLER.expected, _to_controller_source)
MAPPING = where("a dictionary", lambda value: isinstance(value, Mapping))
SCENARIO = instance(
    "Scenario", 'a scenario: its name, the path of its TOML, or what load_scenario("steps_spring") gives'
)


def _or_name(kind: ArgumentKind) -> ArgumentKind:
    """A kind whose names and paths the function itself loads."""
    return ArgumentKind(kind.expected, (TEXT | PATH | kind).convert)


#: ArgumentKind -> names of the arguments of this kind. Those with the default None accept None too.
_NAMES = {
    NUMBER: "amplitude band current_limit cutoff deadband delay distance duration excess from_ gain margin period "
    "position pressure_level rate resample rtol sample_time segment settle speed_limit spread stop threshold "
    "to tolerance unknown velocity width window within",
    WHOLE: "direction draws jobs lag lead n order points rehearsals runs shortest starts trials",
    SEED: "seed",
    FLAG: "anew assumed centre check diagnose compiled raise_on_failure sensor_noise subspace uniform",
    TEXT: "by criterion drive_unit estimator kind label method name system_name text time_source",
    TEXT | NONE: "chambers rod_friction shaft_friction",
    TEXT | PATH: "file folder identification path store",
    ARRAY: "current drive force measured reference simulated start time x",
    NUMBERS: "betas masses positions stiffnesses velocities",
    NAMES: "fix free held initial_states names required wanted without",
    FUNCTION: "keep problem watch",
    TUPLE: "align effects missing notes zero",
    PAIR: "rest",
    SPAN: "span",
    PLANT: "plant",
    several(PLANT): "plants",
    _or_name(PLANT): "design",
    _or_name(SCENARIO): "scenario",
    LOG: "after before log validate",
    SYSTEM: "system",
    CONTROLLER: "controller",
    dictionary(ARRAY): "channels outputs",
    dictionary(PAIR): "bounds",
    dictionary(ANY_NUMBER): "noise",
    dictionary(ANY_NUMBER | NONE): "priors",
    dictionary(TEXT | ANY_NUMBER): "settings",
    dictionary(MAPPING): "truth",
    dictionary(SYSTEM): "models systems",
    dictionary(instance("Column")): "columns",
    several(instance("Condition", "what conditions() gives")): "conditions",
    instance("Covariance", "the covariance of an identification"): "covariance",
    instance("DataFrame", "a table of pandas"): "frame",
    instance("Faults"): "faults",
    instance("Diagnosis", "what diagnose(plant, log) gives"): "diagnosis",
    instance("Identification", "what identify(plant, log) gives"): "found",
    instance("Known", "what known_of(plant) gives"): "known",
    instance("RateChange"): "rates",
    instance("RobustMargins", "what robust_margins(systems, controller) gives"): "robust",
    instance("Sensors"): "sensors",
    one_of("linear", "nonlinear"): "model",
    one_of("zero_order", "first_order"): "hold",
    where("anything", lambda value: True): "result",
}
ARGUMENTS = {name: kind for kind, names in _NAMES.items() for name in names.split()}
#: FUNCTION.ARGUMENT -> kind, for arguments with another meaning in a function.
OVERRIDES: dict[str, ArgumentKind] = {
    **{f"{name}.plant": _or_name(PLANT) for name in ("run", "monte_carlo", "learn_reference")},
    **{f"{name}.scenario": _or_name(SCENARIO | MAPPING) for name in ("run", "monte_carlo", "learn_reference")},
    **{f"{name}.controller": CONTROLLER_SOURCE for name in ("monte_carlo", "learn_reference")},
    "run.controller": CONTROLLER_SOURCE | several(CONTROLLER_SOURCE),
    "load_controller.name": CONTROLLER_SOURCE,
    "load_plant.name": TEXT | PATH,
    "load_scenario.name": TEXT | PATH | MAPPING,
    **{f"{name}.force": FLAG for name in ("export_fmu", "write_plant", "write_report")},
    "Log.path": PATH,
    "Log.segment.start": NUMBER,
    "Log.start": NUMBER,
    "analyse_fleet.logs": TEXT | PATH | several(TEXT | PATH),
    "confirm_law.logs": several(LOG),
    "diagnose.log": LOG | several(LOG),
    "diagnose_many.logs": several(_or_name(LOG)),
    "log_controller.controller": TEXT | PATH,
    "frequency_response.logs": LOG | several(LOG),
    "frequency_response.method": one_of("auto", "spectral", "periodic"),
    "identify.logs": LOG | several(LOG),
    "identify.method": one_of("simulation", "balances"),
    "identify.validate": several(LOG),
    "run.assumed": FLAG | NONE,
    "run.draw": instance("Outcome", "a run of monte_carlo(scenario), such as its worst") | NONE,
    "sensitivities.parameters": NAMES,
    "shortest_time.start": NUMBER,
    "simulate.current": ARRAY | instance("TimeResponseData", "a time response of python-control"),
    "simulate_batch.parameters": ARRAY,
    "three_state.position": FLAG,
    "write_plant.plants": PLANT,
}


def convert_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """The function as users call it, with converted arguments. It raises InputError for anything unsuitable.

    It has the name of the function in `ehsa_ctrl`, so that it can be pickled for other processes.
    """
    signature = inspect.signature(function)
    name = function.__qualname__.removesuffix(".__init__")
    kinds = {
        parameter.name: kind_of(name, parameter)
        for parameter in signature.parameters.values()
        if parameter.name not in ("self", "cls") and parameter.kind is not parameter.VAR_KEYWORD
    }

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError:
            # Python's own message names the function and the argument.
            return function(*args, **kwargs)
        values = given.arguments
        for word in sorted((word for word in values if word in kinds), key=lambda word: word not in FIRST):
            beside = {"": name, **values}
            if signature.parameters[word].kind is inspect.Parameter.VAR_POSITIONAL:
                values[word] = tuple(_convert(kinds[word], f"{name}: {word}", item, beside) for item in values[word])
            else:
                values[word] = _convert(kinds[word], f"{name}: {word}", values[word], beside)
        return function(*given.args, **given.kwargs)

    called.__module__, called.__qualname__ = "ehsa_ctrl", function.__name__
    return called


def convert_method_arguments(owner: type, methods: Iterable[str]) -> None:
    """Replace these methods of a class by ones that convert their arguments; a second call changes nothing."""
    for name in methods:
        method = inspect.getattr_static(owner, name)
        bare = getattr(method, "__func__", method)
        if not hasattr(bare, "__wrapped__"):
            checked = convert_arguments(bare)
            checked.__module__, checked.__qualname__ = bare.__module__, bare.__qualname__
            setattr(owner, name, checked if bare is method else type(method)(checked))


def kind_of(function: str, parameter: inspect.Parameter) -> ArgumentKind:
    """Kind of an argument. Raises LookupError for one that is in neither table."""
    kind = OVERRIDES.get(f"{function}.{parameter.name}") or ARGUMENTS[parameter.name]
    return kind | NONE if parameter.default is None else kind


def _convert(kind: ArgumentKind, where: str, value: Any, given: Given) -> Any:
    """The converted value. Raises InputError for a value that does not fit or can't be loaded."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    try:
        return kind.convert(list(value) if isinstance(value, Iterator) else value, given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except MisfitError as misfit:
        loaded = type(value).__name__ in LOADED and kind.expected.startswith("a string")
        use = "; it is already loaded, so use it directly" if loaded else ""
        raise InputError(f"{where} is {str(misfit) or shown(value)}; expected {kind.expected}{use}") from None
