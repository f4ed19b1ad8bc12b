"""What users give to public functions: names and paths where loaded things are expected, a sentence for anything else.

Annotations say what a function takes; here they are read and held against what was given. What can be loaded is loaded:
a plant, a log, a linear model and a controller may be given by name or path. Only the names of `ehsa_ctrl` itself do
this; inside the package functions get what their annotations say.
"""

from __future__ import annotations

import ast
import inspect
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import wraps
from itertools import cycle
from numbers import Integral, Real
from typing import Any, ParamSpec, TypeVar, get_args

import numpy as np

from .core.controller_interface import Controller
from .core.errors import InputError, shown

P = ParamSpec("P")
R = TypeVar("R")

#: What a class is to a user, and how one comes by it.
MEANT = {
    "Plant": 'a plant: its name, the path of its TOML, or what load_plant("ehsa") gives',
    "Log": "a log: the path of its file, or what read_plant_log(path, plant) or Log.from_pandas(table) gives",
    "StateSpace": 'a linear model: a plant\'s name, or what three_state(load_plant("ehsa", model="linear")) gives',
    "Controller": "a controller: its name, the path of its TOML, or what load_controller(name, system) gives",
    "Scenario": 'a scenario: its name, the path of its TOML, or what load_scenario("steps_spring") gives',
    "Identification": "what identify(plant, log) gives",
    "RobustMargins": "what robust_margins(systems, controller) gives",
    "Known": "what known_of(plant) gives",
    "Covariance": "the covariance of an identification",
    "float": "a finite number in SI units",
    "int": "a whole number",
    "bool": "True or False",
    "str": "a text",
    "Path": "a path",
    "None": "None",
    "np.ndarray": "an array of numbers",
    "DataFrame": "a table of pandas",
    "Callable": "a function",
    "Watch": "a function",
}
#: The largest number, in SI units.
LARGEST = 1e30
#: What names and paths are loaded to.
LOADED = ("Plant", "Log", "SampledController", "Scenario")
#: Functions on the linear set of parameters: a plant that they are given by name is that one.
LINEAR = ("four_state", "three_state")
#: Arguments that say how others are to be loaded.
FIRST = ("plant", "system")


def accepting(function: Callable[P, R]) -> Callable[P, R]:
    """The function as users call it: names and paths are loaded, what does not fit is an InputError of one sentence.

    It has the name that it has in `ehsa_ctrl`, so that it can be sent to other processes.
    """
    signature = inspect.signature(function)

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError:
            # Python's own words name the function and the argument.
            return function(*args, **kwargs)
        for name in sorted(given.arguments, key=lambda name: name not in FIRST):
            parameter = signature.parameters[name]
            given.arguments[name] = _each(function, parameter, given.arguments)
        return function(*given.args, **given.kwargs)

    called.__module__, called.__qualname__ = "ehsa_ctrl", function.__name__
    return called


def checking(owner: type, methods: Iterable[str]) -> None:
    """Have these methods of a class check what they are given, once."""
    for name in methods:
        method = inspect.getattr_static(owner, name)
        bare = getattr(method, "__func__", method)
        if not hasattr(bare, "__wrapped__"):
            checked = accepting(bare)
            checked.__module__, checked.__qualname__ = bare.__module__, bare.__qualname__
            setattr(owner, name, checked if bare is method else type(method)(checked))


def _each(function: Callable[..., Any], parameter: inspect.Parameter, given: Mapping[str, Any]) -> Any:
    """An argument, or all of those that stand for `*name`, as the function wants them."""
    value = given[parameter.name]
    if parameter.annotation is inspect.Parameter.empty:
        # The object or class that a method belongs to.
        return value
    if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
        return tuple(_accepted(function, parameter, item, given) for item in value)
    return _accepted(function, parameter, value, given)


def _accepted(function: Callable[..., Any], parameter: inspect.Parameter, value: Any, given: Mapping[str, Any]) -> Any:
    """The value as the function wants it, loaded if it can be. Raises InputError for one that does not fit."""
    words = list(_alternatives(str(parameter.annotation)))
    names = function.__globals__
    if isinstance(value, Iterator) and any(word.startswith(("Sequence", "Iterable")) for word in words):
        value = list(value)
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    for word in words:
        if _fits(value, word, names) and not (parameter.name == "seed" and value < 0):
            return _plain(value, word)
    where = f"{function.__qualname__.removesuffix('.__init__')}: {parameter.name}"
    try:
        return _loaded(function, words, value, given)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except LookupError:
        loaded = "; it is loaded already, use it as it is" if type(value).__name__ in LOADED and "str" in words else ""
        tables = [word.partition("[")[2].removesuffix("]") for word in words if word.startswith(("Mapping", "dict"))]
        odd = _odd(value, tables[0], names) if tables and isinstance(value, Mapping) else []
        got = f"a dictionary with {odd[0]}" if odd else shown(value)
        raise InputError(f"{where} is {got}; expected {_expected(words, names)}{loaded}") from None


def _plain(value: Any, word: str) -> Any:
    """A value that fits, as numpy's arrays and tuples of numbers where these are what is meant."""
    if word == "np.ndarray" and (isinstance(value, Sequence) or hasattr(value, "__array__")):
        return np.asarray(value)
    if word == "Sequence[float]":
        return tuple(np.asarray(value, dtype=float).tolist())
    return list(value) if word.startswith("Sequence") and not isinstance(value, Sequence) else value


def _loaded(function: Callable[..., Any], words: Sequence[str], value: Any, given: Mapping[str, Any]) -> Any:
    """What a name, a path or a text of names stands for. Raises LookupError where it stands for nothing."""
    bare = {word.rpartition(".")[2] for word in words}
    if not isinstance(value, str | os.PathLike):
        if "int" in bare and isinstance(value, float) and value.is_integer() and 0 <= value < 2**53:
            return int(value)
        if "Sequence[Log]" in bare and isinstance(value, list | tuple):
            return [_log(item, given) for item in value]
        if "StateSpace" in bare and _is(value, "Plant") and value.model == "linear":
            return _linear_model(value)
        raise LookupError(value)
    if "Plant" in bare:
        from .plant.load import load_plant

        return load_plant(os.fspath(value), model="linear" if function.__name__ in LINEAR else "nonlinear")
    if "Log" in bare:
        return _log(value, given)
    if "Sequence[Log]" in bare:
        return [_log(value, given)]
    if "Sequence[str | Path | Log]" in bare:
        return [value]
    if "StateSpace" in bare:
        from .plant.load import load_plant

        return _linear_model(load_plant(os.fspath(value), model="linear"))
    if "Controller" in bare or bare == {"Any"}:
        return _controller(value, given)
    if isinstance(value, str) and bare & {"Sequence[str]", "Iterable[str]"}:
        return tuple(name.strip() for name in value.split(",") if name.strip())
    raise LookupError(value)


def _log(value: Any, given: Mapping[str, Any]) -> Any:
    if _is(value, "Log"):
        return value
    plant: Any = given.get("plant")
    if not isinstance(value, str | os.PathLike) or not _is(plant, "Plant"):
        raise LookupError(value)
    from .identification.plant_log import read_plant_log

    return read_plant_log(os.fspath(value), plant)


def _linear_model(plant: Any) -> Any:
    from .plant.linear import three_state

    return three_state(plant)


def _controller(value: Any, given: Mapping[str, Any]) -> Any:
    """A controller by name, designed on the linear model that is given beside it or on the plant's own."""
    from .design.load import load_controller
    from .plant.load import load_plant

    system: Any = given.get("system")
    plant: Any = given.get("plant")
    if system is None and _is(plant, "Plant") and plant.path is not None:
        system = _linear_model(load_plant(plant.path, model="linear"))
    if not _is(system, "StateSpace"):
        raise LookupError(value)
    period = plant.sample_time if _is(plant, "Plant") else None
    return load_controller(os.fspath(value), system, sample_time=period)


def _alternatives(annotation: str, between: str = "|") -> Iterator[str]:
    """The parts of "A | B[C | D]": A, then B[C | D]."""
    depth, start = 0, 0
    for place, sign in enumerate(annotation):
        depth += (sign in "[(") - (sign in "])")
        if sign == between and depth == 0:
            yield annotation[start:place].strip()
            start = place + 1
    yield annotation[start:].strip()


def _fits(value: Any, word: str, names: Mapping[str, Any]) -> bool:
    """Whether a value is what one alternative of an annotation says."""
    head, _, inner = word.partition("[")
    inner = inner.removesuffix("]")
    words = _words(word, names)
    if words:
        return value in words if isinstance(value, str) else False
    match head.rpartition(".")[2]:
        case "None":
            return value is None
        case "Any":
            return not isinstance(value, str | os.PathLike)
        case "bool":
            return isinstance(value, bool | np.bool_)
        case "float":
            return _is_number(value, Real)
        case "Real":
            return isinstance(value, Real | np.number) and not isinstance(value, bool)
        case "int":
            return _is_number(value, Integral)
        case "str":
            return isinstance(value, str)
        case "Path":
            return isinstance(value, os.PathLike)
        case "ndarray":
            return _is_numeric(value)
        case "Mapping" | "dict":
            return isinstance(value, Mapping) and not _odd(value, inner, names)
        case "Callable" | "Watch":
            return callable(value)
        case "tuple":
            kinds = [kind for kind in _alternatives(inner, ",") if kind != "..."]
            many = isinstance(value, tuple | list) and ("..." in inner or len(value) == len(kinds))
            return many and all(_is_many([item], kind, names) for item, kind in zip(value, cycle(kinds), strict=False))
        case "Sequence" if inner == "float":
            return _is_numeric(value) and np.ndim(value) == 1
        case "Sequence" | "Iterable":
            return _is_many(value, inner, names)
        case "Controller":
            return isinstance(value, Controller)
        case name:
            return _is(value, name)


def _odd(value: Mapping[Any, Any], inner: str, names: Mapping[str, Any]) -> list[str]:
    """What of a dictionary does not fit "str, KIND"; how large a number may be is said by whom it is for."""
    kind = inner.partition(",")[2].strip()
    words = [*_alternatives(kind), *(["Real"] if "float" in kind else [])]
    return [
        f"{shown(item)} under {shown(key)}"
        for key, item in value.items()
        if not isinstance(key, str) or not any(_fits(item, word, names) for word in words)
    ]


def _words(word: str, names: Mapping[str, Any]) -> tuple[Any, ...]:
    """The words that Literal["a", "b"], or an alias of it in the function's module, lets pass."""
    if word.startswith("Literal["):
        return tuple(ast.literal_eval(f"({word[8:-1]},)"))
    return tuple(item for item in get_args(names.get(word)) if isinstance(item, str))


def _is(value: Any, name: str) -> bool:
    """Whether a value's class, or one that it is derived from, has this name: nothing is imported to tell."""
    return any(each.__name__ == name for each in type(value).__mro__)


def _is_number(value: Any, kind: type) -> bool:
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not isinstance(value, kind) or isinstance(value, bool | np.bool_):
        return False
    number: Any = value
    # Neither nan nor what nothing can be computed with.
    return bool(-LARGEST <= number <= LARGEST) and (kind is Real or -(2**63) <= number < 2**63)


def _is_numeric(value: Any) -> bool:
    try:
        array = np.asarray(value)
        return array.dtype.kind in "fiu" and array.ndim > 0
    except (TypeError, ValueError, OverflowError):
        return False


def _is_many(value: Any, inner: str, names: Mapping[str, Any]) -> bool:
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        return False
    return all(any(_fits(item, word, names) for word in _alternatives(inner)) for item in value)


def _expected(words: Sequence[str], names: Mapping[str, Any]) -> str:
    """What would have fitted, in words."""
    said = []
    for word in words:
        head, _, inner = word.partition("[")
        choices = _words(word, names)
        name = head.rpartition(".")[2]
        if choices:
            said.append(" or ".join(repr(choice) for choice in choices))
        elif name in ("Sequence", "Iterable") and inner != "float]":
            items = [part.rpartition(".")[2] for part in _alternatives(inner.removesuffix("]"))]
            item = next((part for part in reversed(items) if part in MEANT), "")
            said.append("several, each " + MEANT[item] if item not in ("", "str") else "names")
        elif name in ("Mapping", "dict"):
            kind = inner.removesuffix("]").partition(",")[2].strip()
            said.append(f"a dictionary that has under each name {_expected(list(_alternatives(kind)), names)}")
        elif name == "tuple":
            said.append("a tuple")
        elif name == "ndarray" or name == "Sequence":
            said.append(MEANT["np.ndarray"])
        elif name == "TimeResponseData":
            said.append("a time response of python-control")
        else:
            said.append(MEANT.get(name, f"a {name}"))
    # A name and a path are in the words for what they stand for.
    if len(words) > 1 and any(part.startswith(("a plant:", "a controller:", "a scenario:")) for part in said):
        said = [part for part in said if part not in (MEANT["str"], MEANT["Path"])]
    return ", or ".join(dict.fromkeys(said))
