"""Public functions take names and paths where loaded things are expected, and say in one sentence what fits nowhere."""

import inspect
import pickle
import re
from pathlib import Path

import control
import numpy as np
import pytest

import ehsa_ctrl as e
from ehsa_ctrl.arguments import kind_of
from ehsa_ctrl.diagnosis.diagnosis import Diagnosis
from ehsa_ctrl.identification.identification import Identification

FUNCTIONS = [name for name in e.__all__ if inspect.isfunction(getattr(e, name))]
PLACES = [
    (name, parameter.name)
    for name in FUNCTIONS
    for parameter in inspect.signature(getattr(e, name)).parameters.values()
    if parameter.annotation not in ("Any", "bool") and parameter.kind is not parameter.VAR_KEYWORD
]


class Strange:
    """Something that fits nowhere; its words must not get into a sentence."""

    def __repr__(self):
        return "line\n" * 30


@pytest.fixture(scope="module")
def given():
    """What fits, by the name of the argument."""
    plant, linear = e.load_plant("ehsa"), e.load_plant("ehsa", model="linear")
    system = e.three_state(linear)
    time = 0.004 * np.arange(50)
    log = e.Log(time, {"current": np.sin(time), "speed": np.cos(time)})
    return {
        "plant": plant, "log": log, "logs": [log], "before": log, "after": log, "system": system, "systems": {},
        "controller": e.load_controller("pid_position", system), "scenario": "steps_spring", "time": time,
        "current": time, "parameters": time[None], "reference": np.zeros((50, 3)), "measured": time, "simulated": time,
        "name": "ehsa", "path": "nowhere/x.fmu", "plants": [plant], "n": 1, "required": (), "result": None,
        "folder": ".", "diagnosis": object.__new__(Diagnosis), "found": object.__new__(Identification),
        "distance": 0.01, "current_limit": 6.0, "x": time, "drive": time, "outputs": {}, "sample_time": 0.004,
        "store": "there", "text": "select 1",
    }  # fmt: skip


@pytest.mark.parametrize(("function", "argument"), PLACES, ids=[f"{f}-{a}" for f, a in PLACES])
def test_what_fits_nowhere_is_one_sentence(function, argument, given):
    """It names the function, the argument, what was got and what was expected; and no value's own words."""
    signature = inspect.signature(getattr(e, function))
    required = [
        p.name
        for p in signature.parameters.values()
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    own = {"sensitivities": {"parameters": ["K_T"]}, "analyse_fleet": {"logs": ["no.csv"]}}
    fitting = given | own.get(function, {})
    arguments = {name: fitting[name] for name in required if name != argument}
    wrong = {argument: Strange()}
    if signature.parameters[argument].kind is inspect.Parameter.VAR_POSITIONAL:
        several, wrong = (*arguments.values(), Strange()), {}
        arguments = {}
    else:
        several = ()

    with pytest.raises(e.InputError) as caught:
        getattr(e, function)(*several, **arguments, **wrong)

    text = str(caught.value)
    assert text.startswith(f"{function}: {argument} is a Strange; expected ")
    assert "\n" not in text and len(text) < 330


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_public_function_can_be_sent_to_another_process(name):
    """And comes back as itself, with its own signature and words."""
    function = getattr(e, name)

    assert pickle.loads(pickle.dumps(function)) is function
    assert function.__doc__ == inspect.unwrap(function).__doc__


def test_a_plant_is_given_by_name_or_path(given):
    """The same numbers come out, to the last bit."""
    current = np.full(20, 1.5)
    path = e.plants.ehsa
    expected = e.simulate(given["plant"], current)["x"]

    assert np.array_equal(e.simulate("ehsa", current)["x"], expected)
    assert np.array_equal(e.simulate(path, current)["x"], expected)
    assert np.array_equal(e.three_state("ehsa").A, given["system"].A)


def test_a_linear_model_is_given_by_its_plant(given):
    """A name, a path, or the plant's linear set; the nonlinear one has none."""
    expected = e.analyse(given["system"]).poles
    linear = e.load_plant("ehsa", model="linear")

    for system in ("ehsa", Path(e.plants.ehsa), linear):
        assert np.array_equal(e.analyse(system).poles, expected)
    with pytest.raises(e.InputError, match=r"analyse: system is a Plant; expected a linear model: .* model=.linear."):
        e.analyse(given["plant"])
    with pytest.raises(e.InputError, match="analyse: system is a TransferFunction; expected a linear model"):
        e.analyse(control.tf([1], [1, 1]))


def test_a_controller_is_given_by_name(given):
    """Designed on the model beside it, or on the linear set of the plant's own file."""
    plant, system, pid = given["plant"], given["system"], given["controller"]
    reference = np.tile([0.001, 0.0, 0.0], (20, 1))

    assert e.analyse_loop(system, "pid_position").to_dict() == e.analyse_loop(system, pid).to_dict()
    assert np.array_equal(
        e.run_closed_loop(plant, "pid_position", reference).asked, e.run_closed_loop(plant, pid, reference).asked
    )
    with pytest.raises(e.InputError, match="no controller 'pid_positon'; did you mean 'pid_position'"):
        e.run_closed_loop("ehsa", "pid_positon", reference)


def test_a_log_is_given_by_its_path(given, tmp_path):
    """It is read through the plant that stands beside it, wherever that stands."""
    path = tmp_path / "log.csv"
    log, _ = e.record(given["plant"], *e.excitation("noise", amplitude=3, duration=1.0), centre=True)
    log.write(path)

    by_path, read = e.replay("ehsa", path), e.replay("ehsa", e.read_plant_log(path, given["plant"]))

    assert by_path.fit_percent == read.fit_percent
    assert e.check_log(str(path), "ehsa") == e.check_log(e.read_plant_log(path, "ehsa"), given["plant"])
    with pytest.raises(e.InputError, match=r"replay: log: nix\.csv: no such file"):
        e.replay("ehsa", "nix.csv")


def test_names_are_a_text_or_several(given):
    """One text of names separated by commas, as on the command line."""
    current = np.full(20, 1.5)

    both = e.sensitivities("ehsa", "K_T, A_FR", current)

    assert both.names == e.sensitivities("ehsa", ["K_T", "A_FR"], current).names == ("K_T", "A_FR")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: e.load_plant(e.load_plant("ehsa")), "load_plant: name is a Plant; .* it is already loaded"),
        (lambda: e.load_plant("ehsa", model="linaer"), r"load_plant: model is 'linaer'; expected 'linear' or 'nonlin"),
        (lambda: e.simulate("ehsa", "noise"), "simulate: current is 'noise'; expected an array of numbers"),
        (lambda: e.simulate("ehsa", [1.0], hold="first"), "simulate: hold is 'first'; expected 'zero_order' or"),
        (lambda: e.excitation("noise", duration="3 s"), "excitation: duration is '3 s'; expected a finite number"),
        (lambda: e.excitation("noise", duration=float("nan")), "excitation: duration is nan; expected"),
        (lambda: e.excitation("noise", seed=-1), "excitation: seed is -1; expected a whole number"),
        (lambda: e.load_plant("ehsa", settings={"K_T": None}), "settings is a dictionary with None under 'K_T'"),
        (lambda: e.SteppedRun(3), "SteppedRun: plant is 3; expected a plant: its name, the path"),
        (lambda: e.Log.from_pandas(None), "Log.from_pandas: frame is None; expected a table of pandas"),
        (lambda: e.load_plant("ehsa")[None], "the nonlinear model of ehsa has no parameter None; known: A, A_FM"),
        (lambda: e.fit_percent(["a"], ["b"]), "fit_percent: measured is a list; expected an array of numbers"),
        (lambda: e.fit_percent([1.0, 2.0], [1j, 2]), "fit_percent: simulated is a list; expected"),
        (lambda: e.fit_percent([], []), r"measured has shape \(0,\) and simulated \(0,\); expected two vectors"),
        (lambda: e.simulate("ehsa", np.array([1j, 2])), "current is an array of shape .* of complex128"),
        (lambda: e.simulate("ehsa", [True, False]), "simulate: current is a list; expected an array of numbers"),
        (lambda: e.run_closed_loop("ehsa", "pid_position", np.array([object()])), "reference is an array .* of object"),
        (lambda: e.gap("ehsa", 3), "gap: log is 3; expected a log"),
        (lambda: e.diagnose("ehsa", [3]), "diagnose: log is a list; expected a log"),
        (lambda: e.diagnose("ehsa", []), "no log to diagnose; give at least one"),
        (lambda: e.analyse_loop("ehsa", "pid_position", lag=10**6), "lag = 1000000; expected a whole number"),
        (lambda: e.draw("ehsa", 2.5), "draw: n is 2.5; expected a whole number"),
        (lambda: e.run(3), "run: scenario is 3; expected a scenario: its name, the path of its TOML, or what"),
        (lambda: e.identify("ehsa", 3), "identify: logs is 3; expected a log: the path of its file"),
    ],
)  # fmt: skip
def test_mistakes_are_said(call, said):
    """What was got, and what to give instead."""
    with pytest.raises(e.InputError, match=said):
        call()


def test_every_argument_of_a_constructor_is_known():
    """As of functions; None is accepted where the annotation says so."""
    for owner, methods in e._BUILT.items():
        for method in methods:
            function = inspect.unwrap(getattr(getattr(e, owner), method))
            function = getattr(function, "__func__", function)
            for parameter in inspect.signature(function).parameters.values():
                if parameter.name in ("self", "cls"):
                    continue
                kind = kind_of(function.__qualname__.removesuffix(".__init__"), parameter)
                assert ("None" in kind.expected.split(", or ")) == ("None" in str(parameter.annotation)), parameter


def test_a_structure_may_have_no_friction_law():
    """Of a system without that contact; classes are used inside the package too."""
    assert e.Structure(shaft_friction=None, rod_friction="coulomb", chambers=None, system_name="positioning")
    assert e.load_plant("emps").structure.shaft_friction is None


def test_a_forgotten_argument_is_pythons_own_error():
    """It says which one, as of any function."""
    with pytest.raises(TypeError, match=re.escape("simulate() missing 1 required positional argument: 'current'")):
        e.simulate("ehsa")


def test_a_plant_is_run_as_it_is(given):
    """A plant that was changed is checked on; its file's linear set is designed on, unless another is given."""
    changed = given["plant"].set(A_FR=600.0)

    found = e.run("steps_spring", plant=changed)
    as_named = e.run("steps_spring", plant="ehsa")

    assert found.plant["A_FR"] == 600.0 and found.plant["K_S"] == as_named.plant["K_S"] > 0.0
    assert found.loop.to_dict() == as_named.loop.to_dict()
    assert found.metrics["SteadyStateError"][1] != as_named.metrics["SteadyStateError"][1]
    assert found.baseline is None
    with pytest.raises(
        e.InputError, match=r"plant is the linear model of ehsa; expected the nonlinear one, load_plant"
    ):
        e.run("steps_spring", plant=e.load_plant("ehsa", model="linear"))
    with pytest.raises(e.InputError, match=r"design is the nonlinear model of ehsa; expected the linear one"):
        e.run("steps_spring", design=given["plant"])


def test_a_plant_that_does_not_fit_is_not_spelt_out(given):
    """No sentence has the words of a whole plant in it."""
    with pytest.raises(e.InputError) as caught:
        e.run("steps_spring", controller=given["plant"])

    assert str(caught.value).startswith("run: controller is a Plant; expected a controller: its name, the path")


def test_a_value_is_set_with_its_unit(given):
    """A number is in SI units, a text has its unit; another dimension is one sentence."""
    plant = given["plant"]

    assert plant.set(K_S="50 N/mm", K_T="1.1")["K_S"] == 50e3
    assert plant.set(K_T="1.1 N m/A")["K_T"] == plant.set(K_T=1.1)["K_T"] == 1.1
    with pytest.raises(e.InputError, match=r"K_T: unit 'N m' does not fit: expected one that converts to 'N m/A'"):
        plant.set(K_T="1.1 N m")
    with pytest.raises(e.InputError, match=r"K_T: is a list; expected a number in N m/A, or a text with a unit"):
        plant.set(K_T=[1.1])
