"""The quadratic programme of an MPC as C code that cvxpygen writes and this machine's compiler compiles.

M. Schaller, G. Banjac, S. Diamond, A. Agrawal, B. Stellato, S. Boyd, "Embedded code generation with CVXPY", IEEE
Control Systems Letters 6, 2022. The solver in the code is OSQP. How fast it converges depends on the scaling, so the
unknowns are z with theta = root z and the cost z' z / 2, and the rows of the constraints, R z <= sides, have length 1.
"""

from __future__ import annotations

import hashlib
import logging
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...core.compiled import cache_folder, compile_once
from ...core.errors import InputError
from ..qp import FAILED, INFEASIBLE, NO_BOUND, SOLVED, QpSolution
from ..qp._solver import CONVEX
from ..qp.osqp import ITERATIONS, STATUS_TEXTS
from .mpc_problem import Condensed

log = logging.getLogger(__name__)

#: Tolerance of OSQP's residuals, relative to the way from the optimum without bounds to the bounds.
TOLERANCE = 1e-8
#: Settings of OSQP that the code is written with; a step size of 1 suits unit cost and unit rows.
SETTINGS: dict[str, Any] = {"rho": 1.0, "adaptive_rho": False, "scaling": 0, "warm_starting": False, "verbose": False}
#: Longest wait for code and compiler [s]. Engineering judgement: twenty times what a busy machine takes.
TIMEOUT = 600.0
INSTALL = 'install it with pip install "ehsa_ctrl[cvxpygen]"'
#: Run in a process of its own, because cvxpygen prints, changes the folder and calls pip.
_WRITE = f"from {__name__} import write_code; write_code()"


def has_cvxpygen() -> bool:
    """Whether cvxpygen is installed."""
    return find_spec("cvxpygen") is not None


@dataclass(frozen=True)
class CompiledQp:
    """A solver of a condensed problem, a design.qp.QpSolver.

    Attributes
    ----------
    root: (v, v), theta = root z. cost: (v,), 1 where z has a quadratic cost, else 0.
    rows: (k, v), R. scale: (k,), what a bound is multiplied by for a row's side, negative for a lower bound.
    above, below: indices of the bounds that there are; their rows are in this order.
    iteration_limit: of OSQP.
    """

    root: np.ndarray
    cost: np.ndarray
    rows: np.ndarray
    scale: np.ndarray
    above: np.ndarray
    below: np.ndarray
    iteration_limit: int

    @cached_property
    def code(self) -> Any:
        """The compiled code, from the cache if it is there. Raises InputError if cvxpygen or its compiler fails."""
        return _module(_compiled_file(self.arrays))

    def __getstate__(self) -> dict[str, Any]:
        """Without the code, which another process loads for itself."""
        return {name: value for name, value in self.__dict__.items() if name != "code"}

    def solve(self, f: np.ndarray, lower: np.ndarray, upper: np.ndarray, x: np.ndarray, y: np.ndarray) -> QpSolution:
        if not np.isfinite(f).all():
            return QpSolution(FAILED, x, y, 0)
        if not (lower <= upper).all():
            return QpSolution(INFEASIBLE, x, y, 0)
        linear = self.root.T @ f
        sides = self.scale * np.concatenate([upper[self.above], lower[self.below]])
        # The solution is proportional to all vectors together: measured by the way from the optimum without bounds to
        # the bounds, one tolerance serves every sample.
        beyond = self.rows @ (-self.cost * linear) - sides
        size = max(np.max(beyond, initial=0.0), np.max(np.abs(linear[self.cost == 0.0]), initial=0.0)) or 1.0
        given, updated = self.code.parameters(), self.code.updated()
        given.linear, given.sides = (linear / size).tolist(), (sides / size).tolist()
        updated.linear = updated.sides = True
        # The workspace is a warm start only for the run that it solved last; any other would depend on that one.
        self.code.set_warm_start(np.array_equal(x, self.code.last))
        result = self.code.solve(updated, given)
        status = STATUS_TEXTS.get(result.cpg_info.status, FAILED)
        theta = self.root @ (size * np.atleast_1d(result.cpg_prim.z))
        self.code.last = theta if status == SOLVED else None
        return QpSolution(status, theta, np.zeros(y.size), int(result.cpg_info.iter))

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """What the code depends on."""
        limit = np.array(self.iteration_limit)
        return {"cost": self.cost, "rows": self.rows, "limit": limit}


def compiled_qp(problem: Condensed, iteration_limit: int) -> CompiledQp:
    """The solver of a condensed problem, compiled or from the cache.

    Raises InputError if cvxpygen is missing, or if it or the compiler fails.
    """
    values, vectors = np.linalg.eigh(problem.H)
    cost = (values > CONVEX * values[-1]).astype(float)
    every = np.vstack([np.eye(len(values)), problem.G])
    # A direction without a quadratic cost is measured by its largest coefficient.
    largest = np.max(np.abs(every @ vectors), axis=0)
    root = vectors / np.where(cost == 1.0, np.sqrt(np.where(cost == 1.0, values, 1.0)), largest)
    above, below = np.flatnonzero(problem.upper < NO_BOUND), np.flatnonzero(problem.lower > -NO_BOUND)
    rows = every @ root
    length = np.linalg.norm(rows, axis=1)
    scale = np.concatenate([1.0 / length[above], -1.0 / length[below]])
    rows = np.concatenate([rows[above], rows[below]]) * scale[:, None]
    solver = CompiledQp(root, cost, rows, scale, above, below, ITERATIONS * iteration_limit)
    _ = solver.code
    return solver


@cache
def _module(file: Path) -> Any:
    """The solver's module with the names that this file uses; cvxpygen puts the problem's prefix before its own."""
    prefix = _prefix(file.name)
    # pybind11 returns the first module again for another file with the same name.
    loader = ExtensionFileLoader(f"{prefix}.cpg_module", str(file))
    module = module_from_spec(ModuleSpec(loader.name, loader, origin=str(file)))
    loader.exec_module(module)
    names = {"solve": "solve", "parameters": f"{prefix}_cpg_params", "updated": f"{prefix}_cpg_updated"}
    names["set_warm_start"] = "set_solver_warm_starting"
    return SimpleNamespace(last=None, **{name: getattr(module, given) for name, given in names.items()})


def _prefix(key: str) -> str:
    """Prefix of the names in the code, which tells the modules of one process apart."""
    return f"q{key[:12]}"


def _key(arrays: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for package in ("cvxpygen", "cvxpy", "osqp"):
        with suppress(PackageNotFoundError):
            digest.update(f"{package} {version(package)} ".encode())
    digest.update(f"{sys.version} {sys.platform} {TOLERANCE} {SETTINGS}".encode())
    for name, array in arrays.items():
        digest.update(f"{name} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:20]


def _compiled_file(arrays: Mapping[str, np.ndarray]) -> Path:
    """The extension module of this problem. Raises InputError as `compiled_qp`."""
    key = _key(arrays)
    folder = cache_folder() or Path(tempfile.mkdtemp(prefix="ehsa_ctrl-"))
    found = _kept_file(folder, key)
    if found is not None:
        return found
    if not has_cvxpygen():
        raise InputError(f"problem: compiling it needs cvxpygen; {INSTALL}")
    with compile_once(key, "the problem of an MPC with cvxpygen"):
        found = _kept_file(folder, key)
        return found if found is not None else _compile(arrays, folder, key)


def _kept_file(folder: Path, key: str) -> Path | None:
    """The file of this key whose name has the digest of its content; a damaged one is deleted."""
    for file in folder.glob(f"{key}-*.cpg"):
        if file.stem == f"{key}-{_digest(file)}":
            return file
        log.warning("%s: is damaged; compiling again", file)
        with suppress(OSError):
            file.unlink()
    return None


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _compile(arrays: Mapping[str, np.ndarray], folder: Path, key: str) -> Path:
    with tempfile.TemporaryDirectory(dir=folder, prefix="draft-") as draft:
        given: dict[str, Any] = {"key": np.array(key), **arrays}
        np.savez(Path(draft) / "problem.npz", **given)
        try:
            done = subprocess.run(
                [sys.executable, "-c", _WRITE],
                cwd=draft,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=TIMEOUT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise InputError(f"problem: cvxpygen and its compiler took more than {TIMEOUT:g} s") from None
        files = [each for each in (Path(draft) / "code").glob("cpg_module*") if each.suffix in (".so", ".pyd")]
        if not files:
            raise InputError(
                f"problem: cvxpygen could not compile it ({_reason(done.stdout + done.stderr)}); it needs a C compiler "
                "and CMake on the PATH"
            )
        kept = folder / f"{key}-{_digest(files[0])}.cpg"
        files[0].replace(kept)
        return kept


def _reason(text: str) -> str:
    """The line of what cvxpygen, CMake and compiler printed that says most."""
    said = [line.strip() for line in text.splitlines() if line.strip()]
    first = [line for line in said if line.startswith("CMake Error:") or ": error: " in line or "fatal error" in line]
    last = [line for line in said if "error" in line.lower()] or said or ["no module was made"]
    return (first[0] if first else last[-1])[:200]


def write_code() -> None:
    """Write and compile the code of problem.npz, both in the present folder."""
    import cvxpy
    from cvxpygen import cpg

    cp: Any = cvxpy
    given = np.load("problem.npz")
    rows, cost = given["rows"], given["cost"]
    z, linear = cp.Variable(rows.shape[1], name="z"), cp.Parameter(rows.shape[1], name="linear")
    sides = cp.Parameter(len(rows), name="sides")
    total = 0.5 * cp.sum_squares(z[np.flatnonzero(cost)]) + linear @ z
    problem = cp.Problem(cp.Minimize(total), [rows @ z <= sides])
    options = {**SETTINGS, "eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "max_iter": int(given["limit"])}
    cpg.generate_code(problem, code_dir="code", solver="OSQP", solver_opts=options, prefix=_prefix(str(given["key"])))
