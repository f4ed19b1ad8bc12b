"""The grammar of laws: the variables on which an unknown input may depend, and terms in one or two of them.

A term is an expression without its factor. It may have a location `at` and a width, tried on a grid of the variable's
range. The unit of the factor follows from the units of the unknown input and of the term, so that every law has the
right dimension. Dry friction has the direction of the contact as a factor and sticks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from ...core.expression import Expression, dimension_of, put, words
from ...physics.effects import ADDENDS
from ...plant.arrays import array_evaluator
from ...plant.plant import Plant
from ..regressors import balance_contact, contact_efforts, torque_drive
from ..unknown_inputs import DIRECTION, BalanceSignals
from .memory import ACCELERATION, ORDER, STATE, Memory, MemoryTerm
from .memory_terms import memory_terms

#: Quantiles of a variable that are tried as locations, and shares of its range as widths. Engineering judgement.
LOCATIONS = (0.03, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97)
WIDTHS = (0.04, 0.08, 0.16, 0.32)
#: Width of a gate that switches at once, as a share of the range: of a brake at 1 A, widths of 0.04 explained 0.31 of
#: the torque, and of 0.004 0.93.
SHARP = 0.005
#: Periods in the range of a position that are tried. Engineering judgement.
PERIODS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)
#: Levels in the range of a current that are tried, for a drive that sets it in steps; so near to each other that the
#: steps still fit at both ends of the range. Engineering judgement.
LEVELS = tuple(np.arange(3.0, 100.0, 0.1).tolist())

#: An order of a wave over the angle is whole if it differs from that by so much of itself: an error in it that a fit to
#: a log leaves. Engineering judgement.
NEARLY_WHOLE = 0.01
#: Share of the largest speed nearby that may be ringing of the fit of the direction. Engineering judgement.
RINGING = 0.1

#: Terms of one variable z. The first of several that act alike is the one that is named.
SMOOTH = ("z", "z**2", "z**3", "abs(z)", "z * abs(z)", "sqrt(abs(z))", "sign(z) * sqrt(abs(z))")
SHAPED = (
    "max(z - at, 0)",
    "max(at - z, 0)",
    "sign(z) * max(abs(z) - at, 0)",
    "exp(-((z - at) / width)**2)",
    "max(1 - ((z - at) / width)**2, 0)",
    "tanh(z / width)",
)
#: Terms of dry friction, with the direction d.
DRY = ("d * abs(z)", "d * z**2", "d * sqrt(abs(z))")
DRY_SHAPED = (
    "d * max(abs(z) - at, 0)",
    "d * exp(-((z - at) / width)**2)",
    "d * max(1 - ((z - at) / width)**2, 0)",
    "d * 0.5 * (1 + tanh((at - abs(z)) / width))",
)
#: Terms of the contact's own speed: odd ones, so that they dissipate in both directions, and a decaying dry friction.
OF_SPEED = ("z", "z * abs(z)", "z**3", "abs(z)")
#: Products of two variables.
PRODUCTS = ("z * y", "z * abs(y)", "y * abs(z)", "z * y**2", "y * z**2")


@dataclass(frozen=True)
class LawVariable:
    """A variable.

    text: expression in the names of the equations. values: (N - 1,). speed, position: whether it is the contact's own.
    effort: whether it is an effort on the contact, on which friction alone depends: in steady motion any effort equals
    the friction, so that another law of it would explain every unknown input. drives: whether it drives the contact,
    so that a product with it would explain any friction that depends on the other factor.
    """

    text: str
    unit: str
    values: np.ndarray = field(repr=False)
    speed: bool = False
    position: bool = False
    effort: bool = False
    drives: bool = False


@dataclass(frozen=True)
class Term:
    """A term without its factor.

    text: expression in variables and `at`, `width`. shapes: their values. units: their units. variables: texts of the
    variables in it. memory: states in it, if any. family: what stays the same over the grid of shapes.
    """

    text: str
    variables: frozenset[str]
    shapes: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    memory: Memory | None = None

    @property
    def family(self) -> str:
        return self.text if self.memory is None else f"{self.text}; {self.memory.rates}"

    @property
    def is_wave(self) -> bool:
        """Whether it is a wave over what it remembers, the shaft angle."""
        return self.memory is not None and self.text.startswith("sin(")

    @property
    def with_whole_order(self) -> Term:
        """The same wave of the nearest whole order, if its order is nearly whole."""
        order = self.shapes.get(ORDER)
        if order is None or abs(order - round(order)) > NEARLY_WHOLE * order:
            return self
        shapes = {name: value for name, value in self.shapes.items() if name != ORDER}
        units = {name: unit for name, unit in self.units.items() if name != ORDER}
        whole = f"{order:.0f} * " if round(order) > 1 else ""
        return replace(self, text=self.text.replace(f"{ORDER} * ", whole), shapes=shapes, units=units)


@dataclass(frozen=True)
class Grammar:
    """What a law of one unknown input may consist of.

    name: unknown input, a key of ADDENDS. variables: the displacement has none, because its constant is a nominal
    parameter, and the catalogue has it with the pressure; its laws have a memory, the shaft angle. known: name in the
    equations -> (N - 1,) along the logs. units: of those. direction, speed, friction: of the contact, with the friction
    that the plant has; slides: (N - 1,) 1 where it does so with certainty, else 0; resists: 1 if a positive law acts
    against positive motion, else -1. Without a contact they have their defaults. memories: terms with a memory.
    sample_time [s], begins: samples at which the logs begin, starts: times there [s]. Where a law is in two balances,
    the logs come twice, see `in_turn`, with the names of `Addend.own`.
    """

    name: str
    variables: tuple[LawVariable, ...]
    known: Mapping[str, np.ndarray] = field(repr=False)
    units: Mapping[str, str] = field(repr=False)
    direction: str = ""
    speed: np.ndarray | None = field(default=None, repr=False)
    friction: np.ndarray | float = field(default=0.0, repr=False)
    slides: np.ndarray | float = field(default=1.0, repr=False)
    resists: float = 1.0
    memories: tuple[MemoryTerm, ...] = field(default=(), repr=False)
    sample_time: float = 1.0
    begins: tuple[int, ...] = (0,)
    starts: tuple[float, ...] = (0.0,)

    @classmethod
    def of(cls, plant: Plant, signals: BalanceSignals, name: str) -> Grammar:
        """The variables that a log shows, for one unknown input of a plant."""
        structure, system = plant.structure, plant.structure.system
        addend = ADDENDS[name]
        place = addend.place
        contact = balance_contact(plant, place) if place in ("torque", "force") else None
        units = {**structure.units, **{n: structure.units[pair[0]] for n, pair in addend.own.items()}}
        known = {n: np.asarray(signals[n][:-1]) for n in units if n in signals}
        efforts = {} if contact is None else contact_efforts(plant, signals, contact)
        known |= {n: values[:-1] for n, values in efforts.items()}
        if contact is not None:
            sign = known[contact.direction]
            known[contact.direction] = np.where(sign == 0.0, 1.0, sign)
        pressures = system.pressures if set(system.pressures) <= set(known) else ()
        time = signals["time"][:-1]
        # The next log begins before the end of the one before, or later.
        jumps = np.abs(np.diff(time) - signals.sample_time) > 0.5 * signals.sample_time
        begins = (0, *(np.flatnonzero(jumps) + 1).tolist())
        if addend.second:
            either = {n: (known[one], known[other]) for n, (one, other) in addend.own.items() if one in known}
            known = {n: in_turn(values, values, values[-1]) for n, values in known.items()}
            known |= {n: in_turn(*pair, pair[0][-1]) for n, pair in either.items()}
            begins = (*begins, *(time.size + 1 + at for at in begins))
        own = [] if contact is None else [contact.velocity, contact.position]
        others: list[str] = []
        if name.startswith("flow") and pressures:
            others = list(addend.own) or [system.entries[name].target]
        if place == "flow" and not addend.factors:
            others += [n for one in system.all_contacts for n in (one.velocity, one.position)]
        if place == "torque" and torque_drive(plant, signals).unit == units.get(system.inputs[0]):
            others.append(system.inputs[0])
        speeds = {one.velocity for one in system.all_contacts}
        found = [
            LawVariable(
                n, units[n], known[n], contact is not None and n == contact.velocity, n not in speeds and n in own
            )
            for n in dict.fromkeys([*own, *others])
            if n in known
        ]
        if pressures and not addend.factors:
            first, second = pressures
            difference = f"({first} - {second})", units[first], known[first] - known[second]
            found.insert(1, LawVariable(*difference, drives=place == "force"))
        found += [LawVariable(n, units[n], known[n], effort=True) for n in efforts]
        moving = tuple(v for v in found if np.ptp(v.values) > 0.0)
        plain = cls(
            name, moving, known, units, sample_time=signals.sample_time, begins=begins,
            starts=tuple(float(time[at]) for at in begins if at < time.size),
        )  # fmt: skip
        if contact is not None:
            evaluate = array_evaluator(plant.structure.equations, [contact.friction])
            friction = evaluate({**plant.values, **{n: signals[n][:-1] for n in signals.values}})[contact.friction]
            resists = 1.0 if addend.sign == "-" else -1.0
            speed = known[contact.velocity]
            # At the ends of a log the fit of the direction may have the sign of the noise.
            alike = known[contact.direction] * speed > 0.0
            plain = replace(
                plain, direction=contact.direction, speed=speed, friction=friction, resists=resists,
                slides=1.0 * (signals.slides[contact.name][:-1] & alike & _beyond_ringing(speed)),
            )  # fmt: skip
        return replace(plain, memories=tuple(memory_terms(plant, name, plain.in_motion, float(np.ptp(time)))))

    @property
    def samples(self) -> int:
        """Number of samples along the logs."""
        return next(iter(self.known.values())).size

    def values(self, term: Term, span: slice = slice(None)) -> np.ndarray:
        """(n,) of a term along the logs, in the balance of its unknown input, or a number. span: its samples."""
        states = {} if term.memory is None else self.course(term.memory, term.shapes, span.stop)
        factor: np.ndarray | float = 1.0
        if (at := self._factor).size:
            # Its mean over each sample, as that of a state: of the flow of a wave over the angle little else remains.
            factor = (0.5 * (at + np.append(at[1:], at[-1:])))[span]
        expression = Expression.parse(term.text)
        along = {**self.known, **states}
        given = {name: along[name][span] for name in expression.names if name in along}
        return np.asarray(factor * expression.values({**term.shapes, **given}), dtype=float)

    @property
    def _factor(self) -> np.ndarray:
        """(N - 1,) of what enters the balance multiplied by a signal, this signal: the flow of a displacement, by the
        speed of the pump; else empty."""
        addend = ADDENDS[self.name]
        if not addend.factors:
            return np.zeros(0)
        return np.asarray(Expression.parse(addend.factors[addend.signal]).values(self.known))

    def course(self, memory: Memory, shapes: Mapping[str, float], end: int | None = None) -> dict[str, np.ndarray]:
        """State -> (n,) mean over each sample along the logs. end: samples that are needed, of which there is one more;
        by default all."""
        known, begins = self.in_motion, self.begins
        if end is not None:
            # The mean over the last one that is needed takes the next.
            known = {name: values[: end + 1] for name, values in known.items()}
            begins = tuple(at for at in begins if at <= end)
        return memory.course(known, shapes, self.sample_time, begins, mean=True)

    @property
    def in_motion(self) -> Mapping[str, np.ndarray]:
        """`known` for the rates of states: at rest the direction is zero, as in a simulation, in place of noise."""
        return (
            {**self.known, self.direction: self.known[self.direction] * self.slides} if self.direction else self.known
        )

    def shown(self, term: Term) -> LawVariable:
        """The variable along which a term is drawn: a variable of the balance, else its memory."""
        for variable in self.variables:
            if variable.text in term.variables:
                return variable
        if term.memory is None:
            return self.variables[0]
        if ACCELERATION in term.variables:
            unit = next(v.unit for v in self.variables if v.speed)
            return LawVariable(ACCELERATION, f"{unit}2", self.values(term))
        values = self.course(term.memory, term.shapes)[STATE]
        unit = term.memory.units[STATE]
        return (
            LawVariable("angle", "rad", values % (2.0 * np.pi)) if unit == "rad" else LawVariable("time", unit, values)
        )

    def is_friction(self, term: Term) -> bool:
        """Whether a term has the direction of the contact, or its speed."""
        speed = {v.text for v in self.variables if v.speed}
        return self.direction in Expression.parse(term.text).names or bool(speed & term.variables)

    def direction_of(self, terms: Sequence[Term]) -> np.ndarray:
        """(N - 1,) with the sign that a sum of terms has beside the variable along which it is drawn: the direction of
        the contact, where that variable is not its speed, or the factor of the place; else empty."""
        if self._factor.size:
            return self._factor
        dry = self.direction and any(self.direction in Expression.parse(term.text).names for term in terms)
        return self.known[self.direction] if dry and not self.shown(terms[0]).speed else np.zeros(0)

    def terms(self) -> Iterator[Term]:
        """All terms of one variable, over the grid of their shapes, all products of two, and those with a memory."""
        if self.variables:
            yield Term("1", frozenset())
        if self.direction:
            yield Term(self.direction, frozenset())
        for variable in self.variables:
            yield from self._of_one(variable)
        plain = [v for v in self.variables if not (v.effort or v.drives)]
        for i, one in enumerate(plain):
            for other in plain[i + 1 :]:
                both = frozenset({one.text, other.text})
                for text in PRODUCTS:
                    yield Term(put(text, z=one.text, y=other.text), both)
        for found in self.memories:
            yield Term(found.text, frozenset(found.on), found.shapes, found.units, found.memory)

    def _of_one(self, variable: LawVariable) -> Iterator[Term]:
        used, z = frozenset({variable.text}), variable.text
        dry, dry_shaped = (DRY, DRY_SHAPED) if self.direction else ((), ())
        plain = OF_SPEED if variable.speed else dry if variable.effort else (*SMOOTH, *dry)
        for text in plain:
            yield Term(put(text, z=z, d=self.direction), used)
        # At rest, where a log may spend most of its time, laws of dry friction show nothing.
        shown = variable.values[self._acts]
        low, high = np.quantile(shown, [0.005, 0.995]).tolist()
        if variable.speed:
            for share in WIDTHS:
                units = {"width": variable.unit}
                yield Term(put("d * exp(-abs(z) / width)", z=z, d=self.direction), used, {"width": share * high}, units)
            return
        signed, sizes = (np.quantile(values, LOCATIONS).tolist() for values in (shown, np.abs(shown)))
        # A dead zone of a variable with one sign is a hinge.
        shaped = [text for text in SHAPED if low < 0.0 < high or "sign" not in text]
        for text in dry_shaped if variable.effort else (*shaped, *dry_shaped):
            names = Expression.parse(text).names
            widths = WIDTHS if "width" in names else (0.0,)
            locations = sizes if "abs(z) - at" in text or "at - abs(z)" in text else signed
            for at in locations if "at" in names else (0.0,):
                for share in (SHARP, *widths) if "tanh((" in text else widths:
                    shapes = {"at": at, "width": share * (high - low)}
                    shapes = {n: v for n, v in shapes.items() if n in names}
                    yield Term(put(text, z=z, d=self.direction), used, shapes, dict.fromkeys(shapes, variable.unit))
        if variable.unit == "A":
            for count in LEVELS:
                text = put("(width * round(z / width) - z)", z=z)
                yield Term(text, used, {"width": (high - low) / count}, {"width": variable.unit})
        if variable.position:
            for count in PERIODS:
                for phase in (0.0, 0.5 * np.pi):
                    shapes = {"at": phase, "width": (high - low) / (2.0 * np.pi * count)}
                    units = {"at": "1", "width": variable.unit}
                    yield Term(put("sin(z / width + at)", z=z), used, shapes, units)

    @property
    def _acts(self) -> np.ndarray:
        """(N - 1,) whether a sample is one in which a contact slides; all of them if it never does, or without one."""
        acts = np.broadcast_to(self.slides, (self.samples,)) > 0.0
        return acts if acts.any() else np.ones(self.samples, dtype=bool)

    def factor_unit(self, term: Term) -> str:
        """SI unit of the factor of a term."""
        whole = ADDENDS[self.name].unit
        states = {} if term.memory is None else term.memory.units
        inner = Expression.parse(term.text).dimension({**self.units, **term.units, **states}) or {}
        powers = {base: -power for base, power in inner.items()}
        if not powers:
            return whole
        plain = set(powers) <= ({"s", "A"} if whole == "N m" else {"m", "s", "A"}) and "/" not in whole
        return f"{whole} {words(powers)}" if plain else _joined(whole, powers)


def _beyond_ringing(speed: np.ndarray) -> np.ndarray:
    """(N - 1,) whether a speed is more than what the fit of the direction makes of a stop: some percent of the speed
    before it, with the other sign."""
    return np.asarray(np.abs(speed) > RINGING * maximum_filter1d(np.abs(speed), DIRECTION))


def _joined(whole: str, powers: Mapping[str, float]) -> str:
    """The product of a unit and powers of base units, in base units; a flow by a pressure in pascals."""
    pascals = dimension_of("Pa")
    by = -powers.get("kg", 0.0) if whole == "m3/s" else 0.0
    total = dict(dimension_of(whole))
    for base in {**powers, **pascals}:
        total[base] = total.get(base, 0.0) + powers.get(base, 0.0) + by * pascals.get(base, 0.0)
    rest = {base: power for base, power in total.items() if abs(power) > 1e-9} | ({"Pa": -by} if by else {})
    return words(rest)


def in_turn(one: np.ndarray, other: np.ndarray, between: float) -> np.ndarray:
    """Two arrays (N, ...) one after the other, with this value between them: (2 N + 1, ...)."""
    return np.concatenate([one, np.full((1, *one.shape[1:]), between), other])


def variables_of(terms: Sequence[Term]) -> frozenset[str]:
    """Texts of the variables of several terms."""
    return frozenset().union(*(term.variables for term in terms))
