"""The FMU's slave: pythonfmu's interface to a stepped run of the plant."""

from __future__ import annotations

from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

from pythonfmu import Boolean, DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

from ...core.errors import EhsaError, InputError
from ...core.unit import base_units
from ..stepped_run import SteppedRun
from .exported import read_exported
from .variables import Variable, variables_of

TOLERANCE = 1e-6


class PlantSlave(Fmi2Slave):  # type: ignore[misc]
    """A plant as an FMI 2.0 slave: steps of any length with held inputs, and a state that can be saved and restored.

    The plant is in the FMU's resources. Parameters can be set until the end of the initialisation; the run starts at
    rest: x = x_0, P_1 = P_2 = P_0.
    """

    author = "ehsa_ctrl"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._plant, written_by = read_exported(Path(self.resources))
        self._variables = {variable.name: variable for variable in variables_of(self._plant)}
        self._inputs = dict.fromkeys(self._plant.structure.system.inputs, 0.0)
        self._changed: dict[str, float] = {}
        self._tolerance = TOLERANCE
        self._run: SteppedRun | None = None
        self._begun = False
        self.description = f"{self._plant.title} ({self._plant.model} model); SI units, forces resist extension"
        self.version = written_by
        self.default_experiment = DefaultExperiment(
            start_time=0.0, stop_time=1.0, step_size=self._plant.sample_time, tolerance=TOLERANCE
        )
        if version("ehsa_ctrl") != written_by:
            self.log(
                f"written by ehsa_ctrl {written_by}, run by {version('ehsa_ctrl')}: numbers may differ",
                Fmi2Status.warning,
            )
        for variable in self._variables.values():
            self._register(variable)

    def _register(self, variable: Variable) -> None:
        name, signal = variable.name, variable.signal
        if variable.kind == "flag":
            how = {"causality": Fmi2Causality.output, "variability": Fmi2Variability.discrete}
            getter = partial(self._sticks, signal)
            self.register_variable(Boolean(name, description=variable.meaning, getter=getter, **how), nested=False)
            return
        if variable.kind == "input":
            how = {"causality": Fmi2Causality.input}
            reach = {"getter": partial(self._inputs.__getitem__, signal), "setter": partial(self._feed, signal)}
        elif variable.kind == "parameter":
            how = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
            reach = {"getter": partial(self._value, signal), "setter": partial(self._set, signal)}
        else:
            how = {"causality": Fmi2Causality.output}
            reach = {"getter": partial(self._output, signal)}
        self.register_variable(Real(name, description=variable.meaning, **how, **reach), nested=False)

    @property
    def run(self) -> SteppedRun:
        """The run; a new one after a parameter has changed."""
        if self._run is None:
            self._run = SteppedRun(self._plant.set(**self._changed), tolerance=self._tolerance)
        return self._run

    def _feed(self, name: str, value: float) -> None:
        self._inputs[name] = float(value)

    def _value(self, symbol: str) -> float:
        return self._changed.get(symbol, self._plant[symbol])

    def _set(self, symbol: str, value: float) -> None:
        if value == self._value(symbol):
            return
        if self._begun:
            raise InputError(f"{symbol} can't be set once the run has begun; set it before the initialisation ends")
        self._changed[symbol] = float(value)
        self._run = None

    def _output(self, signal: str) -> float:
        if signal == "F_cell":
            current, force = self._inputs.values()
            return self.run.cell_force(current, force)
        return float(self.run.states[self._plant.structure.equations.index(signal)])

    def _sticks(self, contact: str) -> bool:
        return self.run.sticks(contact)

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Use the tool's relative tolerance as that of the engine, which is relative to the states' scales."""
        if tolerance:
            self._tolerance, self._run = float(tolerance), None

    def exit_initialization_mode(self) -> None:
        """Fix the parameters. Raises InputError for a physically impossible one."""
        self.run  # noqa: B018 - it checks them
        self._begun = True

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance by one step; False, with a sentence in the log, if the engine stops."""
        try:
            current, force = self._inputs.values()
            self.run.advance(current, force, step_size)
        except EhsaError as error:
            self.log(str(error), Fmi2Status.error)
            return False
        return True

    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "run": self.run.snapshot(),
            "inputs": dict(self._inputs),
            "changed": dict(self._changed),
            "tolerance": self._tolerance,
            "begun": self._begun,
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._inputs.update(state["inputs"])
        self._changed, self._tolerance = dict(state["changed"]), float(state["tolerance"])
        self._begun, self._run = bool(state["begun"]), None
        self.run.restore(state["run"])

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """The model description, with what pythonfmu omits: units, ranges, all digits, initial unknowns."""
        root: Element = super().to_xml(model_options or {})
        root.set("generationTool", f"ehsa_ctrl {version('ehsa_ctrl')}, {root.get('generationTool')}")
        described = {v.name: v for v in self._variables.values() if v.kind != "flag"}
        for scalar in root.iterfind("ModelVariables/ScalarVariable"):
            real, variable = scalar.find("Real"), described.get(str(scalar.get("name")))
            if real is None or variable is None:
                continue
            written = {"unit": variable.unit, "min": variable.lower, "max": variable.upper, "start": variable.start}
            real.attrib.clear()
            real.attrib.update({key: str(value) for key, value in written.items() if value is not None})
        place = [child.tag for child in root].index("CoSimulation") + 1
        root.insert(place, _unit_definitions({variable.unit for variable in described.values()}))
        structure = root.find("ModelStructure")
        outputs = root.findall("ModelStructure/Outputs/Unknown")
        if structure is not None and outputs:
            unknowns = SubElement(structure, "InitialUnknowns")
            for output in outputs:
                SubElement(unknowns, "Unknown", {"index": str(output.get("index"))})
        return root


def _unit_definitions(units: set[str]) -> Element:
    definitions = Element("UnitDefinitions")
    for unit in sorted(units):
        entry = SubElement(definitions, "Unit", {"name": unit})
        exponents = base_units(unit)
        # FMI only has whole exponents; a unit with a root of a pascal remains a name.
        if all(exponent == int(exponent) for exponent in exponents.values()):
            SubElement(entry, "BaseUnit", {base: str(int(exponent)) for base, exponent in exponents.items()})
    return definitions
