"""An effect without code: one TOML file in a project's `effects/` with an arithmetic expression.

The expression adds to one balance of the plant, or to that of each chamber. Terms with the direction of a contact (d_M
of the shaft, d_R of the rod) are dry friction: they change the friction of that contact, which sticks and breaks away
at the new level. The other terms change the balance itself.
"""

from __future__ import annotations

import hashlib
import json
import keyword
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from ...core.definition import Array, Definition, Schema, validate
from ...core.errors import InputError, choices
from ...core.expression import Expression, put
from ...core.files import read_toml
from ...core.log import Log
from ...core.unit import base_units
from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber
from ._effect import Effect, EffectParameter, EffectState

#: Variables of a range that are tried at both ends for the check of neutrality; of further ones the middle is.
TRIED = 6


@dataclass(frozen=True)
class Addend:
    """What an expression adds to. unit: of the expression. signal, sign: changed signal, and with which sign.

    friction, friction_sign, direction: the same for terms with the direction of a contact; empty if there are none.
    second: signal of a second balance that has the law too, with the same sign. own: name in the expression -> signal
    of the plant for which it stands in the first balance and in the second one. factors: changed signal -> what
    multiplies the expression there, for a law of two balances that exchange power; empty for a law that adds itself.
    """

    place: str
    unit: str
    meaning: str
    signal: str
    sign: str
    friction: str = ""
    friction_sign: str = ""
    direction: str = ""
    velocity: str = ""
    second: str = ""
    own: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    factors: Mapping[str, str] = field(default_factory=dict)

    @property
    def balance_unit(self) -> str:
        """SI unit of what it adds to the first balance."""
        return "m3/s" if self.place == "flow" else self.unit

    @property
    def balances(self) -> tuple[tuple[str, dict[str, str]], ...]:
        """Changed signal of each balance, and what the names of `own` stand for there."""
        signals = tuple(self.factors) or ((self.signal, self.second) if self.second else (self.signal,))
        return tuple((signal, {name: pair[i] for name, pair in self.own.items()}) for i, signal in enumerate(signals))


#: `adds_to` of a file -> what it means. The signs are those of the unknown inputs of a diagnosis.
ADDENDS = {
    "torque": Addend(
        "torque", "N m", "torque on the shaft, driving its motion", "T_net", "+", "T_FM", "-", "d_M", "omega"
    ),
    "force": Addend("force", "N", "force on the rod, resisting extension", "F_net", "-", "F_FR", "+", "d_R", "v"),
    "flow_1": Addend("flow", "m3/s", "flow into chamber 1, from outside", "Q_T1", "+"),
    "flow_2": Addend("flow", "m3/s", "flow into chamber 2, from outside", "Q_T2", "+"),
    "flows": Addend(
        "flow", "m3/s", "flow into each chamber, from outside, where P is the pressure of that chamber", "Q_T1", "+",
        second="Q_T2", own={"P": ("P_1", "P_2")},
    ),
    "pump_flow": Addend("flow", "m3/s", "flow of the pump, from chamber 2 into chamber 1", "Q_P", "+"),
    "displacement": Addend(
        "flow", "m3", "flow of the pump by its displacement, m3 per radian, which changes its torque too", "Q_P", "+",
        factors={"Q_P": "omega", "T_P": "(P_1 - P_2)"},
    ),
    "drive": Addend("drive", "A", "current of the motor", "current", "+"),
}  # fmt: skip


class LawParameter(Definition):
    """A number of the expression, in SI units."""

    value: float = Field(description="in `unit`")
    unit: str = Field(description="SI unit")
    neutral: float | None = Field(
        default=None,
        description="value at which its term vanishes; left out for a location or shape, which acts only with its term",
    )
    bounds: Annotated[tuple[float, float], Array] | None = Field(default=None, description="[lower, upper] in `unit`")
    sd: Annotated[float, Field(ge=0)] | None = Field(default=None, description="standard deviation in `unit`")
    meaning: str = Field(default="", description="for tables")

    @field_validator("unit")
    @classmethod
    def _si(cls, unit: str) -> str:
        try:
            base_units(unit)
        except InputError as error:
            raise ValueError(str(error)) from None
        return unit

    @model_validator(mode="after")
    def _inside(self) -> LawParameter:
        if self.bounds is not None:
            lower, upper = self.bounds
            if not lower < upper:
                raise ValueError(f"bounds = [{lower:g}, {upper:g}]; expected the lower one first")
            for key, value in (("value", self.value), ("neutral", self.neutral)):
                if value is not None and not lower <= value <= upper:
                    raise ValueError(f"{key} = {value:g} is outside bounds = [{lower:g}, {upper:g}]")
        return self


class LawState(Definition):
    """A state that the expression may use: what a law remembers. It is zero at the start of a run."""

    rate: str = Field(description="its rate: an expression in the same names, and of other states of the effect")
    unit: str = Field(description="SI unit; the rate has this unit per second")
    scale: Annotated[float, Field(gt=0)] = Field(description="typical size, for the accuracy of a simulation")

    @field_validator("rate")
    @classmethod
    def _parsed(cls, text: str) -> str:
        return _parsed(text)


def _parsed(text: str) -> str:
    """The text of an expression. Raises ValueError for anything else."""
    try:
        Expression.parse(text)
    except InputError as error:
        raise ValueError(str(error)) from None
    return text


class LawLog(Definition):
    """A log from which the expression was found."""

    path: str = Field(description="file")
    sha256: str = Field(description="hash of its content")

    @classmethod
    def of(cls, log: Log) -> LawLog | None:
        """Path and hash of a log's file; None for a log without one."""
        path = Path(log.path) if log.path else None
        if path is None or not path.is_file():
            return None
        return cls(path=str(path), sha256=hashlib.sha256(path.read_bytes()).hexdigest())


class LawFile(Definition):
    """An effect's TOML."""

    schema_version: Schema = Field(alias="schema", description="format version")
    status: Literal["proposed", "confirmed"] = Field(description="whether a second log has confirmed it")
    summary: str = Field(description="one line for lists")
    adds_to: Literal["torque", "force", "flow_1", "flow_2", "flows", "pump_flow", "displacement", "drive"] = Field(
        description="what the expression adds to; signs as there"
    )
    expression: str = Field(description="of states, inputs and parameters of the plant, and of its own parameters")
    parameters: dict[str, LawParameter] = Field(description="own parameters; one with `neutral` at least")
    states: dict[str, LawState] = Field(default={}, description="what the law remembers; left out for a static law")
    range: dict[str, Annotated[tuple[float, float], Array]] = Field(
        default={}, description="[lowest, highest] value of each variable in the logs, SI units"
    )
    logs: list[LawLog] = Field(default=[], description="logs from which it was found")
    note: str = Field(default="", description="origin")

    @field_validator("expression")
    @classmethod
    def _parsed(cls, text: str) -> str:
        return _parsed(text)

    @model_validator(mode="after")
    def _complete(self) -> LawFile:
        names, addend = self.names, ADDENDS[self.adds_to]
        for table, own in (("parameters", self.parameters), ("states", self.states)):
            for name in own:
                if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
                    raise ValueError(f"[{table}] {name}: expected a name of letters, digits and _")
                if name not in names:
                    raise ValueError(f"[{table}] {name}: the expression does not use it; {choices(name, names)}")
        if both := set(self.parameters) & set(self.states):
            raise ValueError(f"[states] {min(both)}: is a parameter too; rename one of them")
        if not any(p.neutral is not None for p in self.parameters.values()):
            raise ValueError("[parameters]: none has `neutral`, the value at which the effect is absent; state it")
        for name, state in self.states.items():
            if shared := set(addend.own) & set(Expression.parse(state.rate).names):
                one = min(shared)
                raise ValueError(
                    f"[states] {name}.rate: has {one}, which is {' or '.join(addend.own[one])} by the balance, but a "
                    "state has one value; write one file for each balance"
                )
        for name, (low, high) in self.range.items():
            if name not in self.variables:
                raise ValueError(f"[range] {name}: is not a variable of the expression")
            if not low <= high:
                raise ValueError(f"[range] {name} = [{low:g}, {high:g}]; expected the lower one first")
        if addend.velocity and f"sign({addend.velocity})" in self.expression.replace(" ", ""):
            raise ValueError(
                f"expression: has sign({addend.velocity}), which is zero at standstill; write {addend.direction}, the "
                "direction of dry friction, so that the contact sticks"
            )
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the expression and in the rates of its states, in the order of their first use."""
        texts = [self.expression, *(state.rate for state in self.states.values())]
        return tuple(dict.fromkeys(name for text in texts for name in Expression.parse(text).names))

    @property
    def variables(self) -> tuple[str, ...]:
        """Those of the plant: neither its own parameters nor its own states."""
        return tuple(name for name in self.names if name not in self.parameters and name not in self.states)

    @property
    def form(self) -> str:
        """The expression with the rates of its states: what two laws share that differ in their numbers alone."""
        return "; ".join([self.expression, *(f"d {name}/dt = {one.rate}" for name, one in self.states.items())])

    @property
    def digest(self) -> str:
        """Six letters and digits that differ between laws, for names of files and of effects that are tried."""
        numbers = [(name, one.value) for name, one in self.parameters.items()]
        return hashlib.sha256(f"{self.adds_to} {self.form} {numbers}".encode()).hexdigest()[:6]

    @property
    def own_parameters(self) -> dict[str, LawParameter]:
        """Parameters with a neutral value first: the first of them measures the size."""
        return dict(sorted(self.parameters.items(), key=lambda row: row[1].neutral is None))


@dataclass(frozen=True)
class EffectExpression:
    """The definition of an effect, for checks that need the plant. where: file, for messages."""

    where: str
    definition: LawFile

    def check(self, units: Mapping[str, str]) -> None:
        """Raise InputError unless the expression fits a plant. units: name of the plant -> SI unit."""
        law = self.definition
        own = {name: one.unit for name, one in law.parameters.items()}
        own |= {name: units[pair[0]] for name, pair in ADDENDS[law.adds_to].own.items() if pair[0] in units}
        known = {**units, **own, **{name: one.unit for name, one in law.states.items()}}
        texts = {"expression": (law.expression, ADDENDS[law.adds_to].unit)}
        texts |= {f"[states] {name}.rate": (one.rate, f"{one.unit}/s") for name, one in law.states.items()}
        for key, (text, unit) in texts.items():
            try:
                Expression.parse(text).check_unit(unit, known)
            except InputError as error:
                raise InputError(f"{self.where}: {key}: {error}") from None


def read_law(path: Path) -> Effect:
    """Read an effect's TOML file; its name is that of the file. Raises InputError with file and key."""
    return effect_of(path.stem, validate(read_toml(path), LawFile, str(path)), str(path))


def effect_of(name: str, law: LawFile, where: str) -> Effect:
    """The effect of a definition. Raises InputError for a name or an expression that can't be an effect."""
    if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
        raise InputError(f"{where}: the name of the file becomes that of the effect; expected letters, digits and _")
    expression, addend = Expression.parse(law.expression), ADDENDS[law.adds_to]
    changes: dict[str, Callable[..., float]] = {}
    dry = [t for t in expression.terms if addend.direction and addend.direction in t.names]
    other = [t for t in expression.terms if t not in dry]
    parts = [(other, signal, addend.sign, names) for signal, names in addend.balances]
    for terms, signal, sign, names in (*parts, (dry, addend.friction, addend.friction_sign, {})):
        if terms:
            total = Expression.parse(put(" + ".join(f"({term.text})" for term in terms), **names))
            factor = addend.factors.get(signal, "1")
            form = f"{signal} {sign} {{}}" if factor == "1" else f"{signal} {sign} {factor} * {{}}"
            also = Expression.parse(factor).names
            changes[signal] = total.function(name, where, signal, form, also=also)
    _check_neutral(law, expression, name, where)
    sizes = {key: one.neutral for key, one in law.parameters.items() if one.neutral is not None}
    absent = " or ".join(f"{key} != {value!r}" for key, value in sizes.items())
    # What a law of the drive remembers follows the current that is asked for, as the expression does, not its own.
    asked = {addend.signal: f"asked_{addend.signal}"} if addend.place == "drive" else {}
    rates = {
        # Without the effect the state rests, so that the plant is the base plant to the last bit.
        f"{key}_dot": Expression.parse(put(one.rate, **asked)).function(
            f"{name}_{key}", where, next(iter(sizes)), f"({{}}) if {absent} else 0.0", also=tuple(sizes)
        )
        for key, one in law.states.items()
    }
    parameters = tuple(
        EffectParameter(
            key,
            one.unit,
            one.meaning or f"of {law.expression}",
            one.value if one.neutral is None else one.neutral,
            one.value,
            *(one.bounds or (-1e30, 1e30)),
            source="identified" if law.logs else "assumed",
            shape=one.neutral is None,
        )
        for key, one in law.own_parameters.items()
    )
    return Effect(
        name=name,
        place=addend.place,
        summary=f"{law.summary} ({law.status})",
        fingerprint=f"{addend.meaning}: {law.expression}",
        changes=changes,
        parameters=parameters,
        states=tuple(EffectState(key, one.unit, one.scale) for key, one in law.states.items()),
        adds=rates,
        candidates=candidates,
        law=EffectExpression(where, law),
        source=law.note or where,
    )


def law_text(law: LawFile) -> str:
    """The TOML of a definition, which `read_law` reads back."""

    def table(one: Mapping[str, object]) -> str:
        return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in one.items()) + " }"

    lines = ["schema = 1", f'status = "{law.status}"', f"summary = {json.dumps(law.summary)}"]
    lines += [f'adds_to = "{law.adds_to}"', f"expression = {json.dumps(law.expression)}"]
    lines += [f"note = {json.dumps(law.note)}"] if law.note else []
    lines += ["", "[parameters]"]
    for name, one in law.parameters.items():
        stated = one.model_dump(exclude_none=True, exclude_defaults=True)
        lines.append(f"{name} = {table(stated)}")
    lines += ["", "[states]"] if law.states else []
    lines += [f"{name} = {table(one.model_dump())}" for name, one in law.states.items()]
    lines += ["", "[range]", *(f"{name} = {json.dumps(pair)}" for name, pair in law.range.items())] if law.range else []
    for log in law.logs:
        lines += ["", "[[logs]]", f"path = {json.dumps(log.path)}", f'sha256 = "{log.sha256}"']
    return "\n".join(lines) + "\n"


def candidates(effect: Effect, context: DiagnosisContext) -> list[CandidateEffect]:
    """All numbers of the expression together, started at those of the file."""
    return [law_candidate(effect, context.values)]


def law_candidate(effect: Effect, values: Mapping[str, float]) -> CandidateEffect:
    """The candidate of an effect with an expression. values: of the plant's parameters."""
    free, start = [], []
    for parameter in effect.parameters:
        size = abs(parameter.typical) or 1.0
        scale = 0.1 * (size if parameter.shape else abs(parameter.typical - parameter.neutral) or size)
        nominal = values.get(parameter.name, parameter.neutral)
        free.append(FreeNumber(parameter.name, nominal, scale, parameter.lower, parameter.upper))
        start.append(parameter.typical)
    return CandidateEffect(effect, tuple(free), (tuple(start),))


def _check_neutral(law: LawFile, expression: Expression, name: str, where: str) -> None:
    """Raise InputError unless the expression is exactly zero at neutral parameters, and finite at those of the file.

    It is tried at both ends of the range of each variable, by default at -1 and 1, and in the middle.
    """
    value = expression.function(name, where, "zero", "{}")
    variables = [one for one in expression.names if one not in law.parameters]
    ends = []
    for i, one in enumerate(variables):
        low, high = law.range.get(one, (-1.0, 1.0))
        ends.append((low, high) if i < TRIED else (0.5 * (low + high),))
    middle = tuple(0.5 * (each[0] + each[-1]) for each in ends)
    own = {key: one for key, one in law.parameters.items() if key in expression.names}
    typical = {key: one.value for key, one in own.items()}
    neutral = {key: one.value if one.neutral is None else one.neutral for key, one in own.items()}
    for point in (*product(*ends), middle):
        at = dict(zip(variables, point, strict=True))
        shown = ", ".join(f"{key} = {one:g}" for key, one in at.items()) or "any point"
        for words, given in (("the values of [parameters]", typical), ("the neutral values", neutral)):
            try:
                found = value(0.0, **at, **given)
            except (ArithmeticError, ValueError):
                found = math.nan
            if not math.isfinite(found):
                raise InputError(
                    f"{where}: expression: can't be computed at {shown} with {words}; keep its terms finite over the "
                    "whole range, as in max(P_1, 0)"
                )
        if found != 0.0:
            raise InputError(
                f"{where}: expression: is {found:g} at {shown} with the neutral values; expected exactly 0, so that "
                "the effect can be absent: every term needs a factor whose `neutral` makes it vanish"
            )
