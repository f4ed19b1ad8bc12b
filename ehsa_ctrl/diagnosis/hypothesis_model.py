"""The model of all hypotheses: the plant with all effects of the catalogue, each neutral unless a hypothesis sets it.

An effect at its neutral value does not change the plant, to the last bit. Each hypothesis is therefore simulated with
those effects alone that act in it: a run with all of them takes three times as long. A negligible effect does not act
(`EffectParameter.negligible`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.log import CHANNELS, Log
from ..identification.logged_inputs import invert_sensor, logged_inputs, undo_sensor
from ..physics.effects import EFFECTS, Effect, with_extended
from ..physics.friction import SYMBOLS
from ..plant.plant import Plant, Sensor
from ..plant.structure import Structure
from ..plant.system import Contact
from ..simulation.engine import simulate_batch
from ..simulation.sensors import noise_free_reading
from .acting_model import ActingModel, ActingModels
from .own_offsets import shared_name, values_in_log

#: Friction laws that are special cases of (8), with some parameters zero.
STRIBECK_SPECIAL_CASES = ("none", "viscous", "coulomb", "stribeck")
#: Drives that a model keeps for the next settings: more than a Jacobian has with a ripple.
KEPT_DRIVES = 32
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
    for numbers that act in it alone (`own_offsets`). shared: models by what acts, of all models that came from one by
    `replace`, such as those of windows.

    If the log has the channel of an effect's `replay`, this effect follows the measurement, not the simulation.
    """

    plant: Plant
    log: Log
    start: Mapping[str, float] | None = None
    plants_by_law: Mapping[str, Plant] = field(default_factory=dict)
    tolerance: float = 1e-5
    label: str = ""
    shared: dict[object, ActingModels] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
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

    def run(
        self, settings: Sequence[Setting], start: Mapping[str, float] | None = None
    ) -> list[dict[str, np.ndarray] | None]:
        """Simulate each setting with the logged inputs: channel -> sensor reading (N,); None if the run stopped.

        start: in the place of the model's.
        """
        first = self.start if start is None else start
        settings = [values_in_log(values, self.label) for values in settings]
        drives = [self._drive(values) for values in settings]
        out: list[dict[str, np.ndarray] | None] = [None] * len(settings)
        acting = [self._acting.of(values) for values in settings]
        groups: dict[tuple[int, int], list[int]] = {}
        for i in range(len(settings)):
            groups.setdefault((id(drives[i]), id(acting[i])), []).append(i)
        for members in groups.values():
            one, drive = acting[members[0]], drives[members[0]]
            rows = np.array([one.parameters(self._acting.changed(one, settings[i])) for i in members])
            states = None
            if first is not None:
                given = first, self.plant.sensors, drive[0], self._acting.switches
                states = np.array([one.start(settings[i], *given) for i in members])
            batch = simulate_batch(
                one.plant, rows, drive, force=self._outer_input, hold=self.plant.structure.system.hold,
                start=states, sample_time=self.log.sample_time, tolerance=self.tolerance, jobs=1,
            )  # fmt: skip
            for j, i in enumerate(members):
                if batch.status[j] == 0:
                    out[i] = self._readings(one, batch.states[j], batch.cell_force[j], settings[i])
        return out

    @cached_property
    def _acting(self) -> ActingModels:
        replayed = tuple(effect.name for effect in self._replay_effects)
        # What is kept holds these plants, so that no other one can have their identities.
        key = id(self.plant), id(self.plants_by_law), replayed
        return self.shared.setdefault(key, ActingModels(self.plant, self.plants_by_law, replayed))

    @cached_property
    def _replay_effects(self) -> tuple[Effect, ...]:
        """Effects that follow a measured channel of the log."""
        own = map(EFFECTS.__getitem__, self.plant.structure.effects)
        return tuple(e for e in own if e.replay is not None and e.replay.channel in self.log.channels)

    @cached_property
    def _nominal_drive(self) -> np.ndarray:
        """The drive (N,) that acted on the rig, from the log by the nominal sensor of the drive."""
        return undo_sensor(self.plant, self.log, self.plant.structure.system.drive)

    @cached_property
    def _outer_input(self) -> np.ndarray | None:
        """The second input (N,) if the log has it."""
        return logged_inputs(self.plant, self.log)[1]

    def _drive(self, values: Setting) -> np.ndarray:
        """The drive (N,) under a setting: what acted on the rig, plus the contribution of replayed effects.

        The same array for the same drive: settings with one drive are simulated together.
        """
        system = self.plant.structure.system
        late = any(values.get(f"{setting}.{system.drive}") for setting in ("delay", "filter"))
        sensor = self.sensor(system.drive, values) if late else None
        added = []
        for effect in self._replay_effects:
            assert effect.replay is not None
            own = {name: values.get(name, self.plant[name]) for name in effect.replay.symbols}
            if own[effect.parameters[0].name] != effect.parameters[0].neutral:
                added.append((effect, tuple(own.items())))
        key = sensor, tuple(added)
        known = self._drives.get(key)
        if known is not None:
            return known
        drive = self._nominal_drive
        if sensor is not None:
            held = system.hold == "zero_order"
            drive = invert_sensor(sensor, self.log[system.drive], self.log.sample_time, held=held)
        for effect, items in added:
            assert effect.replay is not None
            drive = drive + effect.replay.drive(dict(items), self.log)
        if len(self._drives) >= KEPT_DRIVES:
            self._drives.clear()
        return self._drives.setdefault(key, drive)

    @cached_property
    def _drives(self) -> dict[object, np.ndarray]:
        """The last drives (N,) by what they depend on."""
        return {}

    def _readings(
        self, acting: ActingModel, states: np.ndarray, force: np.ndarray, values: Setting
    ) -> dict[str, np.ndarray]:
        """Channel -> sensor reading (N,) from states (N, n) of a model and load cell force (N,)."""
        system, out = self.plant.structure.system, {}
        for channel in self.channels:
            signal = force if channel == system.cell_channel else states[:, acting.positions[system.outputs[channel]]]
            out[channel] = noise_free_reading(self.sensor(channel, values), signal, self.log.sample_time)
        return out

    def sensor(self, channel: str, values: Setting) -> Sensor:
        """A channel's sensor under a setting; its delay and filter add to the nominal ones."""
        sensor = self.plant.sensors.get(channel) or Sensor(channel, CHANNELS[channel].unit)
        if not any(f"{setting}.{channel}" in values for setting in ("scale", "bias", "delay", "filter")):
            return sensor
        return replace(
            sensor,
            scale=values.get(f"scale.{channel}", sensor.scale),
            bias=values.get(f"bias.{channel}", sensor.bias),
            delay=sensor.delay + values.get(f"delay.{channel}", 0.0),
            filter=sensor.filter + values.get(f"filter.{channel}", 0.0),
        )
