"""The unknown inputs that a law may explain: those of single balances, and those of both chambers together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...physics.effects import ADDENDS
from ..objective import STEP, NominalParameters
from ..place_sets import InjectionCase
from ..regimes import MIN_WINDOWS, Windows
from ..unknown_inputs import BalanceSignals, unknown_inputs
from .grammar import Grammar, in_turn
from .held import held_laws
from .law_fit import LawFit
from .valves import valve_laws

#: Unknown inputs that a chamber integrates, which are averaged over windows this much longer too: a leakage too small
#: to see beside errors of the rates moves the mean pressure by and by.
FLOWS, SLOW = ("flow_1", "flow_2", "flows", "pump_flow", "displacement"), 8


@dataclass(frozen=True)
class LawInput:
    """An unknown input on the joined logs. nuisance: (windows, p), see `SumTarget`.

    held, valves: laws that its values do not show, see `held_laws` and `valve_laws`.
    """

    grammar: Grammar
    windows: Windows
    nuisance: np.ndarray
    held: tuple[LawFit, ...] = ()
    valves: tuple[LawFit, ...] = ()

    @property
    def name(self) -> str:
        return self.grammar.name


def law_inputs(
    cases: Sequence[InjectionCase],
    signals: BalanceSignals,
    values: Mapping[str, np.ndarray],
    fitted: np.ndarray,
    nominal: NominalParameters,
) -> list[LawInput]:
    """The unknown inputs that the logs show, with those of several balances beside.

    signals, values, fitted: as of `joined`.
    """
    plant = cases[0].plant
    changes = with_combined(_changes(cases, nominal))
    # A law acts where its balance enters the simulation: where the motion is prescribed, forces do not.
    acting = ADDENDS.keys() & plant.structure.system.entries.keys()
    signals_of_plant = {call.target for call in plant.structure.equations.calls}
    found = []
    for name, value in with_combined({n: one for n, one in values.items() if n in acting}).items():
        if not set(ADDENDS[name].factors) <= signals_of_plant:
            # A pump whose speed is prescribed has no torque balance.
            continue
        own = in_turn(fitted, fitted, False) if ADDENDS[name].second else fitted
        for longer in (1, SLOW) if name in FLOWS else (1,):
            windows = Windows(value, signals.sample_time, own, longer=longer)
            if windows.values.size >= MIN_WINDOWS and float(windows.values @ windows.values) > 0.0:
                grammar = Grammar.of(plant, signals, name)
                nuisance = windows.of(changes[name])
                if longer > 1:
                    found.append(LawInput(grammar, windows, nuisance))
                    continue
                held = held_laws(plant, signals, grammar, fitted)
                valves = valve_laws(grammar, windows, own)
                found.append(LawInput(grammar, windows, nuisance, tuple(held), tuple(valves)))
    return found


def with_combined(values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Unknown inputs by balance, and what the flows of both chambers are together.

    That is the flow of the pump, from outside it or by its displacement, which one chamber gains and the other loses;
    and the flow into chamber 1, then into chamber 2, with an unknown sample between them.
    """
    found = dict(values)
    if {"flow_1", "flow_2"} <= values.keys():
        one, other = values["flow_1"], values["flow_2"]
        found["pump_flow"] = found["displacement"] = 0.5 * (one - other)
        found["flows"] = in_turn(one, other, np.nan)
    return found


def _changes(cases: Sequence[InjectionCase], nominal: NominalParameters) -> dict[str, np.ndarray]:
    """Unknown input -> (N - 1, p) change by one typical deviation of each nominal parameter, on the joined logs."""
    columns: dict[str, list[np.ndarray]] = {name: [] for name in cases[0].unknown.values}
    for name, typical in zip(nominal.names, nominal.typical, strict=True):
        if not cases[0].plant.values.get(name):
            # Of an effect or a friction law that this plant does not have.
            continue
        parts: dict[str, list[np.ndarray]] = {one: [] for one in columns}
        for case in cases:
            value = case.plant[name]
            other = unknown_inputs(case.plant.set(**{name: (1.0 + STEP) * value}), case.signals)
            for one in columns:
                change = (other.values[one] - case.unknown.values[one]) * (typical / (STEP * value))
                parts[one].append(np.append(np.nan_to_num(change), 0.0))
        for one in columns:
            columns[one].append(np.concatenate(parts[one])[:-1])
    size = {one: sum(case.unknown.values[one].size + 1 for case in cases) - 1 for one in columns}
    return {one: np.column_stack(rows) if rows else np.zeros((size[one], 0)) for one, rows in columns.items()}
