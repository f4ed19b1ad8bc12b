"""The parts of a system: states, inputs, contacts with friction, balances, and equations wired by name.

An equation is a pair (signal, function). The argument names of the function are the states, inputs, parameters and
other signals that it needs; the order of evaluation follows from them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from ..core.log import CHANNELS, Channel

ScalarFunction = Callable[..., float]


@dataclass(frozen=True)
class State:
    """A state variable. scale: size of a relevant change in `unit`, by which the engine scales integration errors."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class ParameterKind:
    """A parameter of a system without its value: unit, meaning and physical range.

    prior: relative standard deviation of a typical nominal value; None for a parameter that a diagnosis does not refit.
    searched: whether a diagnosis refits it beside every hypothesis. False where other parameters act nearly alike, as
        volumes beside the bulk modulus: together they would hide causes. The final estimate of sizes refits it.
    default: value where a plant's file leaves it out; None for a parameter that it must give.
    """

    name: str
    unit: str
    meaning: str
    lower: float = -1e30
    upper: float = 1e30
    lower_open: bool = False
    prior: float | None = None
    searched: bool = True
    default: float | None = None


@dataclass(frozen=True)
class Contact:
    """A friction contact, which slides or sticks.

    Attributes
    ----------
    name: "shaft" or "rod"; a plant's TOML chooses its law with shaft_friction or rod_friction.
    velocity: state that is the sliding speed (an input where the motion is prescribed).
    net: signal of the effort on the contact without friction (N m or N).
    friction: signal of the friction effort by the law of the plant's structure.
    direction: name of the sliding direction in the equations, +1 or -1.
    suffix: index of the friction symbols, e.g. FM in A_FM, B_FM.
    effort_unit, length_unit: N m and rad, or N and m.
    effort_scale: size of a relevant effort, by which the engine scales the search for a breakaway.
    bristle: inner state of friction laws that have one.
    stribeck_speed: tau for plants whose law has none, in case a diagnosis adds static friction.
    constant: symbol that the effects use for a constant effort on the contact; empty without one.
    position: state that is the integral of the velocity, or its name if the motion is prescribed; empty without one.
    efforts: signals or inputs in `effort_unit` on which the friction of this contact may depend, such as the torque
        that a gear transmits; those that a variable of the system is proportional to are left out.
    position_channel, acceleration_channel: channels of the log that measure a prescribed position, an acceleration.
    symbols: friction symbol -> its name in this system, if that differs, e.g. {"A": "Fc"}.
    """

    name: str
    velocity: str
    net: str
    friction: str
    direction: str
    suffix: str
    effort_unit: str
    length_unit: str
    effort_scale: float
    bristle: State
    symbols: Mapping[str, str] = field(default_factory=dict)
    stribeck_speed: float = 0.01
    constant: str = ""
    position: str = ""
    position_channel: str = ""
    acceleration_channel: str = ""
    efforts: tuple[str, ...] = ()

    def symbol(self, symbol: str) -> str:
        """Name of a friction symbol at this contact: A_FM for A."""
        return self.symbols.get(symbol, f"{symbol}_{self.suffix}")


@dataclass(frozen=True)
class Entry:
    """Where the unknown input of a residual enters a simulation.

    target: input of the system that it adds to, or state whose rate it adds to.
    capacity: divisor of the unknown input: a parameter, such as K_T for a torque that acts as a current; or a signal
        over a parameter, such as V_1 over beta for a flow that changes a pressure; empty for 1.
    """

    target: str
    capacity: tuple[str, ...] = ()


@dataclass(frozen=True)
class ScoredSignal:
    """A signal by which a diagnosis scores a model.

    name: in results. channel: output of the system. span: 0 for the channel itself; else the signal is the slope of
    the channel over this time [s]. drift: error that noise of the logged input causes in any free run, SI units.
    """

    name: str
    channel: str
    span: float = 0.0
    drift: float = 0.0


@dataclass(frozen=True)
class Balance:
    """A sum that is zero in the true plant.

    Parameters are estimated from it without a simulation, and its residual shows the unknown input behind a gap.
    Residual functions are wired by name like all equations. Besides states, inputs, signals and parameters they may
    use measurements: `omega_rate` is the measured rate of the state omega, `force_measured` the channel force of the
    log. A residual must be linear in the estimated parameters, except tau and beta.

    Attributes
    ----------
    name: for tables; the part before a comma names the unknown input of the residual: torque, flow, force or load.
    unit: unit of the residual.
    residuals: functions; those of one balance share parameters and are solved together.
    terms: one signal, input or measured channel per residual, as the reference for its size.
    contacts: contacts whose friction is a term; samples in which one of them sticks are left out.
    without: channel of the log that makes this balance superfluous.
    closed: one signal per residual that must be zero for its use, such as the unmeasured flow of a valve.
    entries: one per residual: where its unknown input enters a simulation; empty for a balance that does not affect
        the outputs.
    """

    name: str
    unit: str
    residuals: tuple[ScalarFunction, ...]
    terms: tuple[str, ...]
    contacts: tuple[str, ...] = ()
    without: str | None = None
    closed: tuple[str, ...] = ()
    entries: tuple[Entry, ...] = ()

    @property
    def unknown_inputs(self) -> tuple[str, ...]:
        """Names of the unknown inputs, one per residual: "force", or "flow_1" and "flow_2"."""
        place, count = self.name.partition(",")[0], len(self.residuals)
        return (place,) if count == 1 else tuple(f"{place}_{i}" for i in range(1, count + 1))


@dataclass(frozen=True, eq=False)
class System:
    """A system: the equations without friction laws, chamber form, effects and parameter values.

    Systems are compared by identity.

    Attributes
    ----------
    inputs: the drive and the external input.
    drives: input -> channel of the log that drives it in a replay.
    outputs: channel of the log -> state that it measures; simulations are compared with these.
    hold: drives between the samples of a log: "zero_order" or "first_order" (linear interpolation).
    chamber_forms: name in a plant's TOML -> equations of the chamber volumes; empty for a system without chambers.
    start: state -> parameter with its value at rest; other states are zero at rest.
    kinks: signal -> length of a relevant change, for each signal at whose zero the equations bend; a step of the engine
        ends there.
    cell: signal of the load cell; None without one. cell_channel: channel of the log that measures it.
    prescribed: contacts whose motion is an input; their friction occurs only in balances.
    balances: in the order of solution; the next one uses the parameters estimated in the one before.
    measured: further channels that the balances use.
    proportional: pairs of a channel and a drive's that are proportional to each other whatever the load.
    missing_effects: sets of effects (ids) that a model of this system without dry friction may lack; a diagnosis
        searches each set from the solution with the one before.
    symbols: symbol or signal in the catalogue of effects -> its name in this system, if that differs; not for the
        friction parameters of the system's own contacts.
    scored: signals by which a diagnosis scores a model; every output by default.
    centring: of the bench's slow loop that keeps the moved part within its stroke: drive per metre of the low-pass
        filtered position, and largest drive of it, SI units; zero for a system that needs none.
    no_controller: why no sampled position controller can be put around the system, as the end of a sentence; empty if
        one can, for a system whose drive moves the state x.
    units: channel or scored signal -> SI unit, for those that `core.log.CHANNELS` lacks; they are added there.

    Raises TypeError for unknown names in drives, outputs, scored, entries, kinks or contacts of balances.
    """

    name: str
    states: tuple[State, ...]
    inputs: tuple[str, ...]
    drives: Mapping[str, str]
    outputs: Mapping[str, str]
    contacts: tuple[Contact, ...]
    equations: tuple[tuple[str, ScalarFunction], ...]
    parameters: tuple[ParameterKind, ...]
    hold: Literal["zero_order", "first_order"] = "zero_order"
    title: str = ""
    chamber_forms: Mapping[str, tuple[tuple[str, ScalarFunction], ...]] = field(default_factory=dict)
    start: Mapping[str, str] = field(default_factory=dict)
    kinks: Mapping[str, float] = field(default_factory=dict)
    cell: str | None = None
    cell_channel: str = "force"
    prescribed: tuple[Contact, ...] = ()
    balances: tuple[Balance, ...] = ()
    measured: tuple[str, ...] = ()
    proportional: tuple[tuple[str, str], ...] = ()
    missing_effects: tuple[tuple[str, ...], ...] = ()
    symbols: Mapping[str, str] = field(default_factory=dict)
    scored: tuple[ScoredSignal, ...] = ()
    centring: tuple[float, float] = (0.0, 0.0)
    no_controller: str = ""
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for channel, unit in self.units.items():
            if CHANNELS.setdefault(channel, Channel(unit, 9)).unit != unit:
                raise TypeError(f"system {self.name}: channel {channel} in {unit}; expected {CHANNELS[channel].unit}")
        if not self.scored:
            object.__setattr__(self, "scored", tuple(ScoredSignal(channel, channel) for channel in self.outputs))
        states = {state.name for state in self.states}
        for what, names, known in (
            ("units: missing channel", self.channels, CHANNELS),
            ("drives: unknown input", self.drives, self.inputs),
            ("outputs: unknown state", self.outputs.values(), states),
            ("kinks: unknown signal", self.kinks, [signal for signal, _ in self.equations]),
            ("proportional: unknown channel", [name for pair in self.proportional for name in pair], self.channels),
            ("scored: unknown output", [one.channel for one in self.scored], self.outputs),
            ("entries: unknown target", [one.target for one in self.entries.values()], states | {*self.inputs}),
            (
                "balances: unknown contact",
                [name for balance in self.balances for name in balance.contacts],
                [contact.name for contact in self.all_contacts],
            ),
        ):
            for name in names:
                if name not in known:
                    raise TypeError(f"system {self.name}: {what} {name!r}; expected one of {', '.join(known)}")
        for balance in self.balances:
            if len(balance.entries) not in (0, len(balance.residuals)):
                raise TypeError(
                    f"system {self.name}: balance {balance.name} has {len(balance.entries)} entries for "
                    f"{len(balance.residuals)} residuals; give one for each, or none"
                )

    def own(self, symbol: str) -> str:
        """Name that a symbol of the catalogue of effects has in this system, e.g. Fc for A_FR."""
        for contact in self.all_contacts:
            for family, name in contact.symbols.items():
                if symbol == f"{family}_{contact.suffix}":
                    return name
        return self.symbols.get(symbol, symbol)

    def own_changes(self, changes: Mapping[str, ScalarFunction]) -> dict[str, ScalarFunction]:
        """The changes of an effect by this system's signals; two signals of the catalogue may be one here."""
        return {self.own(signal): function for signal, function in changes.items()}

    @property
    def drive(self) -> str:
        """Channel of the log with the first input."""
        return self.drives[self.inputs[0]]

    @property
    def drive_unit(self) -> str:
        """SI unit of the drive."""
        return CHANNELS[self.drive].unit

    @property
    def entries(self) -> dict[str, Entry]:
        """Unknown input -> where it enters a simulation; not for balances that affect no output."""
        return {
            name: entry
            for balance in self.balances
            for name, entry in zip(balance.unknown_inputs, balance.entries, strict=False)
        }

    @property
    def pressures(self) -> tuple[str, ...]:
        """States that are the pressures of the two chambers; empty for a system without flow balances."""
        return tuple(entry.target for name, entry in self.entries.items() if name.startswith("flow"))

    @property
    def positions(self) -> dict[str, str]:
        """Channel of the log -> state, for each output that is the position of a contact."""
        known = {contact.position for contact in self.all_contacts}
        return {channel: state for channel, state in self.outputs.items() if state in known}

    @property
    def slopes(self) -> dict[str, str]:
        """State that is the velocity of a contact -> state that is its position."""
        states = {state.name for state in self.states}
        return {c.velocity: c.position for c in self.all_contacts if {c.velocity, c.position} <= states}

    @property
    def places(self) -> dict[str, tuple[str, ...]]:
        """Place of an effect -> the unknown inputs that show it. Errors of the drive act as a torque."""
        found: dict[str, tuple[str, ...]] = {}
        for name in self.entries:
            place = name.partition("_")[0]
            found[place] = (*found.get(place, ()), name)
        return found | ({"drive": found["torque"]} if "torque" in found else {})

    def place_of(self, place: str) -> str:
        """Where an effect of this place of the catalogue acts in this system: friction of a shaft alone is a torque."""
        return "torque" if place == "force" and "force" not in self.places and "torque" in self.places else place

    @property
    def all_contacts(self) -> tuple[Contact, ...]:
        """Contacts that the simulation solves, then those with prescribed motion."""
        return (*self.contacts, *self.prescribed)

    @property
    def channels(self) -> tuple[str, ...]:
        """Every channel of a log that this system uses."""
        return tuple(dict.fromkeys([*self.drives.values(), *self.outputs, *self.measured]))
