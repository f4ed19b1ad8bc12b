"""A controller as C99: the functions that run in Python, written out, with a test vector and a test.

The law stands once, in Python. PID, cascade and state feedback are translated whole; of an MPC the estimate, the
problem and the fallback are translated and OSQP writes its solver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from ...core.files import FORCE_ARGUMENT
from ...core.result_folder import ResultFolder
from ..controller import Law, SampledController
from ..mpc import Mpc, solve_qp
from ..qp import QP_SOLVERS
from ..stages.feedforward import feedforward
from ..stages.pipeline import M_LAW, S_FEED, S_LAW, S_PLAN, S_REST, STAGES, pipeline
from ..stages.rest import rest
from ..stages.supervision import supervise
from ..stages.trajectory import plan
from .embedded import EmbeddedMpc, EmbeddedOsqp, Recorder, multipliers, solved_by, step_size, with_law
from .expressions import Signature
from .kinds import ARRAY, DOUBLE, literal
from .layout import setting_names, settings_lines
from .program import Program
from .vector import Vector, checked, replay

#: Largest difference of the C from Python that the test lets pass [A]. With the same libm there is none but an MPC's,
#: whose solver's file keeps 20 digits behind the point and not all of a small number's.
TOLERANCE, TOLERANCE_MPC = 1e-9, 1e-6
#: Of the exact solver, so many that it never stops early.
EXACT_ITERATIONS = 10_000
FOLDER = Path(__file__).parent / "templates"
VECTOR = "test_vector.csv"
#: What is written of every controller; of an MPC the solver as well.
FILES = ("controller.h", "controller.c", "test.c", "Makefile", "README.md", VECTOR)
#: Title and function of each stage, and where its settings stand.
TITLES = (
    ("supervision", supervise, 0, S_PLAN),
    ("trajectory", plan, S_PLAN, S_FEED),
    ("feed-forward", feedforward, S_FEED, S_REST),
    ("rest and dither", rest, S_REST, S_LAW),
)


@dataclass(frozen=True)
class Deployment:
    """A controller as C99 source.

    Attributes
    ----------
    name: the controller's. files: name -> text.
    vector: the test vector. tolerance: of the test [A].
    solver: what writes its C beside the files; None for a law without one. rho: its step size.
    """

    name: str
    files: Mapping[str, str]
    vector: Vector
    tolerance: float
    solver: EmbeddedOsqp | None = field(default=None, repr=False)
    rho: float | None = None

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write all files; the solver's go to `osqp/`. force: replace an earlier export.

        Raises InputError for an earlier export without `force`, and for other files that are in the way.
        """
        with ResultFolder(Path(folder), "export", force, how=FORCE_ARGUMENT).draft() as draft:
            for name, text in self.files.items():
                (draft / name).write_text(text, encoding="utf-8")
            if self.solver is not None:
                self.solver.generate(draft / "osqp")

    def __str__(self) -> str:
        lines = [f"{self.name}: {len(self.vector.current)} samples of a run, to be met within {self.tolerance:g} A"]
        if self.vector.distance is not None:
            left = self.vector.left
            lines.append(
                f"OSQP with step size {self.rho:g}: at most {self.vector.distance:.3g} A from the exact solution"
                + (f", {left} samples unsolved and left to the fallback" if left else "")
            )
        return "\n".join(lines)


def export_controller(controller: SampledController, reference: np.ndarray, measured: np.ndarray) -> Deployment:
    """Write a controller as C99.

    Parameters
    ----------
    reference (N, 3), measured (N, 5): of a run, for the test vector; lost readings (nan) included.

    Raises
    ------
    InputError: its law is not in the subset of Python that can be written as C, or OSQP does not solve its MPC.
    """
    reference, measured = checked(reference, measured)
    law: Law = controller.law
    if not isinstance(law, Mpc):
        vector = Vector(reference, measured, replay(controller, reference, measured))
        return Deployment(controller.name, _files(controller, vector, TOLERANCE), vector, TOLERANCE)
    condensed = law.condensed
    exact = QP_SOLVERS["daqp"].make(condensed.H, condensed.G, EXACT_ITERATIONS, None)
    recorder = Recorder(exact)
    replay(with_law(controller, solved_by(law, recorder)), reference, measured)
    rho = step_size(law, recorder.asked)
    solver = EmbeddedOsqp(condensed.H, condensed.G, law.iteration_limit, rho)
    ours, best = (with_law(controller, solved_by(law, by)) for by in (solver, exact))
    vector = _beside_exact(ours, best, reference, measured)
    written = with_law(controller, EmbeddedMpc(law))
    files = _files(written, vector, TOLERANCE_MPC, rho=rho)
    return Deployment(controller.name, files, vector, TOLERANCE_MPC, solver, rho)


def _beside_exact(
    controller: SampledController, exact: SampledController, reference: np.ndarray, measured: np.ndarray
) -> Vector:
    """Each sample also by an exact solver, from the memory that the other one has then."""
    memory, place = controller.initial_memory(), multipliers(controller, M_LAW)
    currents, unsolved = np.empty((2, len(reference))), np.zeros(len(reference), dtype=bool)
    reason = controller.traces["solver_reason"]
    for k, (r, y) in enumerate(zip(reference, measured, strict=True)):
        other = memory.copy()
        # Multipliers that are almost zero would be taken for active limits.
        other[place] = 0.0
        currents[:, k] = controller.step(r, y, memory), exact.step(r, y, other)
        unsolved[k] = memory[reason] != 0.0
    return Vector(reference, measured, currents[0], currents[1], unsolved)


def _files(controller: SampledController, vector: Vector, tolerance: float, rho: float | None = None) -> dict[str, str]:
    law, memory = controller.law, controller.initial_memory()
    qp = Signature("solve_qp", (ARRAY,) * 6, DOUBLE, (False, False, False, True, True, True))
    program = Program(
        (*STAGES, pipeline, *law.uses, law.function),
        outside={solve_qp: qp} if rho is not None else {},
        stands_for={"law": law.function},
    )
    last = memory.size - 1
    context: dict[str, Any] = {
        "name": controller.name,
        "law": str(law),
        "sample_time": literal(controller.sample_time),
        "current_limit": literal(controller.current_limit),
        "traces": dict(controller.traces),
        "samples": len(vector.current),
        "columns": len(vector.columns),
        "memory": last + 1,
        "initial": [(k, literal(value)) for k, value in enumerate(memory.tolist()) if value != 0.0],
        "settings": _settings(controller),
        "size": controller.settings().size,
        "program": program.text(pipeline),
        "solver": rho is not None,
        "unknowns": law.mpc.condensed.F.shape[0] if isinstance(law, EmbeddedMpc) else 0,
        "bounds": law.mpc.condensed.lower.size if isinstance(law, EmbeddedMpc) else 0,
        "tolerance": literal(tolerance),
        "distance": vector.distance,
        "unsolved": vector.left,
    }
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(FOLDER),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    files = {name: environment.get_template(f"{name}.j2").render(context) for name in FILES if name != VECTOR}
    return {**files, VECTOR: vector.to_csv()}


def _settings(controller: SampledController) -> list[str]:
    """Lines of the initialiser, stage by stage."""
    values, law = controller.settings(), controller.law
    lines = []
    for title, function, start, stop in TITLES:
        names = setting_names(function, STAGES)
        lines += [f"/* {title} */", *settings_lines(values[start:stop], names, {})]
    names = setting_names(law.function, law.uses)
    parts: Mapping[str, np.ndarray] = getattr(law, "matrices", {})
    return [*lines, f"/* {law.function.__name__} */", *settings_lines(values[S_LAW:], names, parts)]
