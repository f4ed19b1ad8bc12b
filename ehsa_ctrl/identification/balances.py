"""Parameters from balances (inverse dynamics): least squares on measured signals, without a simulation.

Torque, flow and force balances are sums that are zero for the true plant, linear in most parameters. Two methods avoid
differentiating noise:

"weak": each balance is multiplied by short test functions and summed. Summation by parts moves the derivative from the
noisy signal to the test function; here the same sums are formed from central differences.

"filtered": the position is filtered without phase shift and differentiated, then both sides of the balance go through
the same low-pass and are decimated to its bandwidth. M. Gautier, "Dynamic identification of robots with power model",
IEEE ICRA 1997, calls it parallel filtering; the EMPS benchmark was identified that way.

Standard deviations allow for correlated residuals: W. K. Newey, K. D. West, "A simple, positive semi-definite,
heteroskedasticity and autocorrelation consistent covariance matrix", Econometrica 55, 1987. They do not cover the bias
from noise in the regressors, nor errors of parameters taken as known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..core.errors import InputError, choices
from ..core.log import Log
from ..core.result import Result, as_table
from ..plant.arrays import array_evaluator, needs
from ..plant.plant import Plant
from ..plant.system import Balance
from .balance_regression import RATIO, RowFilter, row_filter, solve_balance
from .balance_signals import MeasuredSignals, Method, balance_signals

if TYPE_CHECKING:
    import pandas

#: Most iterations where a balance contains products of parameters, and the change of the residual, as a share of the
#: balance's term, below which they have converged.
ITERATIONS, CONVERGED = 30, 1e-8


@dataclass(frozen=True)
class BalanceParameter:
    """One parameter: value and standard deviation in SI units, nominal value, and the balance that determined it."""

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


@dataclass(frozen=True, repr=False)
class BalanceEstimate(Result):
    """Parameters from the balances of a system.

    Attributes
    ----------
    plant: with the estimated values.
    parameters: name -> determined parameter.
    undetermined: name -> reason.
    balances: in the order in which they were solved.
    method: in words.
    """

    plant: Plant
    parameters: dict[str, BalanceParameter]
    undetermined: dict[str, str]
    balances: tuple[BalanceFit, ...]
    method: str

    def __getitem__(self, name: str) -> float:
        """Estimated value in SI units. Raises InputError for one that was not determined."""
        if name in self.parameters:
            return self.parameters[name].value
        raise InputError(f"{name}: {self.undetermined.get(name, 'was not asked for')}")

    def to_pandas(self) -> pandas.DataFrame:
        """One row a parameter: value, sd, unit, believed (the nominal value), balance."""
        names = "value sd unit believed balance"
        return as_table(self.parameters.values(), names, believed=lambda p: p.nominal)

    def __str__(self) -> str:
        lines = [f"{self.plant.name} ({self.plant.model}) from its balances, {self.method}"]
        for p in self.parameters.values():
            lines.append(f"  {p.name:<8} {p.value:>12.5g} +- {p.sd:<9.2g} {p.unit:<12} nominal {p.nominal:.5g}")
        lines += [f"  {name:<8} not determined: {why}" for name, why in self.undetermined.items()]
        for fit in self.balances:
            lines.append(
                f"  {fit.name}: residual {fit.rms:.3g} {fit.unit}, {100 * fit.relative_error:.2f} % "
                f"of its leading term, {fit.rows} rows"
            )
        return "\n".join(lines)


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
    """Estimate parameters of a plant from its balances, which are solved one after the other.

    Parameters
    ----------
    logs: one or more records, channels in SI units.
    wanted: symbols to estimate; the plant's free ones by default. All others are taken as known.
    method: "weak" or "filtered", see above.
    width: s, length of a test function ("weak"); 12 samples by default. Longer ones weight slower motion.
    cutoff: Hz, of the position's filter ("filtered").
    parallel: Hz, of the low-pass on both sides ("filtered"); None: neither filtered nor decimated.

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
    records = [(balance_signals(plant, log, method, cutoff), row_filter(log, method, width, parallel)) for log in logs]
    found: dict[str, BalanceParameter] = {}
    fits: list[BalanceFit] = []
    # Parameters taken as known in a ratio: others depend on their nominal value, so that no later balance may move it.
    fixed: set[str] = set()
    undetermined = dict.fromkeys(names, "is in no balance of the measured signals")
    current = plant
    for balance, residuals in zip(system.balances, equations.residuals, strict=True):
        if any(balance.without in log.channels for log in logs):
            continue
        free = [n for n in names if n not in found and n not in fixed and n in needs(equations, *residuals)]
        nonlinear = _nonlinear(current, residuals, free, [signals.values for signals, _ in records])
        undetermined |= dict.fromkeys(nonlinear, f"the {balance.name} balance is not linear in it")
        free = [name for name in free if name not in nonlinear]
        if not free:
            continue
        nominal = np.array([current[name] for name in free], dtype=float)
        values = nominal
        for _ in range(ITERATIONS):
            # Linear in each parameter, but not in products such as A_FR a_FR: linearised at the last values.
            at = current.set(**dict(zip(free, values.tolist(), strict=True)))
            rows = [_rows(at, balance, residuals, free, signals, operator) for signals, operator in records]
            used = [row for row in rows if row is not None]
            if not used:
                break
            X, y, terms = (np.concatenate(parts) for parts in zip(*used, strict=True))
            lags = max(operator.lags for row, (_, operator) in zip(rows, records, strict=True) if row is not None)
            last = values
            values, sd, reasons = solve_balance(X, y, nominal, [kinds[name] for name in free], terms, lags)
            if np.allclose(X @ (values - last), 0.0, atol=CONVERGED * float(np.sqrt(np.mean(terms**2)))):
                break
        if not used:
            continue
        for name, value, spread, reason in zip(free, values, sd, reasons, strict=True):
            if reason:
                undetermined[name] = f"{reason} ({balance.name})"
                fixed |= {name} if reason == RATIO else set()
                continue
            undetermined.pop(name, None)
            found[name] = BalanceParameter(name, value, spread, kinds[name].unit, plant[name], balance.name)
        current = current.set(**{name: found[name].value for name in free if name in found})
        rms = float(np.sqrt(np.mean((y + X @ values) ** 2)))
        size = float(np.sqrt(np.mean(terms**2)))
        fits.append(BalanceFit(balance.name, balance.unit, y.size, rms, rms / size if size > 0.0 else np.inf))
    words = "weak form"
    if method == "filtered":
        both_sides = "no frequency" if parallel is None else f"{parallel:g} Hz"
        words = f"position filtered at {cutoff:g} Hz, both sides at {both_sides}"
    ordered = {name: found[name] for name in names if name in found}
    return BalanceEstimate(current, ordered, undetermined, tuple(fits), words)


def first_estimate(plant: Plant, logs: Log | Sequence[Log], free: Sequence[str]) -> dict[str, float]:
    """Start values of a simulation fit: those of the `free` symbols that the balances determine, SI units.

    Numbers of sensors (bias.p1 ...) and values outside the bounds in the plant's file are left out.
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


def _rows(
    plant: Plant,
    balance: Balance,
    residuals: Sequence[str],
    free: Sequence[str],
    signals: MeasuredSignals,
    operator: RowFilter,
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """A balance on one record: X (n, k), y (n,) with residual = y + X values, and the size of its term (n,).

    Exact if the balance is linear in all of `free` together, else linearised at the plant's values. None where it needs
    a signal that was not measured.
    """
    equations = plant.structure.equations
    known = {**plant.values, **signals.values}
    extra = tuple(dict.fromkeys((*balance.terms, *balance.closed)))
    if not needs(equations, *residuals, *extra) <= set(known):
        return None
    samples = signals.values[next(iter(signals.values))].size
    usable = np.ones(samples, dtype=bool)
    usable[:3] = usable[-3:] = False
    for contact in plant.structure.system.all_contacts:
        if contact.name in balance.contacts and plant.structure.law(contact).sticks:
            usable &= signals.slides[contact.name]
    evaluate = array_evaluator(equations, (*residuals, *extra))
    nominal = evaluate(known)
    by_parameter = [[evaluate({**known, name: value}) for value in (0.0, 1.0)] for name in free]
    parts = []
    for number, (residual, term) in enumerate(zip(residuals, balance.terms, strict=True)):
        rows = usable & (nominal[balance.closed[number]] == 0.0) if balance.closed else usable
        slopes = [one[residual] - zero[residual] for zero, one in by_parameter]
        constant = nominal[residual] - sum(slope * plant[name] for slope, name in zip(slopes, free, strict=True))
        columns = [constant, nominal[term], *slopes]
        parts.append(operator(np.column_stack([np.broadcast_to(column, samples) for column in columns]), rows))
    table = np.concatenate(parts)
    return (table[:, 2:], table[:, 0], table[:, 1]) if table.shape[0] > len(free) + 2 else None


def _nonlinear(
    plant: Plant, residuals: Sequence[str], free: Sequence[str], data: Sequence[Mapping[str, np.ndarray]]
) -> list[str]:
    """Those of `free` in which a residual is not linear: a bulk modulus, a Stribeck speed."""
    equations = plant.structure.equations
    evaluate = array_evaluator(equations, tuple(residuals))
    found: list[str] = []
    for values in data:
        known = {**plant.values, **values}
        if not needs(equations, *residuals) <= set(known):
            continue
        for name in free:
            with np.errstate(all="ignore"):
                zero, one, two = (evaluate({**known, name: value}) for value in (0.0, 1.0, 2.0))
                for residual in residuals:
                    first, second = one[residual] - zero[residual], two[residual] - one[residual]
                    finite = np.isfinite(first).all() and np.isfinite(second).all()
                    linear = finite and np.allclose(first, second, 1e-6, 1e-9 * float(np.max(np.abs(first))))
                    if not linear and name not in found:
                        found.append(name)
    return found
