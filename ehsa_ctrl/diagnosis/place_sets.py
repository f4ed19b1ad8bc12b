"""How much of the gap each set of places closes when its unknown inputs are injected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.log import Log
from ..identification.initial_state import find_initial_state
from ..identification.logged_inputs import acting_drive, logged_inputs, undo_sensor
from ..plant.plant import Plant
from .injection import GapMeasure, Injection, SquaredGaps, simulate_injections
from .regimes import Curve, CurveKey, curves_of
from .regressors import DRIVE_FAMILIES, MEMORYLESS, balance_contact, pressure_difference
from .unknown_inputs import (
    BalanceSignals,
    UnknownInputs,
    balance_signals,
    declared_unknown_inputs,
    fill_nan,
    smooth,
    unknown_inputs,
)

# The thresholds below are engineering judgement.

#: Penalties as shares of the nominal plant's squared gap: an unknown input as it is, a curve, each parameter of a
#: curve. A place is added only if it closes more than its penalty.
FREE_PENALTY, CURVE_PENALTY, PARAMETER_PENALTY = 0.08, 0.025, 0.0005
#: A static curve of the current is attributed to the drive only if its unexplained variance is less than this ratio of
#: that of the best other curve: a torque constant or friction can produce nearly the same curve.
MAX_LEFT_RATIO = 0.75
#: Families of flow curves that an error of the pump's displacement can produce.
PUMPED = ("linear", "speed", "pumped")
#: Samples of the window that smooths an unknown input: 48 ms at 250 Hz, longer than the filters of `balance_signals`.
SMOOTHING = 12
#: In sets of several places a curve replaces the unknown input if it explains this share of its variance.
MIN_EXPLAINED = 0.85
#: A second shaft place is combined with flows only if a set with it costs less than this.
SECOND_SHAFT_COST = 0.15

Places = frozenset[str]


@dataclass(frozen=True)
class Form:
    """One form of a place's unknown inputs: what is injected, its penalty, its curves (none for the raw signals)."""

    inputs: Injection
    penalty: float
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class PlaceSet:
    """A simulation with a set of places injected.

    squared_gap: (signals,) what is left. cost: its share of the nominal squared gap plus the penalties. forms: place ->
    form. run: channel -> (N,).
    """

    squared_gap: SquaredGaps
    cost: float
    forms: Mapping[str, Form]
    run: Mapping[str, np.ndarray] = field(repr=False)


@dataclass(frozen=True)
class InjectionCase:
    """A nominal plant, a log, and the unknown inputs between them.

    current, second_input: (N,) inputs of the system. start: (n,) initial state. curves: unknown input -> fitted curves,
    the best first.
    """

    plant: Plant
    log: Log
    current: np.ndarray
    second_input: np.ndarray | None
    start: np.ndarray
    gap: GapMeasure
    signals: BalanceSignals
    unknown: UnknownInputs
    curves: Mapping[str, Sequence[Curve]]

    @classmethod
    def of(cls, plant: Plant, log: Log, noise: Mapping[str, float]) -> InjectionCase:
        """Evaluate the balances of a plant on a log; without curves."""
        system, start = plant.structure.system, find_initial_state(plant, log).state
        logged_drive, second_input = logged_inputs(plant, log)
        plant, current = acting_drive(plant, logged_drive, log.sample_time)
        signals = balance_signals(plant, log, current, noise, start, second_input)
        gap = GapMeasure.of(system, undo_sensors(plant, log), noise, log.sample_time)
        return cls(plant, log, current, second_input, start, gap, signals, unknown_inputs(plant, signals), {})

    def with_log(self, log: Log, noise: Mapping[str, float]) -> InjectionCase:
        """The same inputs and start with the balances of another log, for example with a sensor error corrected."""
        signals = balance_signals(self.plant, log, self.current, noise, self.start, self.second_input)
        gap = self.gap.with_measured(undo_sensors(self.plant, log))
        return replace(self, log=log, gap=gap, signals=signals, unknown=unknown_inputs(self.plant, signals))

    def with_curves(self) -> InjectionCase:
        """With curves fitted to the residuals of the balances."""
        found = {name: curves_of(self.plant, self.signals, name, w) for name, w in self.unknown.values.items()}
        return replace(self, curves=found)

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Unknown inputs that can cause a gap but that the log does not show."""
        system = self.plant.structure.system
        return tuple(n for n in declared_unknown_inputs(system) if n in system.entries and n not in self.unknown.values)

    def smoothed(self, name: str) -> np.ndarray:
        """An unknown input (N - 1,), smoothed over SMOOTHING samples."""
        return smooth(self.unknown.values[name], SMOOTHING)

    def run(self, injections: Sequence[Injection]) -> list[dict[str, np.ndarray]]:
        """Channel -> (N,) for each injection."""
        return simulate_injections(
            self.plant, self.current, self.start, self.log.sample_time, injections, self.unknown.capacity,
            second_input=self.second_input,
        )  # fmt: skip

    def inject(self, rows: Sequence[Mapping[str, Form]]) -> list[PlaceSet]:
        """Simulate sets of places; each row maps the places of a set to their forms."""
        merged = [{n: v for form in row.values() for n, v in form.inputs.items()} for row in rows]
        found = []
        for row, run in zip(rows, self.run(merged), strict=True):
            squared_gap = self.gap.squared_gap(run)
            found.append(
                PlaceSet(squared_gap, self.gap.share(squared_gap) + sum(f.penalty for f in row.values()), row, run)
            )
        return found


def undo_sensors(plant: Plant, log: Log) -> dict[str, np.ndarray]:
    """The outputs (N,) of the system that the log shows, without the errors of their sensors."""
    return {c: undo_sensor(plant, log, c) for c in plant.structure.system.outputs if c in log.channels}


def evaluate_sets(case: InjectionCase) -> tuple[dict[Places, PlaceSet], dict[CurveKey, float]]:
    """The cheapest form of every set of places (torque or drive, flow, force), and the share that each curve closes.

    The forms of shaft and force are compared alone first, then together, then with the forms of the flows.
    """
    forms = forms_by_place(case)
    tried = {place: case.inject([{place: form} for form in options]) for place, options in forms.items()}
    chosen = {
        place: forms[place][int(np.argmin([one.cost for one in results]))]
        for place, results in tried.items()
        if results
    }
    shafts = [place for place in ("torque", "drive") if place in chosen]
    # The form that closes most alone may compensate for another place, so that in a set of several places the form that
    # fits the balance best is tried too.
    fitting = {place: _best_fit(forms[place]) for place in chosen}
    sets = [*((s,) for s in shafts), *((s, "force") for s in shafts), ("force",)]
    sets = [places for places in sets if set(places) <= set(chosen)]
    results = case.inject([{place: by[place] for place in places} for places in sets for by in (chosen, fitting)])
    found = _cheapest(results)
    # Of torque and drive, the one that is better without flows is combined with flows.
    shafts.sort(key=lambda place: min(one.cost for places, one in found.items() if place in places))
    heads = [Places(), *(p for p in found if not p & set(shafts[1:]))]
    if len(shafts) > 1:
        heads += [p for p in found if shafts[1] in p and found[p].cost < SECOND_SHAFT_COST and p not in heads]
    flows, with_flow = flow_forms(case), []
    for head in heads:
        others = [{place: fitting[place] for place in forms if place in head}]
        if head == {"force"} and fitting["force"] is not chosen["force"]:
            others.append({"force": chosen["force"]})
        usable = [flow for flow in flows if "torque" not in flow.inputs or not head & {"torque", "drive"}]
        with_flow += [{**other, "flow": flow} for other in others for flow in usable]
    more = case.inject(with_flow)
    closed: dict[CurveKey, float] = {}
    for one in [*(one for results_of_place in tried.values() for one in results_of_place), *results, *more]:
        if len(one.forms) == 1:
            (form,) = one.forms.values()
            closed |= {curve.key: 1.0 - case.gap.share(one.squared_gap) for curve in form.curves}
    return found | _cheapest(more), closed


def forms_by_place(case: InjectionCase) -> dict[str, list[Form]]:
    """The forms of the unknown torque, with the drive's error as a separate place, and of the unknown force."""
    places = case.plant.structure.system.places
    torque, force = case.curves.get("torque", ()), case.curves.get("force", ())
    forms = {
        "torque": _forms(case, "torque", [c for c in torque if c.family not in DRIVE_FAMILIES], free=True),
        "drive": _forms(case, "torque", _drive_curves(torque), free=False),
        "force": _forms(case, "force", force, free=True),
    }
    return {place: options if place in places else [] for place, options in forms.items()}


def _cheapest(results: Sequence[PlaceSet]) -> dict[Places, PlaceSet]:
    found: dict[Places, PlaceSet] = {}
    for one in results:
        places = Places(one.forms)
        if places not in found or one.cost < found[places].cost:
            found[places] = one
    return found


def _drive_curves(curves: Sequence[Curve]) -> list[Curve]:
    """Curves of a drive error; static ones, which a torque of the shaft can produce too, only if they explain more."""
    bar = max((c.explained for c in curves if c.family not in DRIVE_FAMILIES), default=0.0)
    return [
        c
        for c in curves
        if c.family in DRIVE_FAMILIES
        and (c.family not in MEMORYLESS or 1.0 - c.explained < MAX_LEFT_RATIO * (1.0 - bar))
    ]


def _forms(case: InjectionCase, name: str, curves: Sequence[Curve], *, free: bool, count: int = 5) -> list[Form]:
    """The best curves of an unknown input; with `free` also the unknown input itself, raw and smoothed."""
    values = case.unknown.values.get(name)
    if values is None:
        return []
    found = [Form({name: curve.values}, _penalty(curve), (curve,)) for curve in curves[:count]]
    if free:
        found += [Form({name: fill_nan(w)}, FREE_PENALTY) for w in (values, smooth(values, SMOOTHING))]
    return found


def flow_forms(case: InjectionCase) -> list[Form]:
    """Forms of both flows: raw, smoothed, and pairs of curves of the same family."""
    system = case.plant.structure.system
    flows = {name: case.unknown.values[name] for name in system.places.get("flow", ()) if name in case.unknown.values}
    if len(flows) < 2:
        return []
    found = [
        Form({n: fill_nan(w) for n, w in flows.items()}, FREE_PENALTY),
        Form({n: fill_nan(smooth(w, SMOOTHING)) for n, w in flows.items()}, FREE_PENALTY),
    ]
    second = {(c.family, c.against.replace("chamber 2", "chamber 1")): c for c in case.curves["flow_2"]}
    pairs = [(one, two) for one in case.curves["flow_1"] if (two := second.get((one.family, one.against))) is not None]
    pairs.sort(key=lambda pair: -(pair[0].explained + pair[1].explained))
    for one, two in pairs[:3]:
        found.append(Form({"flow_1": one.values, "flow_2": two.values}, _penalty(one), (one, two)))
    pumped = [(one, two) for one, two in pairs if one.family in PUMPED and "shaft" in one.against]
    for one, two in pumped[:2]:
        # An error of the displacement also changes the torque that the pump takes from the shaft, by D dP.
        shaft = balance_contact(case.plant, "torque")
        omega, dP = case.signals[shaft.velocity][:-1], pressure_difference(case.plant, case.signals)
        flow = 0.5 * (one.values - two.values)
        turns = np.abs(omega) > 1.0
        lost = np.where(turns, flow / np.where(turns, omega, 1.0), 0.0)
        found.append(Form({"flow_1": flow, "flow_2": -flow, "torque": -lost * dP}, _penalty(one), (one, two)))
    return found


def _best_fit(forms: Sequence[Form]) -> Form:
    """The curve that explains most of an unknown input, or the smoothed input if no curve explains MIN_EXPLAINED."""
    curves = [form for form in forms if form.curves]
    if curves and (len(curves) == len(forms) or curves[0].curves[0].explained > MIN_EXPLAINED):
        return curves[0]
    return forms[-1]


def _penalty(curve: Curve) -> float:
    return CURVE_PENALTY + PARAMETER_PENALTY * curve.numbers
