"""How much of the gap each set of places closes when their unknown inputs are injected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.log import Log
from ..plant.plant import Plant
from .injection import Energy, Injection, SquaredGap, simulate_injections
from .regimes import Curve, CurveKey, curves_of
from .regressors import DRIVE, MEMORYLESS, balance_contact, pressure_difference
from .unknown_inputs import (
    BalanceSignals,
    UnknownInputs,
    filled,
    signals_of,
    smooth,
    unknown_inputs,
    unknown_inputs_of,
)

#: Share of the gap that one more place has to explain: an unknown input of any form, a curve, each of its numbers.
FREE_PRICE, CURVE_PRICE, NUMBER_PRICE = 0.08, 0.025, 0.0005
#: A curve along the current belongs to the drive if it leaves less than this share of an unknown torque's variance
#: that the best other curve leaves.
CLEARLY_LESS = 0.75
#: Families of a flow error that the pump's displacement may make.
PUMPED = ("line", "speed", "pumped")
#: Samples of the bump that smooths an unknown input.
BUMP = 12
#: A curve replaces an unknown input beside other places if it explains this part of it.
EXPLAINED = 0.85

Places = frozenset[str]


@dataclass(frozen=True)
class Form:
    """One form of a place's unknown input: injection, the price of its freedom, the curve that it is."""

    inputs: Injection
    price: float
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class PlaceSet:
    """A set of places injected: (signals,) squared gap left, its share plus the price, the forms, the run."""

    energy: Energy
    cost: float
    forms: Mapping[str, Form]
    run: Mapping[str, np.ndarray] = field(repr=False)


@dataclass(frozen=True)
class InjectionCase:
    """A nominal plant, a log, and the unknown inputs between them with the curves that they follow.

    current, outside: (N,) inputs. start: (n,) state. curves: unknown input -> curves, the best explained first.
    """

    plant: Plant
    log: Log
    current: np.ndarray
    outside: np.ndarray | None
    start: np.ndarray
    gap: SquaredGap
    signals: BalanceSignals
    unknown: UnknownInputs
    curves: Mapping[str, Sequence[Curve]]

    @classmethod
    def of(
        cls,
        plant: Plant,
        log: Log,
        current: np.ndarray,
        outside: np.ndarray | None,
        start: np.ndarray,
        noise: Mapping[str, float],
        gap: SquaredGap,
    ) -> InjectionCase:
        """Evaluate the balances and fit curves to what they leave."""
        signals = signals_of(plant, log, current, noise, start, outside)
        unknown = unknown_inputs(plant, signals)
        curves = {name: curves_of(plant, signals, name, w) for name, w in unknown.values.items()}
        return cls(plant, log, current, outside, start, gap, signals, unknown, curves)

    @property
    def silent(self) -> tuple[str, ...]:
        """Unknown inputs that may cause a gap and that the log does not show."""
        system = self.plant.structure.system
        return tuple(n for n in unknown_inputs_of(system) if n in system.entries and n not in self.unknown.values)

    def smoothed(self, name: str) -> np.ndarray:
        """An unknown input (N - 1,) without the noise of single samples."""
        return smooth(self.unknown.values[name], BUMP)

    def run(self, injections: Sequence[Injection]) -> list[dict[str, np.ndarray]]:
        return simulate_injections(
            self.plant, self.current, self.start, self.log.sample_time, injections, self.unknown.capacity,
            outside=self.outside,
        )  # fmt: skip

    def inject(self, rows: Sequence[Mapping[str, Form]]) -> list[PlaceSet]:
        """Simulate sets of places, each in a form."""
        merged = [{n: v for form in row.values() for n, v in form.inputs.items()} for row in rows]
        found = []
        for row, run in zip(rows, self.run(merged), strict=True):
            energy = self.gap.energy(run)
            found.append(PlaceSet(energy, self.gap.share(energy) + sum(f.price for f in row.values()), row, run))
        return found


def evaluate_sets(case: InjectionCase) -> tuple[dict[Places, PlaceSet], dict[CurveKey, float]]:
    """Every set of torque or drive, flow and force in the best form found; the share of the squared gap that each curve
    alone closes."""
    places = case.plant.structure.system.places
    torque, force = case.curves.get("torque", ()), case.curves.get("force", ())
    forms = {
        "torque": _forms(case, "torque", [c for c in torque if c.family not in DRIVE], free=True),
        "drive": _forms(case, "torque", _of_drive(torque), free=False),
        "force": _forms(case, "force", force, free=True),
    }
    forms = {place: options if place in places else [] for place, options in forms.items()}
    tried = {place: case.inject([{place: form} for form in options]) for place, options in forms.items()}
    chosen = {
        place: forms[place][int(np.argmin([one.cost for one in results]))]
        for place, results in tried.items()
        if results
    }
    shafts = [place for place in ("torque", "drive") if place in chosen]
    # The best form alone may do the work of another place; beside others the balance itself has to decide.
    beside = {place: _best_explained(forms[place]) for place in chosen}
    sets = [*((s,) for s in shafts), *((s, "force") for s in shafts), ("force",)]
    sets = [places for places in sets if set(places) <= set(chosen)]
    results = case.inject([{place: by[place] for place in places} for places in sets for by in (chosen, beside)])
    found = _cheapest(results)
    # A shaft's error goes with flows in the form that does better without them.
    shafts.sort(key=lambda place: min(one.cost for places, one in found.items() if place in places))
    heads = [Places(), *(p for p in found if not p & set(shafts[1:]))]
    if len(shafts) > 1:
        heads += [p for p in found if shafts[1] in p and found[p].cost < 0.15 and p not in heads]
    flows, with_flow = _flow_forms(case), []
    for head in heads:
        others = [{place: beside[place] for place in forms if place in head}]
        if head == {"force"} and beside["force"] is not chosen["force"]:
            others.append({"force": chosen["force"]})
        usable = [flow for flow in flows if "torque" not in flow.inputs or not head & {"torque", "drive"}]
        with_flow += [{**other, "flow": flow} for other in others for flow in usable]
    more = case.inject(with_flow)
    closed: dict[CurveKey, float] = {}
    for one in [*(one for results_of_place in tried.values() for one in results_of_place), *results, *more]:
        if len(one.forms) == 1:
            (form,) = one.forms.values()
            closed |= {curve.key: 1.0 - case.gap.share(one.energy) for curve in form.curves}
    return found | _cheapest(more), closed


def _cheapest(results: Sequence[PlaceSet]) -> dict[Places, PlaceSet]:
    found: dict[Places, PlaceSet] = {}
    for one in results:
        places = Places(one.forms)
        if places not in found or one.cost < found[places].cost:
            found[places] = one
    return found


def _of_drive(curves: Sequence[Curve]) -> list[Curve]:
    """Curves of an error of the current; those that a torque of the shaft would follow too must explain more."""
    bar = max((c.explained for c in curves if c.family not in DRIVE), default=0.0)
    return [
        c
        for c in curves
        if c.family in DRIVE and (c.family not in MEMORYLESS or 1.0 - c.explained < CLEARLY_LESS * (1.0 - bar))
    ]


def _forms(case: InjectionCase, name: str, curves: Sequence[Curve], *, free: bool, count: int = 5) -> list[Form]:
    """The curves that explain most of an unknown input, and the input itself, as it is and smoothed."""
    values = case.unknown.values.get(name)
    if values is None:
        return []
    found = [Form({name: curve.values}, _price(curve), (curve,)) for curve in curves[:count]]
    if free:
        found += [Form({name: filled(w)}, FREE_PRICE) for w in (values, smooth(values, BUMP))]
    return found


def _flow_forms(case: InjectionCase) -> list[Form]:
    """Both flows together: as they are, smoothed, and as pairs of curves of one family."""
    system = case.plant.structure.system
    flows = {name: case.unknown.values[name] for name in system.places.get("flow", ()) if name in case.unknown.values}
    if len(flows) < 2:
        return []
    found = [
        Form({n: filled(w) for n, w in flows.items()}, FREE_PRICE),
        Form({n: filled(smooth(w, BUMP)) for n, w in flows.items()}, FREE_PRICE),
    ]
    second = {(c.family, c.against.replace("chamber 2", "chamber 1")): c for c in case.curves["flow_2"]}
    pairs = [(one, two) for one in case.curves["flow_1"] if (two := second.get((one.family, one.against))) is not None]
    pairs.sort(key=lambda pair: -(pair[0].explained + pair[1].explained))
    for one, two in pairs[:3]:
        found.append(Form({"flow_1": one.values, "flow_2": two.values}, _price(one), (one, two)))
    pumped = [(one, two) for one, two in pairs if one.family in PUMPED and "shaft" in one.against]
    for one, two in pumped[:2]:
        # One error of the pump's displacement: what it does not deliver does not load the shaft either.
        shaft = balance_contact(case.plant, "torque")
        omega, dP = case.signals[shaft.velocity][:-1], pressure_difference(case.plant, case.signals)
        flow = 0.5 * (one.values - two.values)
        turns = np.abs(omega) > 1.0
        lost = np.where(turns, flow / np.where(turns, omega, 1.0), 0.0)
        found.append(Form({"flow_1": flow, "flow_2": -flow, "torque": -lost * dP}, _price(one), (one, two)))
    return found


def _best_explained(forms: Sequence[Form]) -> Form:
    """The curve that explains most of an unknown input, or the smoothed input itself where no curve comes near."""
    curves = [form for form in forms if form.curves]
    if curves and (len(curves) == len(forms) or curves[0].curves[0].explained > EXPLAINED):
        return curves[0]
    return forms[-1]


def _price(curve: Curve) -> float:
    return CURVE_PRICE + NUMBER_PRICE * curve.numbers
