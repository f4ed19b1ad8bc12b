"""A controller as C99 files: the functions that run in Python, with a test vector and its test.

All laws are translated completely, an MPC with a dual active-set solver.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from ...core.controller_interface import INPUTS, MEASURED, REFERENCE, REFERENCE_FORCE
from ...core.errors import InputError
from ...core.files import FORCE_ARGUMENT
from ...core.result_folder import ResultFolder
from ..controller import Law, SampledController
from ..kinds._scheduled_mpc_law import ScheduledMpc
from ..python_law import PythonLaw
from ..qp._dual_active_set import TOLERANCES, TOLERANCES_FLOAT
from ..stages.feedforward import feedforward
from ..stages.pipeline import S_FEED, S_LAW, S_PLAN, S_REST, STAGES, pipeline
from ..stages.rest import rest
from ..stages.supervision import supervise
from ..stages.trajectory import plan
from ..state_space.mpc import Mpc
from .embedded import embedded_law, exact_law, replay_with_exact
from .fixed import FixedCode, FixedWord, write_fixed
from .number import DOUBLES, NumberType
from .program import Program, setting_names

#: Largest difference of C and Python that the test accepts [A]; with the same libm there is none.
TOLERANCE = 1e-9
#: The same for floats, as a part of the current limit: 2^-9 is the step of a 10-bit converter over both directions.
TOLERANCE_FLOAT = 2.0**-9
#: The same for fixed point by bits of its words.
TOLERANCE_FIXED = {32: 2.0**-9, 16: 2.0**-4}
TEMPLATES = Path(__file__).parent / "templates"
VECTOR = "test_vector.csv"
#: Files of every controller.
FILES = ("controller.h", "controller.c", "test.c", "Makefile", "README.md", VECTOR)
#: Title, function, first index and end of the settings of each stage.
STAGE_SETTINGS = (
    ("supervision", supervise, 0, S_PLAN),
    ("trajectory", plan, S_PLAN, S_FEED),
    ("feed-forward", feedforward, S_FEED, S_REST),
    ("rest and dither", rest, S_REST, S_LAW),
)
#: Unnamed numbers per line of settings.
COLUMNS = 4


@dataclass(frozen=True)
class TestVector:
    """Inputs of a run, and the currents of the Python controller.

    Attributes
    ----------
    reference (N, 3), or (N, 4) with a force target, measured (N, 5): as in core.controller_interface; nan is a lost
        reading.
    current: (N,) of the Python controller [A].
    exact: (N,) with an exact solver from the same memory [A]; None for a law without a solver.
    unsolved: (N,) whether the sample took the fallback. iterations: (N,) of the solver; None without one.
    """

    reference: np.ndarray
    measured: np.ndarray
    current: np.ndarray
    exact: np.ndarray | None = None
    unsolved: np.ndarray | None = None
    iterations: np.ndarray | None = None

    @property
    def distance(self) -> float | None:
        """Largest difference [A] of solved samples from the exact solution; None for a law without a solver."""
        if self.exact is None or self.unsolved is None:
            return None
        return float(np.max(np.abs(self.current - self.exact)[~self.unsolved], initial=0.0))

    @property
    def fallbacks(self) -> int:
        """Number of samples that took the fallback."""
        return 0 if self.unsolved is None else int(np.count_nonzero(self.unsolved))

    @property
    def columns(self) -> list[str]:
        force = ["reference_force"] if self.reference.shape[1] > REFERENCE_FORCE else []
        inputs = [*INPUTS[:REFERENCE_FORCE], *force, *INPUTS[REFERENCE_FORCE:]]
        return [*inputs, "current", *([] if self.exact is None else ["exact"])]

    def to_csv(self) -> str:
        """CSV with a header row; numbers keep every bit."""
        last = [self.current] if self.exact is None else [self.current, self.exact]
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(self.columns)
        rows.writerows(np.column_stack([self.reference, self.measured, *last]).tolist())
        return text.getvalue()


def replay(controller: SampledController, reference: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Currents (N,) [A] of the controller in Python from its initial memory."""
    memory = controller.initial_memory()
    return np.array([controller.step(r, y, memory) for r, y in zip(reference, measured, strict=True)])


@dataclass(frozen=True)
class Deployment:
    """A controller as C99 source.

    Attributes
    ----------
    name: of the controller. files: name -> text.
    vector: the test vector. tolerance: of the test [unit]. unit: of the drive, SI. fixed: scales of fixed-point code;
        None for others.
    """

    name: str
    files: Mapping[str, str]
    vector: TestVector
    tolerance: float
    unit: str = "A"
    fixed: FixedCode | None = None

    def write(
        self, folder: str | Path, *, force: bool = False, more: Callable[[Path], None] = lambda draft: None
    ) -> None:
        """Write all files. force: replace an earlier export. more: writes further files into the folder that it gets.

        Raises InputError for an earlier export without `force`, and for files that are not of an export.
        """
        with ResultFolder(Path(folder), "export", force, how=FORCE_ARGUMENT).draft() as draft:
            for name, text in self.files.items():
                (draft / name).write_text(text, encoding="utf-8")
            more(draft)

    def __str__(self) -> str:
        vector = self.vector
        count, unit = len(vector.current), self.unit
        lines = [f"{self.name}: {count} samples of a run as test vector, tolerance {self.tolerance:g} {unit}"]
        if vector.distance is not None and vector.iterations is not None:
            lines.append(
                f"solver: {vector.fallbacks} of {count} samples unsolved, at most {int(vector.iterations.max())} "
                f"iterations, at most {vector.distance:.3g} {unit} from DAQP's solution"
            )
        return "\n".join(lines)


def export_controller(
    controller: SampledController,
    reference: np.ndarray,
    measured: np.ndarray,
    *,
    number: NumberType | FixedWord = DOUBLES,
    runs: Iterable[tuple[np.ndarray, np.ndarray]] = (),
) -> Deployment:
    """Translate a controller to C99.

    Parameters
    ----------
    reference (N, 3), measured (N, 5): of a run, for the test vector; may contain lost readings (nan). A controller that
        follows a force needs its target as fourth column of the reference.
    number: type of the numbers in C.
    runs: reference and measured of more runs, whose ranges the scales of fixed-point code cover as well.

    Raises InputError for a law outside the translator's subset of Python, for an MPC without a unique solution or in
    fixed point, and for wrong shapes.
    """
    reference, measured = np.array(reference, dtype=float), np.array(measured, dtype=float)
    n, width = len(reference), len(REFERENCE) + controller.follows_force
    if n < 1 or reference.shape != (n, width) or measured.shape != (n, len(MEASURED)):
        raise InputError(
            f"a test vector of shapes {reference.shape} and {measured.shape}; expected (N, {width}) and "
            f"(N, {len(MEASURED)})"
        )
    law: Law = controller.law
    if isinstance(law, PythonLaw):
        raise InputError(f"{controller.name} is Python code; expected a designed controller or a linear law")
    tolerance = TOLERANCE if number == DOUBLES else TOLERANCE_FLOAT * controller.current_limit
    if isinstance(number, FixedWord):
        tolerance = TOLERANCE_FIXED[number.bits] * controller.current_limit
        vector = TestVector(reference, measured, replay(controller, reference, measured))
        code = write_fixed(controller, number, [(reference, measured), *runs])
        files = _fixed_files(code, vector, tolerance)
        return Deployment(controller.name, files, vector, tolerance, controller.drive_unit, code)
    embedded = embedded_controller(controller)
    if isinstance(law, Mpc | ScheduledMpc):
        exact = replace(controller, law=exact_law(law))
        vector = TestVector(reference, measured, *replay_with_exact(embedded, exact, reference, measured))
    else:
        vector = TestVector(reference, measured, replay(controller, reference, measured))
    written = embedded_controller(controller, number)
    files = _files(written, vector, tolerance, number)
    return Deployment(controller.name, files, vector, tolerance, controller.drive_unit)


def embedded_controller(controller: SampledController, number: NumberType = DOUBLES) -> SampledController:
    """The controller whose functions are translated: an MPC with the solver of exported code and its tolerances for
    this type of numbers, any other itself.

    Raises InputError for an MPC with unknowns that have no quadratic cost.
    """
    law: Law = controller.law
    if not isinstance(law, Mpc | ScheduledMpc):
        return controller
    try:
        return replace(controller, law=embedded_law(law, TOLERANCES if number == DOUBLES else TOLERANCES_FLOAT))
    except InputError as error:
        raise InputError(f"{controller.name}: {error}") from None


def _files(controller: SampledController, vector: TestVector, tolerance: float, number: NumberType) -> dict[str, str]:
    law, memory = controller.law, controller.initial_memory()
    program = Program(
        (*STAGES, pipeline, *law.uses, law.function),
        substitutes={"law": law.function},
        number=number,
    )
    context = _context(controller, vector, tolerance) | {
        "real": number.word,
        "zero": number.literal(0.0),
        "sample_time": number.literal(controller.sample_time),
        "current_limit": number.literal(controller.current_limit),
        "initial": [(k, number.literal(value)) for k, value in enumerate(memory.tolist()) if value != 0.0],
        "settings": _settings_lines(controller, number),
        "size": controller.settings().size,
        "program": program.text(pipeline),
        "solver": vector.exact is not None,
        "iterations": 0 if vector.iterations is None else int(vector.iterations.max()),
        "distance": vector.distance,
        "unsolved": vector.fallbacks,
    }
    return _rendered(context, TEMPLATES, vector)


def _fixed_files(code: FixedCode, vector: TestVector, tolerance: float) -> dict[str, str]:
    return _rendered(_context(code.controller, vector, tolerance) | code.context(), TEMPLATES / "fixed", vector)


def _context(controller: SampledController, vector: TestVector, tolerance: float) -> dict[str, Any]:
    """What all templates need."""
    return {
        "name": controller.name,
        "law": controller.law_words,
        "sample_time": repr(controller.sample_time),
        "current_limit": repr(controller.current_limit),
        "traces": dict(controller.traces),
        "samples": len(vector.current),
        "columns": len(vector.columns),
        "references": vector.reference.shape[1],
        "follows_force": controller.follows_force,
        "memory": controller.initial_memory().size,
        "tolerance": repr(tolerance),
        "unit": controller.drive_unit,
    }


def _rendered(context: Mapping[str, Any], folder: Path, vector: TestVector) -> dict[str, str]:
    """All files from the templates of a folder, those that it lacks from TEMPLATES."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([folder, TEMPLATES]),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    files = {name: environment.get_template(f"{name}.j2").render(context) for name in FILES if name != VECTOR}
    return {**files, VECTOR: vector.to_csv()}


def _settings_lines(controller: SampledController, number: NumberType) -> list[str]:
    """Lines of the settings' initialiser, by stage, with the variables' names from the code as comments."""
    values, law = controller.settings(), controller.law
    lines = []
    for title, function, start, stop in STAGE_SETTINGS:
        lines += [f"/* {title} */", *_table(values[start:stop], setting_names(function, STAGES), {}, number)]
    # Matrices come last, in the order of their names.
    matrices: Mapping[str, np.ndarray] = getattr(law, "matrices", {})
    names = setting_names(law.function, law.uses)
    return [*lines, f"/* {law.function.__name__} */", *_table(values[S_LAW:], names, matrices, number)]


def _table(
    values: np.ndarray, names: Mapping[int, str], matrices: Mapping[str, np.ndarray], number: NumberType
) -> list[str]:
    titles, place = {}, values.size - sum(matrix.size for matrix in matrices.values())
    for name, matrix in matrices.items():
        titles[place] = f"{name} ({', '.join(map(str, matrix.shape))})"
        place += matrix.size
    lines: list[str] = []
    row: list[str] = []
    for k, value in enumerate(values.tolist()):
        if row and (k in titles or k in names or len(row) == COLUMNS):
            lines.append(" ".join(row))
            row = []
        if k in titles:
            lines.append(f"/* {titles[k]} */")
        if k in names:
            lines.append(f"{number.literal(value)}, /* {names[k]} */")
        else:
            row.append(f"{number.literal(value)},")
    return [*lines, " ".join(row)] if row else lines
