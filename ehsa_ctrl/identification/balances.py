"""Parameters from balances: least squares on measured signals, without a simulation.

Torque, flow and force balances are sums that vanish in the true plant, linear in most parameters. Two ways to take
the derivatives in them:

"weak": each balance is weighed by short bumps (test functions) and summed over them. Summed by parts, the derivative
falls on the bump and not on the noisy signal; here the same sums are formed from central differences.

"filtered": the position is filtered without phase and differentiated, then both sides of the balance go through one
and the same low-pass and are thinned out to its bandwidth. M. Gautier, "Dynamic identification of robots with power
model", IEEE ICRA 1997, calls it parallel filtering; the EMPS benchmark was identified that way.

Standard deviations hold for the residual as it is, correlated from row to row: W. K. Newey, K. D. West, "A simple,
positive semi-definite, heteroskedasticity and autocorrelation consistent covariance matrix", Econometrica 55, 1987.
They do not cover what noise in the regressors shifts, nor errors of parameters taken as known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..core.errors import InputError, choices
from ..core.log import Log
from ..core.text import TextResult
from ..plant.arrays import array_evaluator, needs
from ..plant.plant import Plant
from ..plant.system import Balance, ParameterKind
from .measured import Measured, Method, measure

if TYPE_CHECKING:
    import pandas

#: A parameter whose standard deviation is a larger part of it than this is not determined.
VAGUE = 0.5
#: Why a parameter is taken as known where a balance has no term without a parameter.
RATIO = "only its ratio to the others is determined"
#: Length of a bump in samples, and how far one is from the next.
BUMP, STRIDE = 12, 4


@dataclass(frozen=True)
class Estimated:
    """One parameter: value and standard deviation in SI units, what it was believed to be, the balance it is from."""

    name: str
    value: float
    sd: float
    unit: str
    nominal: float
    balance: str


@dataclass(frozen=True)
class BalanceFit:
    """How well a balance closes: rows used, RMS of its residual, and ||residual|| / ||term|| (see `Balance.terms`)."""

    name: str
    unit: str
    rows: int
    rms: float
    relative_error: float


@dataclass(frozen=True)
class BalanceEstimate(TextResult):
    """What the balances of a system tell of its parameters.

    Attributes
    ----------
    plant: with the estimated values.
    parameters: by name, those that were determined.
    undetermined: name -> why not.
    balances: in the order in which they were solved.
    method: in words.
    """

    plant: Plant
    parameters: dict[str, Estimated]
    undetermined: dict[str, str]
    balances: tuple[BalanceFit, ...]
    method: str

    def __getitem__(self, name: str) -> float:
        """Estimated value in SI units. Raises InputError for one that was not determined."""
        if name in self.parameters:
            return self.parameters[name].value
        raise InputError(f"{name}: {self.undetermined.get(name, 'was not asked for')}")

    def to_pandas(self) -> pandas.DataFrame:
        """One row a parameter: value, sd, unit, believed, balance."""
        import pandas

        rows = [vars(parameter) for parameter in self.parameters.values()]
        table = pandas.DataFrame(rows, columns=["name", "value", "sd", "unit", "nominal", "balance"])
        return table.rename(columns={"nominal": "believed"}).set_index("name")

    def __str__(self) -> str:
        lines = [f"{self.plant.name} ({self.plant.model}) from its balances, {self.method}"]
        for p in self.parameters.values():
            lines.append(f"  {p.name:<8} {p.value:>12.5g} +- {p.sd:<9.2g} {p.unit:<12} believed {p.nominal:.5g}")
        lines += [f"  {name:<8} not determined: {why}" for name, why in self.undetermined.items()]
        for fit in self.balances:
            lines.append(
                f"  {fit.name}: residual {fit.rms:.3g} {fit.unit}, {100 * fit.relative_error:.2f} % "
                f"of its leading term, {fit.rows} rows"
            )
        return "\n".join(lines)

    __repr__ = __str__


def estimate_by_balances(
    plant: Plant,
    logs: Log | Sequence[Log],
    wanted: Sequence[str] | None = None,
    *,
    method: Method = "weak",
    width: float | None = None,
    cutoff: float = 100.0,
    parallel: float | None = None,
) -> BalanceEstimate:
    """Estimate parameters of a plant from its balances.

    Parameters
    ----------
    logs: one or more records, channels in SI units.
    wanted: symbols to estimate; the plant's free ones by default. All others are taken as known.
    method: "weak" or "filtered", see above.
    width: s, length of a bump ("weak"); 12 samples by default. Longer bumps look at slower motion.
    cutoff: Hz, of the position's filter ("filtered").
    parallel: Hz, of the low-pass on both sides ("filtered"); None: neither filtered nor thinned out.

    Raises
    ------
    InputError: a symbol that the plant does not have, a system without balances, a log too short, or a width or
        frequency that does not fit the sample time.
    """
    logs = (logs,) if isinstance(logs, Log) else tuple(logs)
    equations = plant.structure.equations
    system = plant.structure.system
    names = tuple(plant.free if wanted is None else wanted)
    for name in names:
        if name not in equations.parameter_names:
            raise InputError(f"{plant.name} has no parameter {name!r}; {choices(name, equations.parameter_names)}")
    if method not in ("weak", "filtered"):
        raise InputError(f"method = {method!r}; {choices(method, ('weak', 'filtered'))}")
    kinds = {kind.name: kind for kind in equations.parameters}
    records = [(measure(plant, log, method, cutoff), _operator(log, method, width, parallel)) for log in logs]
    found: dict[str, Estimated] = {}
    fits: list[BalanceFit] = []
    chosen: set[str] = set()
    undetermined = dict.fromkeys(names, "stands in no balance of what was measured")
    current = plant
    for balance, residuals in zip(system.balances, equations.residuals, strict=True):
        if any(balance.without in log.channels for log in logs):
            continue
        left = [name for name in names if name not in found and name not in chosen]
        free = [name for name in left if name in needs(equations, *residuals)]
        bent = _bent(current, residuals, free, [measured.values for measured, _ in records])
        undetermined |= dict.fromkeys(bent, f"the {balance.name} balance is not linear in it")
        free = [name for name in free if name not in bent]
        if not free:
            continue
        rows = [_rows(current, balance, residuals, free, measured, operator) for measured, operator in records]
        used = [row for row in rows if row is not None]
        if not used:
            continue
        X, y, terms, lags = (
            np.concatenate([row.columns for row in used]),
            np.concatenate([row.constant for row in used]),
            np.concatenate([row.term for row in used]),
            max(row.lags for row in used),
        )
        held = np.array([current[name] for name in free], dtype=float)
        values, sd, reasons = _solve(X, y, held, [kinds[name] for name in free], terms, lags)
        for name, value, spread, reason in zip(free, values, sd, reasons, strict=True):
            if reason:
                undetermined[name] = f"{reason} ({balance.name})"
                # Others stand on its believed value now, so that it can't become another one in a later balance.
                chosen |= {name} if reason == RATIO else set()
                continue
            undetermined.pop(name, None)
            found[name] = Estimated(name, value, spread, kinds[name].unit, plant[name], balance.name)
        current = current.set(**{name: found[name].value for name in free if name in found})
        residual = y + X @ values
        rms = float(np.sqrt(np.mean(residual**2)))
        size = float(np.sqrt(np.mean(terms**2)))
        fits.append(BalanceFit(balance.name, balance.unit, y.size, rms, rms / size if size > 0.0 else np.inf))
    words = (
        "weak form"
        if method == "weak"
        else f"position filtered at {cutoff:g} Hz, both sides at "
        + ("no frequency" if parallel is None else f"{parallel:g} Hz")
    )
    ordered = {name: found[name] for name in names if name in found}
    return BalanceEstimate(current, ordered, undetermined, tuple(fits), words)


def first_estimate(plant: Plant, logs: Log | Sequence[Log], free: Sequence[str]) -> dict[str, float]:
    """Where a fit of the simulation may begin: those of the `free` symbols that the balances determine, SI units.

    Names that are no symbols of the plant (bias.p1 ...) are left out, as are values outside the bounds in its file.
    """
    symbols = [name for name in free if name in plant.structure.equations.parameter_names]
    if not plant.structure.system.balances or not symbols:
        return {}
    estimate = estimate_by_balances(plant, logs, symbols)
    return {
        name: found.value
        for name, found in estimate.parameters.items()
        if plant.parameters[name].lower <= found.value <= plant.parameters[name].upper
    }


@dataclass(frozen=True)
class _Operator:
    """What both sides of a balance go through: (values (N, k), usable (N,)) -> rows; `lags`: rows that overlap."""

    weights: np.ndarray | None
    sos: np.ndarray | None
    stride: int
    lags: int

    def __call__(self, values: np.ndarray, usable: np.ndarray) -> np.ndarray:
        if self.weights is not None:
            windows = np.lib.stride_tricks.sliding_window_view
            fine = windows(usable, self.weights.size)[:: self.stride].all(axis=1)
            return np.asarray(windows(values, self.weights.size, axis=0)[:: self.stride][fine] @ self.weights)
        if self.sos is not None:
            values = sosfiltfilt(self.sos, values, axis=0)
        return np.asarray(values[:: self.stride][usable[:: self.stride]])


def _operator(log: Log, method: Method, width: float | None, parallel: float | None) -> _Operator:
    dt = log.sample_time
    if method == "weak":
        samples = BUMP if width is None else int(round(width / dt))
        if not 3 <= samples <= len(log) // 4:
            raise InputError(
                f"{log.path or 'the log'}: bumps of {samples} samples do not fit a log of {len(log)} samples; expected "
                "at least 3 samples and at most a quarter of the log"
            )
        weights = np.sin(np.pi * (np.arange(samples) + 0.5) / samples) ** 2
        stride = max(samples * STRIDE // BUMP, 1)
        return _Operator(weights / weights.sum(), None, stride, samples // stride)
    if parallel is None:
        return _Operator(None, None, 1, 10)
    if not 0.0 < parallel < 0.5 / dt:
        raise InputError(f"parallel = {parallel:g} Hz; expected more than 0 and less than {0.5 / dt:g} Hz")
    # Thinned out to a sampling frequency of 2.5 times the low-pass, beyond which rows would repeat each other.
    stride = max(int(round(0.4 / (parallel * dt))), 1)
    return _Operator(None, butter(4, parallel, fs=1.0 / dt, output="sos"), stride, 2)


@dataclass(frozen=True)
class _Rows:
    """A balance as constant (n,) + columns (n, k) values = residual, the size of its term (n,), rows that overlap."""

    constant: np.ndarray
    columns: np.ndarray
    term: np.ndarray
    lags: int


def _rows(
    plant: Plant, balance: Balance, residuals: Sequence[str], free: Sequence[str], data: Measured, operator: _Operator
) -> _Rows | None:
    """The balance on one record; None where it asks for something that was not measured."""
    equations = plant.structure.equations
    known = {**plant.values, **data.values}
    extra = tuple(dict.fromkeys((*balance.terms, *balance.closed)))
    asked = needs(equations, *residuals, *extra)
    if not asked <= set(known):
        return None
    samples = data.values[next(iter(data.values))].size
    usable = np.ones(samples, dtype=bool)
    usable[:3] = usable[-3:] = False
    for contact in plant.structure.system.all_contacts:
        if contact.name in balance.contacts and plant.structure.law(contact).sticks:
            usable &= data.slides[contact.name]
    evaluate = array_evaluator(equations, (*residuals, *extra))
    nominal = evaluate(known)
    base = evaluate({**known, **dict.fromkeys(free, 0.0)})
    columns = []
    for name in free:
        one = evaluate({**known, **dict.fromkeys(free, 0.0), name: 1.0})
        columns.append([one[residual] - base[residual] for residual in residuals])
    parts = []
    for number, (residual, term) in enumerate(zip(residuals, balance.terms, strict=True)):
        size = nominal[term]
        shut = usable & (nominal[balance.closed[number]] == 0.0) if balance.closed else usable
        table = np.column_stack(
            [np.broadcast_to(v, samples) for v in (base[residual], size, *(column[number] for column in columns))]
        )
        parts.append(operator(table, shut))
    table = np.concatenate(parts)
    if table.shape[0] <= len(free) + 2:
        return None
    return _Rows(table[:, 0], table[:, 2:], table[:, 1], operator.lags)


def _bent(plant: Plant, residuals: Sequence[str], free: Sequence[str], data: Sequence[dict[str, Any]]) -> list[str]:
    """Those of `free` in which a residual is not linear: a bulk modulus, a Stribeck speed."""
    equations = plant.structure.equations
    evaluate = array_evaluator(equations, tuple(residuals))
    found = []
    for values in data:
        if not needs(equations, *residuals) <= {*plant.values, *values}:
            continue
        known = {**plant.values, **values}
        for name in free:
            with np.errstate(all="ignore"):
                zero, one, two = (evaluate({**known, name: value}) for value in (0.0, 1.0, 2.0))
                for residual in residuals:
                    first, second = one[residual] - zero[residual], two[residual] - one[residual]
                    straight = np.isfinite(first).all() and np.isfinite(second).all()
                    straight = straight and np.allclose(first, second, 1e-6, 1e-9 * float(np.max(np.abs(first))))
                    if not straight and name not in found:
                        found.append(name)
    return found


def _solve(
    X: np.ndarray, y: np.ndarray, held: np.ndarray, kinds: Sequence[ParameterKind], term: np.ndarray, lags: int
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Least squares of y + X values = 0, parameter by parameter given up where the rows don't determine it.

    Returns values (k,), `held` where given up, their standard deviations (k,), and the reasons for giving up.
    """
    values, sd = held.copy(), np.full(held.size, np.nan)
    reasons = [""] * held.size
    size = np.sqrt(np.mean(X**2, axis=0)) if held.size else np.zeros(0)
    level = float(np.sqrt(np.mean(term**2)))
    while True:
        kept = [i for i in range(held.size) if not reasons[i]]
        if not kept:
            return values, sd, reasons
        fixed = y + X[:, [i for i in range(held.size) if reasons[i]]] @ values[[bool(r) for r in reasons]]
        silent = [i for i in kept if size[i] * max(abs(held[i]), 1e-300) == 0.0]
        if silent:
            reasons[silent[0]] = "has no effect in these records"
            continue
        if np.sqrt(np.mean(fixed**2)) < 1e-9 * max(level, 1e-300):
            # Everything known is zero: only ratios are determined, so the largest term is taken as known.
            largest = max(kept, key=lambda i: size[i] * abs(held[i]))
            reasons[largest] = RATIO
            continue
        scale = size[kept]
        found, spread = _least_squares(X[:, kept] / scale, -fixed, lags)
        values[kept], sd[kept] = found / scale, spread / scale
        vagueness = {}
        for i in kept:
            natural = abs(values[i]) if kinds[i].lower >= 0.0 else level / size[i]
            vagueness[i] = sd[i] / max(natural, 1e-300)
            if not kinds[i].lower <= values[i] <= kinds[i].upper or (kinds[i].lower_open and values[i] <= 0.0):
                vagueness[i] = np.inf
        worst = max(vagueness, key=lambda i: vagueness[i])
        if vagueness[worst] <= VAGUE:
            return values, sd, reasons
        reasons[worst] = (
            f"{values[worst]:.3g} {kinds[worst].unit} would be impossible"
            if vagueness[worst] == np.inf
            else f"known to {100 * vagueness[worst]:.0f} % only"
        )
        values[worst], sd[worst] = held[worst], np.nan


def _least_squares(X: np.ndarray, y: np.ndarray, lags: int) -> tuple[np.ndarray, np.ndarray]:
    """Solution (k,) and its standard deviations (k,), for residuals that are correlated over some rows."""
    inverse = np.linalg.pinv(X.T @ X, hermitian=True)
    solution: np.ndarray = np.linalg.lstsq(X, y, rcond=None)[0]
    scores = X * (y - X @ solution)[:, None]
    middle = scores.T @ scores
    reach = max(2 * lags, int(np.ceil(4.0 * (y.size / 100.0) ** (2.0 / 9.0))))
    for lag in range(1, min(reach, y.size - 1) + 1):
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (reach + 1.0)) * (cross + cross.T)
    covariance: Any = inverse @ middle @ inverse
    return solution, np.sqrt(np.maximum(np.diag(covariance), 0.0))
