"""The model of all hypotheses: the plant with all effects of the catalogue, each neutral unless a hypothesis sets it.

An effect at its neutral value does not change the plant, to the last bit. Each hypothesis is therefore simulated with
those effects alone that act in it: a run with all of them takes three times as long.
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
from ..physics.effects import EFFECTS, Effect, LawSwitch, with_extended
from ..physics.friction import SYMBOLS
from ..plant.plant import Plant, Sensor
from ..plant.structure import Structure
from ..plant.system import Contact
from ..simulation.engine import simulate_batch
from ..simulation.sensors import noise_free_reading
from .own_offsets import shared_name, values_in_log

#: Friction laws that are special cases of (8), with some parameters zero.
STRIBECK_SPECIAL_CASES = ("none", "viscous", "coulomb", "stribeck")
#: Parameters of a hypothesis by name: of the plant, SETTING.CHANNEL of a sensor, or the number of a law switch. Those
#: not named have their nominal values.
Setting = Mapping[str, float]


def with_every_effect(plant: Plant, rod_friction: str | None = None) -> Plant:
    """The same plant with all effects that fit it, at their neutral values.

    rod_friction: friction law of the rod, for a hypothesis that replaces it. By default a special case of (8) becomes
        (8), so that its missing terms can be estimated; any other law is kept.
    """
    system = plant.structure.system
    laws: dict[str, Any] = {
        f"{contact.name}_friction": "stribeck"
        if is_stribeck_special_case(plant, contact)
        else plant.structure.law(contact).name
        for contact in system.all_contacts
    }
    if rod_friction is not None and "rod_friction" in laws:
        laws["rod_friction"] = rod_friction
    structure = replace(plant.structure, **laws)
    known = effects_with_parameters()
    wired = [name for name in known if is_applicable(structure, name)]
    # The same order for all plants, whatever effects they have, so that they share the compiled engine.
    structure = replace(structure, effects=(*(n for n in plant.structure.effects if n not in known), *wired))
    absent = {p.name: p.neutral for n in wired for p in EFFECTS[n].parameters if n not in plant.structure.effects}
    for contact in system.all_contacts:
        absent |= absent_friction(contact, structure.law(contact).symbols)
    asked = set(structure.equations.parameter_names) - set(plant.parameters)
    return plant.with_structure(structure, **{name: value for name, value in absent.items() if name in asked})


def is_stribeck_special_case(plant: Plant, contact: Contact) -> bool:
    """Whether a contact's friction law is a special case of (8)."""
    return plant.structure.law(contact).name in STRIBECK_SPECIAL_CASES


def inapplicable_effects(plant: Plant) -> dict[str, str]:
    """User-defined effects that do not fit the plant: name -> reason. Shipped effects are omitted without a reason."""
    found = {}
    structure = with_every_effect(plant).structure
    for name in effects_with_parameters():
        functions = EFFECTS[name].changes.values()
        if name in structure.effects or all(f.__module__.startswith("ehsa_ctrl.") for f in functions):
            continue
        try:
            _ = replace(structure, effects=with_extended([name])).equations
        except InputError as error:
            found[name] = str(error)
    return found


def absent_friction(contact: Contact, symbols: Iterable[str] = ("A", "C", "tau")) -> dict[str, float]:
    """Values of friction parameters that a contact lacks: level zero, tau the contact's Stribeck speed."""
    values = {name: part.absent for name, part in SYMBOLS.items() if part.absent is not None}
    values["tau"] = contact.stribeck_speed
    return {contact.symbol(symbol): values[symbol] for symbol in symbols if symbol in values}


def effects_with_parameters() -> tuple[str, ...]:
    """Effects with equations and parameters. One without parameters is an option of the plant, not a hypothesis."""
    return tuple(name for name, effect in EFFECTS.items() if effect.wired and effect.parameters)


def law_switches() -> tuple[LawSwitch, ...]:
    """Replacements of the rod's friction law that a hypothesis may contain."""
    return tuple(effect.switch for effect in EFFECTS.members().values() if effect.switch is not None)


def lacks_dry_friction(plant: Plant) -> bool:
    """Whether no contact of the plant has dry friction (A = 0 for all)."""
    levels = [contact.symbol("A") for contact in plant.structure.system.contacts]
    return not any(plant[name] for name in levels if name in plant.parameters)


def is_applicable(structure: Structure, effect: str) -> bool:
    """Whether a system has the signals that an effect changes and needs."""
    try:
        return bool(replace(structure, effects=with_extended([effect])).equations)
    except InputError:
        return False


@dataclass(frozen=True)
class HypothesisModel:
    """A plant with every effect, driven by a log.

    plant: see `with_every_effect`. log: gives the inputs and the measurements. start: state -> value at the first
    sample, by the nominal sensors; states that are missing are at rest. plants_by_law: friction law -> plant with this
    law, for hypotheses that replace the rod's. tolerance: relative, of the engine. label: of the log among several,
    for numbers that act in it alone (`own_offsets`).

    If the log has the channel of an effect's `replay`, this effect follows the measurement, not the simulation.
    """

    plant: Plant
    log: Log
    start: Mapping[str, float] | None = None
    plants_by_law: Mapping[str, Plant] = field(default_factory=dict)
    tolerance: float = 1e-5
    label: str = ""

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that are compared: those of the scored signals, then the load cell if the system has one."""
        system = self.plant.structure.system
        simulated = [
            *(one.channel for one in system.scored),
            *([system.cell_channel] if system.cell is not None else []),
        ]
        return tuple(channel for channel in dict.fromkeys(simulated) if channel in self.log.channels)

    def nominal_value(self, name: str) -> float:
        """Nominal value of a parameter: of the plant, of a sensor, or 0 for the number of a law switch."""
        name = shared_name(name)
        if name in self.plant.parameters:
            return self.plant[name]
        setting, dot, channel = name.partition(".")
        if dot and setting in ("bias", "scale"):
            return float(getattr(self.plant.sensors[channel], setting))
        return 0.0

    def run(self, settings: Sequence[Setting], jobs: int = 1) -> list[dict[str, np.ndarray] | None]:
        """Simulate each setting with the logged inputs: channel -> sensor reading (N,); None if the run stopped."""
        settings = [values_in_log(values, self.label) for values in settings]
        drives = [self._drive(values) for values in settings]
        out: list[dict[str, np.ndarray] | None] = [None] * len(settings)
        plants = [self._acting_plant(values) for values in settings]
        groups: dict[tuple[int, int], list[int]] = {}
        for i in range(len(settings)):
            groups.setdefault((id(drives[i]), id(plants[i])), []).append(i)
        for members in groups.values():
            plant = plants[members[0]]
            rows = np.array([self._row(plant, settings[i]) for i in members])
            start = None
            if self.start is not None:
                start = np.array([self._start(plant, settings[i], drives[i]) for i in members])
            batch = simulate_batch(
                plant, rows, drives[members[0]], force=self._outer_input, hold=plant.structure.system.hold,
                start=start, sample_time=self.log.sample_time, tolerance=self.tolerance, jobs=jobs,
            )  # fmt: skip
            for j, i in enumerate(members):
                if batch.status[j] == 0:
                    out[i] = self._readings(plant, batch.states[j], batch.cell_force[j], settings[i])
        return out

    def _acting_plant(self, values: Setting) -> Plant:
        """The plant with the friction law of a setting and those effects alone that act in it."""
        switch = self._switch(values)
        law = "" if switch is None else switch.law
        full = self.plants_by_law.get(law, self.plant)
        acts = {
            effect.name: effect.name in full.structure.effects
            and (not effect.parameters or any(values.get(p.name, full[p.name]) != p.neutral for p in effect.parameters))
            for effect in self._simulated_effects
        }
        extended = {name: EFFECTS[name].extends for name in acts}
        acting = tuple(name for name, present in acts.items() if present and acts.get(extended[name], True))
        known = self._acting_plants.get((law, acting))
        if known is None:
            known = full.with_structure(replace(full.structure, effects=acting))
        return self._acting_plants.setdefault((law, acting), known)

    @cached_property
    def _acting_plants(self) -> dict[tuple[str, tuple[str, ...]], Plant]:
        """(law of a switch, names of the effects) -> plant."""
        return {}

    def _switch(self, values: Setting) -> LawSwitch | None:
        return next((switch for switch in law_switches() if switch.active(values)), None)

    def _row(self, plant: Plant, values: Setting) -> np.ndarray:
        """The parameter vector of a setting; parameters of effects that the plant lacks are left out."""
        switch = self._switch(values)
        of_laws = {name for one in law_switches() for name in (one.number, *one.defaults)}
        changed = {name: value for name, value in values.items() if "." not in name and name not in of_laws}
        if switch is not None:
            changed |= switch.parameters(values, plant.values)
        row, names = plant.vector.copy(), plant.structure.equations.parameter_names
        for name, value in changed.items():
            if name in names or name not in self.plant.parameters:
                row[names.index(name)] = value
        return row

    def _start(self, plant: Plant, values: Setting, drive: np.ndarray) -> np.ndarray:
        """State (n,) at the first sample of a run that starts in motion.

        Measured states are corrected for the sensor errors of the hypothesis. States of neutral effects are zero.
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
    def _replay_effects(self) -> tuple[Effect, ...]:
        """Effects that follow a measured channel of the log."""
        own = map(EFFECTS.__getitem__, self.plant.structure.effects)
        return tuple(e for e in own if e.replay is not None and e.replay.channel in self.log.channels)

    @cached_property
    def _simulated_effects(self) -> tuple[Effect, ...]:
        """The other effects of the plant."""
        own = map(EFFECTS.__getitem__, self.plant.structure.effects)
        return tuple(e for e in own if e not in self._replay_effects)

    @cached_property
    def _nominal_drive(self) -> np.ndarray:
        """The drive (N,) that acted on the rig, from the log by the nominal sensor of the drive."""
        return undo_sensor(self.plant, self.log, self.plant.structure.system.drive)

    @cached_property
    def _outer_input(self) -> np.ndarray | None:
        """The second input (N,) if the log has it."""
        return logged_inputs(self.plant, self.log)[1]

    def _drive(self, values: Setting) -> np.ndarray:
        """The drive (N,) under a setting: what acted on the rig, plus the contribution of replayed effects."""
        drive, system = self._nominal_drive, self.plant.structure.system
        if any(values.get(f"{setting}.{system.drive}") for setting in ("delay", "filter")):
            sensor = self.sensor(system.drive, values)
            held = system.hold == "zero_order"
            drive = invert_sensor(sensor, self.log[system.drive], self.log.sample_time, held=held)
        for effect in self._replay_effects:
            assert effect.replay is not None
            merged = {**self.plant.values, **values}
            if merged[effect.parameters[0].name] != effect.parameters[0].neutral:
                drive = drive + effect.replay.drive(merged, self.log)
        return drive

    def _readings(self, plant: Plant, states: np.ndarray, force: np.ndarray, values: Setting) -> dict[str, np.ndarray]:
        """Channel -> sensor reading (N,) from states (N, n) of a plant and load cell force (N,)."""
        index, system = plant.structure.equations.index, plant.structure.system
        out = {}
        for channel in self.channels:
            signal = force if channel == system.cell_channel else states[:, index(system.outputs[channel])]
            out[channel] = noise_free_reading(self.sensor(channel, values), signal, self.log.sample_time)
        return out

    def sensor(self, channel: str, values: Setting) -> Sensor:
        """A channel's sensor under a setting; its delay and filter add to the nominal ones."""
        sensor = self.plant.sensors.get(channel) or Sensor(channel, CHANNELS[channel].unit)
        return replace(
            sensor,
            scale=values.get(f"scale.{channel}", sensor.scale),
            bias=values.get(f"bias.{channel}", sensor.bias),
            delay=sensor.delay + values.get(f"delay.{channel}", 0.0),
            filter=sensor.filter + values.get(f"filter.{channel}", 0.0),
        )
