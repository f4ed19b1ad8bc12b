"""Valves that a log shows by the pressure that they do not let pass, and hardly by their flow."""

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.diagnosis.law.free_run import definition_of, kept_effect
from ehsa_ctrl.diagnosis.law.inputs import law_inputs
from ehsa_ctrl.diagnosis.objective import NominalParameters
from ehsa_ctrl.diagnosis.place_sets import InjectionCase
from ehsa_ctrl.diagnosis.signals import estimate_noise

#: Parameter of an effect that opens a valve -> the effect, the term of it, and the share of pressures below.
VALVES = {
    "P_open": ("anti_cavitation", "max(at - P, 0)", 0.02),
    "P_crack": ("relief_valve", "max(P - at, 0)", 0.98),
}


def limited(plant, number):
    """The log of a rig with a valve, and the pressure where that opens: beyond it are 2 % of the samples without it."""
    effect, _, share = VALVES[number]
    drive = e.excitation("noise", amplitude=3.0, duration=12.0, sample_time=0.004, seed=3)
    bare, _ = e.record(plant, *drive, centre=True)
    opens = float(np.quantile(np.concatenate([bare["p1"], bare["p2"]]), share))
    log, _ = e.record(plant.with_effects(effect, **{number: opens}), *drive, centre=True)
    return log, opens


def valve_laws(plant, log):
    """Of all unknown inputs of a log."""
    case, none = InjectionCase.of(plant, log, estimate_noise(log)), np.zeros(0)
    fitted = np.ones(len(log) - 1, dtype=bool)
    inputs = law_inputs([case], case.signals, case.unknown.values, fitted, NominalParameters((), none, none, none))
    return [law for one in inputs for law in one.valves]


def error(plant, log):
    """RMS error of the simulated pressures [Pa]."""
    run = e.simulate(plant, log["current"])
    return float(np.sqrt(np.mean([(run[f"P_{i}"] - log[f"p{i}"]) ** 2 for i in (1, 2)])))


@pytest.mark.parametrize("number", VALVES)
def test_a_simulation_with_one_of_the_valves_keeps_the_pressure(plant, number):
    """As it is found, before any refit, one of them opens within a bar of the rig's valve, and leaves less than half of
    the error of the plant without a valve."""
    log, opens = limited(plant, number)
    text = VALVES[number][1]
    laws = [law for law in valve_laws(plant, log) if (law.grammar.name, law.terms[0].text) == ("flows", text)]
    errors = []
    for i, law in enumerate(laws):
        file = definition_of(law, list(plant.parameters))
        valve = kept_effect(f"valve_{number}_{i}", file)
        values = {key: one.value for key, one in file.parameters.items()}
        errors.append(error(plant.with_effects(valve.name, **values), log))
    best = laws[int(np.argmin(errors))]

    assert min(errors) < 0.5 * error(plant, log)
    assert best.terms[0].shapes["at"] == pytest.approx(opens, abs=1e5)


def test_every_valve_opens_within_the_measured_range_and_drains_what_is_too_high(plant):
    laws = valve_laws(plant, limited(plant, "P_crack")[0])

    assert {law.grammar.name for law in laws} == {"flow_1", "flow_2", "flows"}
    for law in laws:
        flow = law.factors[0] * law.grammar.values(law.terms[0])
        (text,) = law.terms[0].variables
        pressure = next(v.values for v in law.grammar.variables if v.text == text)
        opened = flow != 0.0
        assert 0 < opened.sum() < 0.2 * opened.size
        # It takes from a chamber what is above its mean, and adds to one below.
        assert (flow[opened] * (pressure[opened] - np.mean(pressure)) < 0.0).all()


@pytest.mark.slow
def test_a_check_valve_that_the_catalogue_lacks_becomes_a_law(plant):
    """Open for a fiftieth of the time, it has the right variable, form and opening pressure."""
    log, opens = limited(plant, "P_open")
    found = e.diagnose(plant, log, without=("anti_cavitation",))

    assert found.law is not None and found.law.place == "flows"
    file = found.law.forms[0].file
    assert file.form == "c_1 * max(c_at_1 - P, 0)"
    assert file.parameters["c_at_1"].value == pytest.approx(opens, abs=0.3e5)
    assert found.gap["with_law"]["total"] < 0.1 * found.gap["nominal"]["total"]
