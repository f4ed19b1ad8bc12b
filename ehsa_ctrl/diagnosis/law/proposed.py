"""The law that a diagnosis proposes: its forms, the range in which they hold, and the file of the best one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core.log import Log
from ...core.text import join_words
from ...core.unit import unit_suffix
from ...physics.effects import ADDENDS, LawFile, LawLog, law_text


@dataclass(frozen=True)
class LawForm:
    """One form of a law: its definition as an effect, the probability among the forms, and the share of the gap that
    it closes on held-out data, nominal parameters refitted with it."""

    file: LawFile
    probability: float
    gap_closed: float

    def to_dict(self) -> dict[str, Any]:
        """As in diagnosis.json."""
        numbers = {n: {"value": p.value, "sd": p.sd, "unit": p.unit} for n, p in self.file.parameters.items()}
        return {
            "expression": self.file.form, "parameters": numbers, "probability": self.probability,
            "gap_closed": self.gap_closed,
        }  # fmt: skip


@dataclass(frozen=True)
class ProposedLaw:
    """A law that the catalogue lacks.

    place: what its expression adds to, see ADDENDS. variables: on which it depends. forms: those that the log can't
    tell apart, the most probable first. range: variable -> lowest and highest value in the logs. variable,
    unit: (N - 1,) the first of `variables` along the logs; direction: (N - 1,) with the sign of the motion, where the
    law follows it but is drawn along another variable than its speed, else empty; measured, fitted: (N - 1,) unknown
    input and the best form.
    explained: share of the unknown input that it explains by cross-validation, which may be none where a standstill
    shows the friction; placebo: the same of a term for the input reversed in time. beside: effects that act beside it.
    """

    place: str
    variables: tuple[str, ...]
    forms: tuple[LawForm, ...]
    range: Mapping[str, tuple[float, float]]
    unit: str
    variable: np.ndarray = field(repr=False)
    measured: np.ndarray = field(repr=False)
    fitted: np.ndarray = field(repr=False)
    direction: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    explained: float = 0.0
    placebo: float = 0.0
    beside: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the effect that is proposed, and of its file; its end differs between laws."""
        words = "_".join("".join(c for c in text if c.isalnum() or c == "_") for text in self.variables)
        return "_".join(filter(None, ["proposed", self.place, words, self.forms[0].file.digest]))

    @property
    def proposal(self) -> str:
        """The file of the proposed effect in a result."""
        return f"effects/{self.name}.toml"

    def text(self, logs: Sequence[Log]) -> str:
        """The TOML of the proposed effect: the most probable form, with the logs from which it was found."""
        known = [known for log in logs if (known := LawLog.of(log)) is not None]
        best = self.forms[0]
        note = f"proposed by a diagnosis of {join_words(log.name for log in logs)}; closes "
        note += f"{100.0 * best.gap_closed:.0f} % of the gap on held-out data; valid within [range] only"
        return law_text(best.file.model_copy(update={"logs": known, "note": note}))

    @property
    def words(self) -> str:
        """The best form with its numbers, in words."""
        best = self.forms[0].file
        numbers = join_words(f"{n} = {p.value:.4g}{unit_suffix(p.unit)}" for n, p in best.parameters.items())
        others = f" ({len(self.forms)} forms fit as well as each other)" if len(self.forms) > 1 else ""
        return f"{best.form}, a {ADDENDS[self.place].meaning}, with {numbers}{others}"

    def to_dict(self) -> dict[str, Any]:
        """As in diagnosis.json, without the file of the proposal, which only a written result has."""
        return {
            "place": self.place, "variables": list(self.variables), "forms": [one.to_dict() for one in self.forms],
            "range": {n: list(pair) for n, pair in self.range.items()}, "proposal": None,
            "explained": self.explained, "placebo": self.placebo, "beside": list(self.beside),
        }  # fmt: skip
