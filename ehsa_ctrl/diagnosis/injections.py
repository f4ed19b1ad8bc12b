"""What a log's balances lack, put into simulations: how much of the gap each set of places takes away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.log import Log
from ..plant.plant import Plant
from .bases import DRIVE, MEMORYLESS
from .curves import Curve, curves_of
from .squared_gap import Energy, SquaredGap
from .unknown_input import INPUTS, filled, run_with, signals_of, smooth, unknown_inputs

#: Part of the gap that a further place has to explain, an unknown input of any form and one of few numbers.
FREE_PRICE, CURVE_PRICE, NUMBER_PRICE = 0.08, 0.025, 0.0005
#: A curve along the current counts as the drive's if what it leaves of an unknown torque is less than this part of
#: what the best of the others leaves.
CLEARLY = 0.75
#: Families of a flow error that may be one of the pump's displacement.
PUMPED = ("line", "speed", "pumped")
#: Samples of the bump that smooths an unknown input.
BUMP = 12
#: A curve stands for an unknown input beside others if it explains this part of it.
TOLD = 0.85


@dataclass(frozen=True)
class Form:
    """One form of a place's unknown input: balance -> (N - 1,), what its freedom costs, the curve that it is."""

    inputs: Mapping[str, np.ndarray]
    price: float
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class Trial:
    """A set of places put in: (signals,) squared gap left, that as part of the whole plus its price, forms, the run."""

    energy: Energy
    cost: float
    options: dict[str, Form]
    run: dict[str, np.ndarray]


class Injections:
    """A plant, a log and the unknown inputs between them, with the forms in which these may be put in."""

    def __init__(
        self,
        plant: Plant,
        log: Log,
        current: np.ndarray,
        start: np.ndarray,
        noise: Mapping[str, float],
        gap: SquaredGap,
        outside: np.ndarray | None = None,
    ) -> None:
        self.plant, self.log, self.current, self.start, self.gap = plant, log, current, start, gap
        self.outside = outside
        self.signals = signals_of(plant, log, current, noise, start, outside)
        self.unknown = unknown_inputs(plant, self.signals)
        self.curves = {name: curves_of(plant, self.signals, name, w) for name, w in self.unknown.values.items()}
        self.closed: dict[int, float] = {}
        #: Whether the rod is moved from outside: it moves as it does whatever force that takes.
        self.moved = bool(plant.structure.system.prescribed)

    @property
    def silent(self) -> tuple[str, ...]:
        """Balances that may lie behind a gap and that the log can't tell."""
        return tuple(n for n in INPUTS if n not in self.unknown.values and not (n == "force" and self.moved))

    def run(self, injections: Sequence[Mapping[str, np.ndarray]]) -> list[dict[str, np.ndarray]]:
        return run_with(
            self.plant, self.current, self.start, self.log.sample_time, injections, self.unknown.softness,
            outside=self.outside,
        )  # fmt: skip

    def sets(self) -> dict[frozenset[str], Trial]:
        """What every set of torque or drive, flow and force leaves of the gap, with the best forms found."""
        forms = {
            "torque": self._forms("torque", [c for c in self.curves.get("torque", ()) if c.family not in DRIVE], True),
            "drive": self._forms("torque", self._of_drive(), False),
            "force": [] if self.moved else self._forms("force", self.curves.get("force", ()), True),
        }
        best = {place: self._best(options) for place, options in forms.items() if options}
        chosen = {place: option for place, option in best.items() if option is not None}
        shafts = [place for place in ("torque", "drive") if place in chosen]
        # What does best alone may do the work of another place; beside others the balance itself has to choose.
        beside = {place: _told_best(forms[place]) for place in chosen}
        dry = [frozenset(places) for places in [*((s,) for s in shafts), *((s, "force") for s in shafts), ("force",)]]
        dry = [places for places in dry if places <= set(chosen)]
        found = self._tried([{place: by[place] for place in places} for places in dry for by in (chosen, beside)])
        # A shaft's error goes with flows in the form that does better without them.
        shafts.sort(key=lambda place: min(t.cost for places, t in found.items() if place in places))
        heads = [frozenset(), *(p for p in found if not p & set(shafts[1:]))]
        if len(shafts) > 1:
            worse = [p for p in found if shafts[1] in p and found[p].cost < 0.15]
            heads += [p for p in worse if p not in heads]
        flows = self._flows()
        rows = []
        for head in heads:
            known = [{place: beside[place] for place in head}]
            if head == {"force"} and beside["force"] is not chosen["force"]:
                known.append({"force": chosen["force"]})
            usable = [flow for flow in flows if "torque" not in flow.inputs or not head & {"torque", "drive"}]
            rows += [{**options, "flow": flow} for options in known for flow in usable]
        return found | self._tried(rows)

    def _tried(self, rows: Sequence[dict[str, Form]]) -> dict[frozenset[str], Trial]:
        found: dict[frozenset[str], Trial] = {}
        for row, run in zip(rows, self.run([_merged(row) for row in rows]), strict=True):
            energy, price = self.gap.energy(run), sum(option.price for option in row.values())
            trial = Trial(energy, float(energy.sum()) / self.gap.whole + price, row, run)
            places = frozenset(row)
            for curve in next(iter(row.values())).curves if len(row) == 1 else ():
                self.closed[id(curve)] = 1.0 - float(energy.sum()) / self.gap.whole
            if places not in found or trial.cost < found[places].cost:
                found[places] = trial
        return found

    def _of_drive(self) -> list[Curve]:
        """Curves of an error of the current; those that a torque of the shaft would follow too must explain more."""
        curves = self.curves.get("torque", [])
        bar = max((c.explained for c in curves if c.family not in DRIVE), default=0.0)
        return [
            c
            for c in curves
            if c.family in DRIVE and (c.family not in MEMORYLESS or 1.0 - c.explained < CLEARLY * (1.0 - bar))
        ]

    def _forms(self, balance: str, curves: Sequence[Curve], free: bool, count: int = 5) -> list[Form]:
        """The unknown input as it is, smoothed, and as the curves that explain most of it."""
        values = self.unknown.values.get(balance)
        if values is None:
            return []
        found = [Form({balance: curve.values}, _price(curve), (curve,)) for curve in curves[:count]]
        if free:
            found += [Form({balance: filled(w)}, FREE_PRICE) for w in (values, smooth(values, BUMP))]
        return found

    def _flows(self) -> list[Form]:
        flows = {name: w for name, w in self.unknown.values.items() if name in ("flow_1", "flow_2")}
        if len(flows) < 2:
            return []
        found = [
            Form({n: filled(w) for n, w in flows.items()}, FREE_PRICE),
            Form({n: filled(smooth(w, BUMP)) for n, w in flows.items()}, FREE_PRICE),
        ]
        second = {(c.family, c.against.replace("chamber 2", "chamber 1")): c for c in self.curves["flow_2"]}
        pairs = []
        for curve in self.curves["flow_1"]:
            partner = second.get((curve.family, curve.against))
            if partner is not None:
                pairs.append((curve.explained + partner.explained, curve, partner))
        pairs.sort(key=lambda row: -row[0])
        for _, one, two in pairs[:3]:
            found.append(Form({"flow_1": one.values, "flow_2": two.values}, _price(one), (one, two)))
        pumped = [(one, two) for _, one, two in pairs if one.family in PUMPED and "shaft" in one.against]
        for one, two in pumped[:2]:
            # What a pump does not deliver it does not load the shaft with: one error of its displacement.
            omega, dP = self.signals["omega"][:-1], (self.signals["P_1"] - self.signals["P_2"])[:-1]
            flow = 0.5 * (one.values - two.values)
            lost = np.where(np.abs(omega) > 1.0, flow / np.where(np.abs(omega) > 1.0, omega, 1.0), 0.0)
            inputs = {"flow_1": flow, "flow_2": -flow, "torque": -lost * dP}
            found.append(Form(inputs, _price(one), (one, two)))
        return found

    def _best(self, options: Sequence[Form]) -> Form | None:
        costs = []
        for option, run in zip(options, self.run([option.inputs for option in options]), strict=True):
            energy = self.gap.energy(run)
            for curve in option.curves:
                self.closed[id(curve)] = 1.0 - float(energy.sum()) / self.gap.whole
            costs.append(float(energy.sum()) / self.gap.whole + option.price)
        return options[int(np.argmin(costs))] if costs else None


def _told_best(options: Sequence[Form]) -> Form:
    """The curve that explains most of an unknown input, or the input itself, smoothed, where no curve comes near."""
    curves = [option for option in options if option.curves]
    if curves and (len(curves) == len(options) or curves[0].curves[0].explained > TOLD):
        return curves[0]
    return options[-1]


def _price(curve: Curve) -> float:
    return CURVE_PRICE + NUMBER_PRICE * curve.numbers


def _merged(options: Mapping[str, Form]) -> dict[str, np.ndarray]:
    return {name: values for option in options.values() for name, values in option.inputs.items()}
