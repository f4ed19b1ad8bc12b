"""The next experiment between forms of a law that a log can't tell apart."""

import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.diagnosis.law.begin import Begin
from ehsa_ctrl.diagnosis.law.experiment import form_experiment, renamed
from ehsa_ctrl.diagnosis.law.found import FoundLaw
from ehsa_ctrl.diagnosis.law.proposed import LawForm, ProposedLaw
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs
from ehsa_ctrl.diagnosis.records import Segment
from ehsa_ctrl.physics.effects import EFFECTS, LawFile, effect_of


def law(expression, values, states=None):
    """A law of the carriage's friction. values: parameter -> value and unit; the first ones are factors."""
    parameters = {
        name: {"value": value, "unit": unit, **({"neutral": 0.0} if name in ("c_1", "c_2") else {})}
        for name, (value, unit) in values.items()
    }
    return LawFile.model_validate(
        {
            "schema": 1, "status": "proposed", "summary": "a form", "adds_to": "force", "expression": expression,
            "parameters": parameters, "states": states or {},
        }
    )  # fmt: skip


VISCOUS = law("c_1 * d_R + c_2 * v", {"c_1": (20.0, "N"), "c_2": (200.0, "N s/m")})
SQUARE = law("c_1 * d_R + c_2 * v * abs(v)", {"c_1": (27.0, "N"), "c_2": (1200.0, "N s2/m2")})
LATE = law(
    "c_1 * c_m_1 + c_2 * v", {"c_1": (1.7e5, "N/m"), "c_2": (200.0, "N s/m"), "c_width_1": (1.2e-4, "m")},
    {"c_m_1": {"rate": "v - abs(v) * c_m_1 / c_width_1", "unit": "m", "scale": 1e-4}},
)  # fmt: skip


@pytest.fixture(scope="module")
def carriage():
    """The objective on a log of a carriage that moves at one speed only, and the noise of its sensors."""
    plant = e.load_plant("emps").set(Fc=0.0, Fv=0.0)
    EFFECTS.keep("carriage_friction", effect_of("carriage_friction", VISCOUS, "a test"))
    rig = plant.with_effects("carriage_friction")
    time = 0.004 * np.arange(1501)
    force = 35.0 * np.sign(np.sin(2.0 * np.pi * 0.5 * time))
    log, _ = e.record(rig, time, force)
    prepared = prepare_logs(plant, [log], None, 0.03, check=False)
    whole = Segment((prepared.logs[0].record,), "the log")
    return objective_of(whole, 0.03)[0], prepared.noise


def found(*files):
    forms = tuple(LawForm(one, 1.0 / len(files), 0.9) for one in files)
    nothing = np.zeros(0)
    proposed = ProposedLaw("force", ("v",), forms, {}, "m/s", nothing, nothing, nothing)
    settings = tuple({name: one.value for name, one in file.parameters.items()} for file in files)
    return FoundLaw(
        proposed, EFFECTS["rod_drag"], Begin(), (), settings[0], {}, settings, None, (), (), by_windows=False
    )


def test_forms_get_names_of_their_own():
    """Several forms have the same names for their numbers; states and rates follow."""
    own = renamed(LATE, "form2_")

    assert own.expression == "form2_c_1 * form2_c_m_1 + form2_c_2 * v"
    assert own.states["form2_c_m_1"].rate == "v - abs(v) * form2_c_m_1 / form2_c_width_1"
    assert own.parameters["form2_c_width_1"].value == 1.2e-4


def test_an_input_that_separates_two_forms(carriage):
    """Viscous friction, or a drag with the square of the speed: further apart than in the log, within its drive."""
    objective, noise = carriage
    experiment = form_experiment(found(VISCOUS, SQUARE), objective, noise)
    (pair,) = experiment.distance

    assert pair == (VISCOUS.form, SQUARE.form)
    assert experiment.distance[pair] > max(1.0, experiment.now[pair])
    assert 0.0 < experiment.amplitude <= 35.0 * 1.05
    assert "c_1 * d_R + c_2 * v * abs(v)" in experiment.words


def test_a_form_with_a_memory_is_compared_from_rest(carriage):
    """Without the distance in the present log, in which its state would begin at zero too."""
    objective, noise = carriage
    experiment = form_experiment(found(VISCOUS, LATE), objective, noise)

    assert experiment.now == {} and experiment.worst > 1.0


def test_one_form_needs_no_experiment(carriage):
    objective, noise = carriage

    assert form_experiment(found(VISCOUS), objective, noise) is None
    twice = found(VISCOUS, replace_numbers(VISCOUS))
    assert form_experiment(twice, objective, noise) is None


def replace_numbers(file):
    """The same law in other words: no input separates them."""
    return file.model_copy(update={"expression": "c_2 * v + c_1 * d_R"})
