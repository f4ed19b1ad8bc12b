"""Repetitive control: the controller kind that learns a periodic motion around another law.

    w(k) = Q [w(k - N) + gamma e(k - N + m)],    the base law gets the reference r + w

N is the samples of a period, Q a low-pass filter without phase, which needs values that a plain filter would not have
yet: those of the last cycle are all there (S. Hara, Y. Yamamoto, T. Omata, M. Nakano, "Repetitive control system: a new
type servo system for periodic exogenous signals", IEEE Trans. Automatic Control 33(7), 1988, with Q as their low-pass
filter). Convergence is checked at the design, see analysis/learning.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from ...core.definition import Definition, Hertz, Metre, Second, validate
from ...core.errors import InputError, choices, shown
from ..analysis.learning import Learning, design_learning
from ..analysis.sampled import drive_unit_of
from ..controller import Law, SampledController
from ..review_checks import ReviewContext, ReviewFinding
from ..state_space.state_feedback import state_feedback
from ..words import WordsByUnit, law_words
from ._kind import ControllerKind, PositionControllerFile
from .adrc import adrc_law
from .cascade import cascade_law, rod_cascade_law
from .pid import pid_law
from .sliding_mode import rod_sliding_mode_law, sliding_mode_law

if TYPE_CHECKING:
    import control

#: Numbers of memory before the ring of v, and of settings before the taps.
HEAD, TAPS = 6, 6


class Cycle(Definition):
    """[cycle]: the period and what is learnt of it."""

    period: Second = Field(gt=0, description="period of the reference, a whole number of samples")
    cutoff: Hertz = Field(gt=0, description="frequency up to which the correction is learnt")
    gain: Annotated[float, Field(gt=0, lt=2)] = Field(
        default=0.7, description="learning gain; 1 learns in one cycle, less averages noise"
    )
    lead: Annotated[int, Field(ge=0, le=500)] | None = Field(
        default=None, description="samples by which the error is advanced; by default those that converge fastest"
    )
    deadband: Metre = Field(
        default=0.0, ge=0, description="error that is not learnt, about the smallest slip: friction would hunt with it"
    )
    limit: Metre = Field(default=5e-3, gt=0, description="largest correction of the reference")


class RepetitiveFile(PositionControllerFile):
    """A repetitive controller's TOML."""

    kind: Literal["repetitive"] = Field(description="type of feedback law")
    cycle: Cycle = Field(description="period and learning")
    base: dict[str, Any] = Field(
        description="the law that gets the corrected reference: `kind` and the tables of that kind, without the stages"
    )

    #: Context of the validation, which holds for the base too.
    _context: dict[str, Any] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _check_cycle(self, info: ValidationInfo) -> RepetitiveFile:
        self._context.update(info.context or {})
        samples = self.cycle.period / self.sample_time
        if abs(samples - round(samples)) > 1e-6 * samples:
            raise ValueError(
                f"[cycle] period = {self.cycle.period:g} s is {samples:.6g} samples of {self.sample_time:g} s; "
                "expected a whole number"
            )
        if self.cycle.cutoff * self.sample_time >= 0.5:
            raise ValueError(f"[cycle] cutoff must be below half the sample rate {0.5 / self.sample_time:g} Hz")
        word = self.base.get("kind")
        if word not in BASES:
            raise ValueError(f"[base] kind = {shown(word)}; {choices(str(word), BASES)}")
        if word not in ("pid", "cascade"):
            self.refuse_inertia(f"a {word}")
        foreign = [key for key in self.base if key in PositionControllerFile.model_fields and key != "kind"]
        if foreign:
            raise ValueError(f"[base] {foreign[0]}: belongs to the controller itself, above its tables")
        return self


def repeat(reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, hold: float) -> None:
    """One sample: memory[2:6] becomes the reference with the correction w.

    settings: N, m, q, gamma, deadband [m], limit [m], taps of Q.
    memory: places of this sample in the rings of v and w, the corrected reference (4), v = w + gamma z^m e (N + q + 1),
    w (m + 1).
    """
    N, m, q = int(settings[0]), int(settings[1]), int(settings[2])
    ring, late = N + q + 1, 6 + N + q + 1
    now, place = int(memory[0]), int(memory[1])
    w, k = 0.0, now
    for i in range(2 * q + 1):
        # v of one period ago, q samples before to q samples after it: the ring holds N + q + 1 of them.
        k = 0 if k == ring - 1 else k + 1
        w += settings[6 + i] * memory[6 + k]
    w = min(max(w, -settings[5]), settings[5])
    memory[late + place] = w
    error = reference[0] - measured[3]
    if hold == 1.0 or abs(error) <= settings[4]:
        error = 0.0
    # The error of this sample completes v of m samples ago.
    k = now - m if now >= m else now - m + ring
    place = 0 if place == m else place + 1
    memory[6 + k] = memory[late + place] + settings[3] * error
    memory[0], memory[1] = float(0 if now == ring - 1 else now + 1), float(place)
    memory[2:6] = reference
    memory[2] = reference[0] + w


def repetitive_pid(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """One sample; settings: sizes of the base's memory and of all before its settings, those of `repeat`, the base's.
    memory: the base's, that of `repeat`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return pid_law(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


def repetitive_cascade(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """As `repetitive_pid`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return cascade_law(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


def repetitive_lqr(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """As `repetitive_pid`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return state_feedback(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


def repetitive_adrc(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """As `repetitive_pid`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return adrc_law(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


def repetitive_sliding_mode(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """As `repetitive_pid`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return sliding_mode_law(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


def repetitive_rod_cascade(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """As `repetitive_pid`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return rod_cascade_law(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


def repetitive_rod_sliding_mode(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    """As `repetitive_pid`."""
    size, start = int(settings[0]), int(settings[1])
    repeat(reference, measured, memory[size:], settings[2:], hold)
    return rod_sliding_mode_law(memory[size + 2 :], measured, memory, settings[start:], extra, hold)


#: Kinds of the base.
BASES = ("pid", "cascade", "lqr", "adrc", "sliding_mode")
#: Law of the base -> the law with the correction.
CORRECTED: dict[Callable[..., float], Callable[..., float]] = {
    pid_law: repetitive_pid,
    cascade_law: repetitive_cascade,
    rod_cascade_law: repetitive_rod_cascade,
    state_feedback: repetitive_lqr,
    adrc_law: repetitive_adrc,
    sliding_mode_law: repetitive_sliding_mode,
    rod_sliding_mode_law: repetitive_rod_sliding_mode,
}


@dataclass(frozen=True)
class Repetitive(WordsByUnit):
    """Feedback law of a repetitive controller, a design.controller.Law.

    Attributes
    ----------
    base: law of the base. samples: N. learning: filter, gain and convergence.
    deadband: m. largest: correction [m].
    """

    base: Law
    samples: int
    learning: Learning
    deadband: float
    largest: float
    compiles = True

    @property
    def function(self) -> Callable[..., float]:
        return CORRECTED[self.base.function]

    @property
    def uses(self) -> tuple[Callable[..., Any], ...]:
        return (*self.base.uses, self.base.function, repeat)

    @property
    def reads(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(("position", *self.base.reads)))

    @property
    def traces(self) -> dict[str, int]:
        return {**self.base.traces, "corrected_position": self.base.initial_memory().size + 2}

    def settings(self) -> np.ndarray:
        learning = self.learning
        own = [self.samples, learning.lead, learning.taps.size // 2, learning.gain, self.deadband, self.largest]
        head = [self.base.initial_memory().size, 2 + TAPS + learning.taps.size]
        return np.concatenate([np.array([*head, *own], dtype=float), learning.taps, self.base.settings()])

    def initial_memory(self) -> np.ndarray:
        ring = self.samples + self.learning.taps.size // 2 + 1
        return np.concatenate([self.base.initial_memory(), np.zeros(HEAD + ring + self.learning.lead + 1)])

    def linear(self) -> control.StateSpace:
        """The base law: the loop of the first cycle, around which the correction converges."""
        return self.base.linear()

    def findings(self, case: ReviewContext) -> Iterator[ReviewFinding]:
        """What a design review says of the learning."""
        yield ReviewFinding(
            "learning converges",
            f"a cycle leaves at most {self.learning.contraction:.3g} of what the correction lacks, most at "
            f"{self.learning.at:.3g} Hz; lead {self.learning.lead} samples",
            "good" if self.learning.contraction < 0.95 else "warning",
            "lower [cycle] cutoff: a plant that differs from the model may diverge",
        )

    def words(self, unit: str) -> str:
        """The law with the drive's unit."""
        return f"repetitive over {self.samples} samples, {self.learning}, around {law_words(self.base, unit)}"


def design_repetitive(name: str, file: RepetitiveFile, system: control.StateSpace) -> Repetitive:
    """A repetitive controller for the linear model `system`.

    Raises InputError for a base that is invalid or fails, and for a learning that does not converge.
    """
    from . import CONTROLLER_KINDS

    word = str(file.base["kind"])
    unit = drive_unit_of(system)
    limits = {"sample_time": f"{file.sample_time!r} s", "current_limit": f"{file.current_limit!r} {unit}"}
    content = {"schema": 1, "title": name, **limits, **file.base}
    try:
        definition = validate(content, CONTROLLER_KINDS[word].file, "[base]", context=file._context)
        base = CONTROLLER_KINDS[word].design(name, definition, system)
    except InputError as error:
        text = str(error).replace("--spec ", "--spec base.")
        raise InputError(text if text.startswith("[base]") else f"[base] {text}") from None
    controller = SampledController(name, word, file.sample_time, file.current_limit, base)
    cycle = file.cycle
    samples = round(cycle.period / file.sample_time)
    try:
        learning = design_learning(system, controller, gain=cycle.gain, cutoff=cycle.cutoff, lead=cycle.lead)
    except InputError as error:
        raise InputError(f"[cycle] {error}") from None
    reach = learning.taps.size // 2 + learning.lead
    if samples <= reach:
        raise InputError(
            f"[cycle] period of {samples} samples is too short for a filter and lead of {reach} samples; raise cutoff"
        )
    return Repetitive(base, samples, learning, cycle.deadband, cycle.limit)


kind = ControllerKind(
    "repetitive", "learns a periodic motion around a pid, cascade, lqr, adrc or sliding mode", RepetitiveFile,
    design_repetitive,
)  # fmt: skip
