"""One engine for all effects: the plant with every effect of the catalogue, all of them neutral until asked for.

A neutral effect leaves the plant as it was to the last bit, so that a single compiled text serves every hypothesis,
and what is free in one is a column of numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..core.errors import InputError
from ..core.log import Log
from ..identification.drives import logged_drives, undo_sensor, undone
from ..physics.effects import EFFECTS
from ..physics.effects.presliding import DAMPING, HARD, SOFTNESS
from ..plant.plant import Plant, Sensor
from ..plant.structure import Structure
from ..simulation.engine import simulate_batch
from ..simulation.sensors import shown
from .ripple import ANGLE, over_samples

#: Symbols of dry friction, which a plant without it lacks, and what they are where it is to be found.
DRY = {"A_FM": 0.0, "C_FM": 0.0, "tau_FM": 10.0, "A_FR": 0.0, "C_FR": 0.0, "tau_FR": 0.007}


def with_every_effect(plant: Plant, rod_friction: str | None = None) -> Plant:
    """The same plant in the structure that holds every effect at its neutral value.

    rod_friction: "stribeck", or "lugre" for presliding, which is another law and not a number of this one; that of the
        plant by default.
    """
    if rod_friction is None:
        rod_friction = "lugre" if plant.structure.rod_friction == "lugre" else "stribeck"
    system = plant.structure.system
    shaft = "stribeck" if any(contact.name == "shaft" for contact in system.all_contacts) else None
    structure = replace(plant.structure, shaft_friction=shaft, rod_friction=rod_friction)
    known = equations_of_their_own()
    wired = [name for name in known if _fits(structure, name)]
    # In one order whatever the plant has already, so that all of them share the compiled text.
    structure = replace(structure, effects=(*(n for n in plant.structure.effects if n not in known), *wired))
    neutral = {p.name: p.neutral for n in wired for p in EFFECTS[n].parameters if n not in plant.structure.effects}
    extra = {"sigma_0_FR": 1e8, "sigma_1_FR": 0.0} if rod_friction == "lugre" else {}
    absent = {system.own(name): value for name, value in {**DRY, **neutral, **extra}.items()}
    asked = set(structure.equations.parameter_names) - set(plant.parameters)
    return plant.with_structure(structure, **{name: value for name, value in absent.items() if name in asked})


def equations_of_their_own() -> tuple[str, ...]:
    """Effects that are equations with numbers; a tank with a mass balance, without one, is an option of the plant."""
    return tuple(name for name, effect in EFFECTS.items() if effect.wired and effect.parameters)


def without_dry_friction(plant: Plant) -> bool:
    """Whether no contact of the plant sticks."""
    levels = [contact.symbol("A") for contact in plant.structure.system.contacts]
    return not any(plant[name] for name in levels if name in plant.parameters)


def _fits(structure: Structure, effect: str) -> bool:
    """Whether a system has what an effect changes and asks for."""
    try:
        return bool(replace(structure, effects=(effect,)).equations)
    except (InputError, TypeError):
        return False


@dataclass(frozen=True)
class Twin:
    """A plant with every effect, driven by a log.

    plant: see `with_every_effect`. log: what drives it and what it is compared with. start: states at the first
    sample by name, as the believed sensors give them; those that are not named are at rest. bristles: the plant with
    a rod friction of bristles, for settings that name SOFTNESS. tolerance: of the engine.

    In a log that has an angle (see `with_angle`) a torque ripple goes with it and not with the simulated one: a run
    whose speed is a little wrong is soon wrong by turns, and its ripple is noise. That is what a free run of such a
    plant is, but no search gets anywhere with it.
    """

    plant: Plant
    log: Log
    start: Mapping[str, float] | None = None
    bristles: Plant | None = None
    tolerance: float = 1e-5

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of the log that the simulation has too."""
        system = self.plant.structure.system
        known = {*system.outputs, *(["force"] if system.cell is not None else [])}
        return tuple(c for c in ("speed", "p1", "p2", "position", "force") if c in known & set(self.log.channels))

    def run(self, settings: Sequence[Mapping[str, float]], jobs: int = 1) -> list[dict[str, np.ndarray] | None]:
        """Simulate the log's drive with each set of values: what the sensors would show; None where it stopped.

        A setting is a symbol of the plant or WORD.CHANNEL of a sensor.
        """
        current = [self._drive(values) for values in settings]
        out: list[dict[str, np.ndarray] | None] = [None] * len(settings)
        groups: dict[tuple[int, bool], list[int]] = {}
        for i, values in enumerate(settings):
            groups.setdefault((id(current[i]), values.get(SOFTNESS, 0.0) > HARD), []).append(i)
        for (_, bristly), members in groups.items():
            plant = self.bristles if bristly and self.bristles is not None else self.plant
            names = plant.structure.equations.parameter_names
            rows = np.tile(plant.vector, (len(members), 1))
            for row, i in zip(rows, members, strict=True):
                for name, value in settings[i].items():
                    if "." not in name and name != SOFTNESS and (bristly or name != DAMPING):
                        row[names.index(name)] = value
                if ANGLE in self.log.channels:
                    row[names.index("T_c")] = 0.0
                if bristly:
                    row[names.index("sigma_0_FR")] = 1.0 / settings[i][SOFTNESS]
                    # Bristles that are as damped as the rod's mass on them lets them be.
                    usual = np.sqrt(plant["M"] / settings[i][SOFTNESS])
                    row[names.index(DAMPING)] = settings[i].get(DAMPING, usual)
            start = None
            if self.start is not None:
                start = np.array([self._start(plant, settings[i], current[i]) for i in members])
            batch = simulate_batch(
                plant, rows, current[members[0]], force=self._outside, hold=plant.structure.system.hold, start=start,
                sample_time=self.log.sample_time, tolerance=self.tolerance, jobs=jobs,
            )  # fmt: skip
            for j, i in enumerate(members):
                if batch.status[j] == 0:
                    out[i] = self._sensed(batch.states[j], batch.cell_force[j], settings[i])
        return out

    def _start(self, plant: Plant, values: Mapping[str, float], current: np.ndarray) -> np.ndarray:
        """State (n,) at the first sample of a run that begins in motion.

        What a sensor shows is set right by what this setting believes of it. States of effects that are neutral rest.
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
            felt = effect.parameters and value(effect.parameters[0].name) != effect.parameters[0].neutral
            for own in effect.states:
                if not felt:
                    state[index(own.name)] = 0.0
                elif own.starts_at == plant.structure.system.inputs[0]:
                    state[index(own.name)] = current[0]
        if "z_R" in names and "P_1" in names:
            net = value("A") * (state[index("P_1")] - state[index("P_2")]) - value("K_S") * state[index("x")]
            most = value("A_FR") + value("C_FR")
            soft = values.get(SOFTNESS, 0.0)
            state[index("z_R")] = np.clip(net, -most, most) * (soft if soft > HARD else 1.0 / plant["sigma_0_FR"])
        return state

    @cached_property
    def _asked(self) -> np.ndarray:
        """What drove the rig (N,) if the drive's sensor is as believed."""
        return undo_sensor(self.plant, self.log, self.plant.structure.system.drive)

    @cached_property
    def _outside(self) -> np.ndarray | None:
        """What acts on the rig from outside (N,), where the log has it."""
        return logged_drives(self.plant, self.log)[1]

    def _drive(self, values: Mapping[str, float]) -> np.ndarray:
        """What drove the rig (N,) when this was logged, a ripple that is followed among it."""
        drive, system = self._asked, self.plant.structure.system
        if any(values.get(f"{word}.{system.drive}") for word in ("delay", "filter")):
            nominal = self._nominal_sensor(system.drive, values)
            held = system.hold == "zero_order"
            drive = undone(nominal, self.log[system.drive], self.log.sample_time, held=held)
        if ANGLE not in self.log.channels:
            return drive
        amplitude, order, phase, K_T = (values.get(name, self.plant[name]) for name in ("T_c", "n_c", "phi_c", "K_T"))
        if amplitude:
            wave = over_samples(self.log, order, phase)
            drive = drive + amplitude / K_T * np.append(wave, 0.0)
        return drive

    def _sensed(self, states: np.ndarray, force: np.ndarray, values: Mapping[str, float]) -> dict[str, np.ndarray]:
        index, outputs = self.plant.structure.equations.index, self.plant.structure.system.outputs
        out = {}
        for channel in self.channels:
            signal = force if channel == "force" else states[:, index(outputs[channel])]
            out[channel] = self._sensor(channel, signal, values)
        return out

    def _sensor(self, channel: str, signal: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
        return shown(self._nominal_sensor(channel, values), signal, self.log.sample_time)

    def _nominal_sensor(self, channel: str, values: Mapping[str, float]) -> Sensor:
        """A channel's sensor in a setting: delays and filters come on top of what the plant's has already."""
        sensor = self.plant.sensors.get(channel) or Sensor(channel, "A")
        return replace(
            sensor,
            scale=values.get(f"scale.{channel}", sensor.scale),
            bias=values.get(f"bias.{channel}", sensor.bias),
            delay=sensor.delay + values.get(f"delay.{channel}", 0.0),
            filter=sensor.filter + values.get(f"filter.{channel}", 0.0),
        )
