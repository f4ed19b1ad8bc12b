"""The model that runs every hypothesis: the plant with all effects of the catalogue, neutral unless set.

A neutral effect leaves the plant as it was to the last bit. A single compiled engine therefore serves every
hypothesis; the free numbers of one are columns of the parameter array.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS, Log
from ..identification.logged_inputs import invert_sensor, logged_inputs, undo_sensor
from ..physics.effects import EFFECTS, Effect, LawSwitch
from ..physics.friction import SYMBOLS
from ..plant.plant import Plant, Sensor
from ..plant.structure import Structure
from ..plant.system import Contact
from ..simulation.engine import simulate_batch
from ..simulation.sensors import shown

#: Friction laws that are (8) with some parameters absent.
IN_STRIBECK = ("none", "viscous", "coulomb", "stribeck")
#: Free numbers by name: parameters of the plant, SETTING.CHANNEL of a sensor, the number of a law switch.
Setting = Mapping[str, float]


def with_every_effect(plant: Plant, rod_friction: str | None = None) -> Plant:
    """The same plant in the structure that holds every effect at its neutral value.

    rod_friction: a law for an effect that replaces the rod's. Otherwise a law that (8) contains becomes (8), so that
        what it lacks can be searched; any other law stays.
    """
    system = plant.structure.system
    laws: dict[str, Any] = {
        f"{contact.name}_friction": "stribeck" if in_stribeck(plant, contact) else plant.structure.law(contact).name
        for contact in system.all_contacts
    }
    if rod_friction is not None and "rod_friction" in laws:
        laws["rod_friction"] = rod_friction
    structure = replace(plant.structure, **laws)
    known = effects_with_parameters()
    wired = [name for name in known if _fits(structure, name)]
    # One order whatever effects the plant has already, so that all plants share the compiled text.
    structure = replace(structure, effects=(*(n for n in plant.structure.effects if n not in known), *wired))
    absent = {p.name: p.neutral for n in wired for p in EFFECTS[n].parameters if n not in plant.structure.effects}
    for contact in system.all_contacts:
        absent |= absent_friction(contact, structure.law(contact).symbols)
    asked = set(structure.equations.parameter_names) - set(plant.parameters)
    return plant.with_structure(structure, **{name: value for name, value in absent.items() if name in asked})


def in_stribeck(plant: Plant, contact: Contact) -> bool:
    """Whether a contact's friction law is (8) with some parameters absent."""
    return plant.structure.law(contact).name in IN_STRIBECK


def left_out_effects(plant: Plant) -> dict[str, str]:
    """Effects of the user's own that the plant can't have, each with the reason; shipped ones fit what they fit."""
    found = {}
    structure = with_every_effect(plant).structure
    for name in effects_with_parameters():
        functions = EFFECTS[name].changes.values()
        if name in structure.effects or all(f.__module__.startswith("ehsa_ctrl.") for f in functions):
            continue
        try:
            _ = replace(structure, effects=(name,)).equations
        except InputError as error:
            found[name] = str(error)
    return found


def absent_friction(contact: Contact, symbols: Iterable[str] = ("A", "C", "tau")) -> dict[str, float]:
    """Parameters of a friction that a contact does not have: no level, and the speed at which a static part decays."""
    values = {name: part.absent for name, part in SYMBOLS.items() if part.absent is not None}
    values["tau"] = contact.stribeck_speed
    return {contact.symbol(symbol): values[symbol] for symbol in symbols if symbol in values}


def effects_with_parameters() -> tuple[str, ...]:
    """Effects with equations and parameters; one without parameters is an option of the plant, not a hypothesis."""
    return tuple(name for name, effect in EFFECTS.items() if effect.wired and effect.parameters)


def law_switches() -> tuple[LawSwitch, ...]:
    """The friction laws that a hypothesis may switch to."""
    return tuple(effect.switch for effect in EFFECTS.values() if effect.switch is not None)


def without_dry_friction(plant: Plant) -> bool:
    """Whether no contact of the plant sticks."""
    levels = [contact.symbol("A") for contact in plant.structure.system.contacts]
    return not any(plant[name] for name in levels if name in plant.parameters)


def _fits(structure: Structure, effect: str) -> bool:
    """Whether a system has what an effect changes and asks for."""
    try:
        return bool(replace(structure, effects=(effect,)).equations)
    except InputError:
        return False


@dataclass(frozen=True)
class HypothesisModel:
    """A plant with every effect, driven by a log.

    plant: see `with_every_effect`. log: what drives it and what it is compared with. start: states at the first sample
    by name, as the nominal sensors give them; states that are not named are at rest. switched: friction law -> the
    plant with that law, for settings that switch to it. tolerance: of the engine.

    In a log with the channel of an effect's `replay`, the effect follows that measured channel, not the simulation.
    """

    plant: Plant
    log: Log
    start: Mapping[str, float] | None = None
    switched: Mapping[str, Plant] = field(default_factory=dict)
    tolerance: float = 1e-5

    @property
    def channels(self) -> tuple[str, ...]:
        """Scored channels of the log, then the load cell where the simulation has one."""
        system = self.plant.structure.system
        simulated = [
            *(one.channel for one in system.scored),
            *([system.cell_channel] if system.cell is not None else []),
        ]
        return tuple(channel for channel in dict.fromkeys(simulated) if channel in self.log.channels)

    def nominal_value(self, name: str) -> float:
        """The value of a free number without any hypothesis."""
        if name in self.plant.parameters:
            return self.plant[name]
        setting, dot, channel = name.partition(".")
        if dot and setting in ("bias", "scale"):
            return float(getattr(self.plant.sensors[channel], setting))
        return 0.0

    def run(self, settings: Sequence[Setting], jobs: int = 1) -> list[dict[str, np.ndarray] | None]:
        """Simulate the log's drive with each setting: what the sensors would show; None where the run stopped."""
        drives = [self._drive(values) for values in settings]
        out: list[dict[str, np.ndarray] | None] = [None] * len(settings)
        groups: dict[tuple[int, str], list[int]] = {}
        for i, values in enumerate(settings):
            switch = self._switch(values)
            groups.setdefault((id(drives[i]), switch.law if switch else ""), []).append(i)
        for members in groups.values():
            switch = self._switch(settings[members[0]])
            plant = self.plant if switch is None else self.switched.get(switch.law, self.plant)
            rows = np.array([self._row(plant, switch, settings[i]) for i in members])
            start = None
            if self.start is not None:
                start = np.array([self._start(plant, settings[i], drives[i]) for i in members])
            batch = simulate_batch(
                plant, rows, drives[members[0]], force=self._outer_input, hold=plant.structure.system.hold,
                start=start, sample_time=self.log.sample_time, tolerance=self.tolerance, jobs=jobs,
            )  # fmt: skip
            for j, i in enumerate(members):
                if batch.status[j] == 0:
                    out[i] = self._readings(batch.states[j], batch.cell_force[j], settings[i])
        return out

    def _switch(self, values: Setting) -> LawSwitch | None:
        return next((switch for switch in law_switches() if switch.active(values)), None)

    def _row(self, plant: Plant, switch: LawSwitch | None, values: Setting) -> np.ndarray:
        """The parameter vector of a setting."""
        of_laws = {name for one in law_switches() for name in (one.number, *one.defaults)}
        changed = {name: value for name, value in values.items() if "." not in name and name not in of_laws}
        changed |= {effect.parameters[0].name: effect.parameters[0].neutral for effect in self._replayed}
        if switch is not None:
            changed |= switch.parameters(values, plant.values)
        row, names = plant.vector.copy(), plant.structure.equations.parameter_names
        for name, value in changed.items():
            row[names.index(name)] = value
        return row

    def _start(self, plant: Plant, values: Setting, drive: np.ndarray) -> np.ndarray:
        """State (n,) at the first sample of a run that starts in motion.

        Readings are corrected for the sensor settings of this hypothesis. States of neutral effects are at rest.
        """
        assert self.start is not None
        state, index = plant.rest.copy(), plant.structure.equations.index
        channels = {name: channel for channel, name in plant.structure.system.outputs.items()}
        names = [s.name for s in plant.structure.equations.states]

        def value(name: str) -> float:
            return values.get(name, plant[name] if name in plant.parameters else 0.0)

        for name, level in self.start.items():
            channel = channels.get(name, "")
            if name in names and channel in self.plant.sensors:
                sensor = self.plant.sensors[channel]
                bias, scale = values.get(f"bias.{channel}", sensor.bias), values.get(f"scale.{channel}", sensor.scale)
                level = (level * sensor.scale + sensor.bias - bias) / scale
            if name in names:
                state[index(name)] = level
        for effect in map(EFFECTS.__getitem__, plant.structure.effects):
            present = effect.parameters and value(effect.parameters[0].name) != effect.parameters[0].neutral
            for own in effect.states:
                if not present:
                    state[index(own.name)] = 0.0
                elif own.starts_at == plant.structure.system.inputs[0]:
                    state[index(own.name)] = drive[0]
        for switch in law_switches():
            asked = inspect.signature(switch.deflection).parameters
            if switch.state in names and all(name in names or name in plant.parameters for name in asked):
                given = {name: state[index(name)] if name in names else value(name) for name in asked}
                compliance = values[switch.number] if switch.active(values) else 1.0 / plant[switch.parameter]
                state[index(switch.state)] = switch.deflection(**given) * compliance
        return state

    @cached_property
    def _replayed(self) -> tuple[Effect, ...]:
        """Effects that follow a measured channel of this log."""
        own = map(EFFECTS.__getitem__, self.plant.structure.effects)
        return tuple(e for e in own if e.replay is not None and e.replay.channel in self.log.channels)

    @cached_property
    def _nominal_drive(self) -> np.ndarray:
        """The drive (N,) that acted on the rig if the drive's sensor is as the plant says."""
        return undo_sensor(self.plant, self.log, self.plant.structure.system.drive)

    @cached_property
    def _outer_input(self) -> np.ndarray | None:
        """The second input (N,), where the log has it."""
        return logged_inputs(self.plant, self.log)[1]

    def _drive(self, values: Setting) -> np.ndarray:
        """The drive (N,) of a setting: what acted on the rig, and what replayed effects add to it."""
        drive, system = self._nominal_drive, self.plant.structure.system
        if any(values.get(f"{setting}.{system.drive}") for setting in ("delay", "filter")):
            sensor = self.sensor(system.drive, values)
            held = system.hold == "zero_order"
            drive = invert_sensor(sensor, self.log[system.drive], self.log.sample_time, held=held)
        for effect in self._replayed:
            assert effect.replay is not None
            merged = {**self.plant.values, **values}
            if merged[effect.parameters[0].name] != effect.parameters[0].neutral:
                drive = drive + effect.replay.drive(merged, self.log)
        return drive

    def _readings(self, states: np.ndarray, force: np.ndarray, values: Setting) -> dict[str, np.ndarray]:
        index, system = self.plant.structure.equations.index, self.plant.structure.system
        out = {}
        for channel in self.channels:
            signal = force if channel == system.cell_channel else states[:, index(system.outputs[channel])]
            out[channel] = shown(self.sensor(channel, values), signal, self.log.sample_time)
        return out

    def sensor(self, channel: str, values: Setting) -> Sensor:
        """A channel's sensor under a setting; delays and filters add to those that the plant's sensor has."""
        sensor = self.plant.sensors.get(channel) or Sensor(channel, CHANNELS[channel].unit)
        return replace(
            sensor,
            scale=values.get(f"scale.{channel}", sensor.scale),
            bias=values.get(f"bias.{channel}", sensor.bias),
            delay=sensor.delay + values.get(f"delay.{channel}", 0.0),
            filter=sensor.filter + values.get(f"filter.{channel}", 0.0),
        )
