"""Load a controller's TOML and design it on a linear model."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.catalogue import controllers
from ..core.definition import validate
from ..core.errors import InputError, choices, shown
from ..core.files import read_toml
from ..core.unit import parse
from .controller import SampledController
from .kinds import CONTROLLER_KINDS, ControllerFile, ControllerKind

if TYPE_CHECKING:
    import control

#: Keys of a definition that become fields of the controller.
SHARED = ("sample_time", "current_limit", "trajectory", "feedforward", "rest", "dither")


def read_controller(path: Path, sample_time: float | None = None) -> tuple[ControllerKind, ControllerFile]:
    """Read and validate a controller's TOML; sample_time [s] applies if the file states none.

    Raises InputError with file and key.
    """
    return read_content(read_toml(path), str(path), sample_time)


def read_content(
    content: dict[str, Any], where: str, sample_time: float | None = None, drive_unit: str = ""
) -> tuple[ControllerKind, ControllerFile]:
    """Validate the content of a controller's TOML.

    where: file, for messages. drive_unit: SI unit of the plant's drive, if the controller must be one for this plant.

    Raises InputError with file and key, and for a controller of another drive.
    """
    content = dict(content)
    if sample_time is not None:
        content.setdefault("sample_time", f"{sample_time:.9g} s")
    word = content.get("kind")
    if not isinstance(word, str) or word not in CONTROLLER_KINDS:
        raise InputError(f"{where}: kind = {shown(word)}; {choices(word, CONTROLLER_KINDS)}")
    kind = CONTROLLER_KINDS[word]
    definition = validate(content, kind.file, where)
    if drive_unit:
        try:
            parse(content["current_limit"], drive_unit)
        except InputError:
            raise InputError(
                f"{where}: current_limit = {shown(content['current_limit'])}, but the drive of this plant is in "
                f"{drive_unit}; the controller is one for another system"
            ) from None
    return kind, definition


def load_controller(
    name: str | Path, system: control.StateSpace, *, sample_time: float | None = None, drive_unit: str = ""
) -> SampledController:
    """Load a controller by catalogue name or path and design it on a linear model.

    Parameters
    ----------
    system: linear model with the current as first input and an output x, e.g. `three_state(plant)`.
    sample_time: s, the plant's, for a file without one; 4 ms by default.
    drive_unit: SI unit of the plant's drive, to reject a controller of another system; unchecked by default.

    Raises InputError for a missing or invalid file, and for an infeasible design.
    """
    path = controllers.find(name)
    return controller_of(read_toml(path), str(path), path.stem, system, sample_time, drive_unit)


def controller_of(
    content: dict[str, Any],
    where: str,
    name: str,
    system: control.StateSpace,
    sample_time: float | None = None,
    drive_unit: str = "",
) -> SampledController:
    """The controller of a TOML's content; `where` is its file, for messages. Other arguments as in `load_controller`.

    Raises InputError as `load_controller` does.
    """
    kind, definition = read_content(content, where, sample_time, drive_unit)
    try:
        return build_controller(name, kind, definition, system)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def build_controller(
    name: str, kind: ControllerKind, definition: ControllerFile, system: control.StateSpace
) -> SampledController:
    """Design a controller from its definition on a linear model. Raises InputError as `load_controller` does."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            law = kind.design(name, definition, system)
            controller = SampledController(
                name, kind.name, law=law, **{key: getattr(definition, key) for key in SHARED}
            )
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
