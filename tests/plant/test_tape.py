"""The tape: one text, read by people, evaluated plain, compiled and differentiated."""

from math import cos, exp, sqrt, tanh

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ehsa_ctrl.core.errors import CompileError
from ehsa_ctrl.plant.arrays import evaluate_tape
from ehsa_ctrl.plant.structure import LINEAR, NONLINEAR, Structure
from ehsa_ctrl.plant.tangent import Tangent
from ehsa_ctrl.plant.tape import Tape, build_tape

SCALE = 3.0


def inner(a, b):
    return sqrt(a * a + b * b)


def everything(x, y, p, q):
    """Every construct of the dialect."""
    r = inner(x, y) / p
    s = exp(-abs(x) / q) if x > y and p > 0.0 else tanh(y) ** 2.0
    return max(r, s, 0.1) - min(x * q, SCALE) + cos(-y) / (p + q) + round(3.0 * x) * q


NUMBER = st.floats(0.1, 3.0)


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), p=NUMBER, q=NUMBER)
def test_the_tape_computes_what_the_function_does(x, y, p, q):
    """Inlined and split into constants and rest, the value is the same to rounding."""
    tape = Tape(["x", "y"], ["p", "q"])
    ref = tape.call(everything, tape.refs)

    (value,) = evaluate_tape(tape, [ref], {"x": x, "y": y, "p": p, "q": q})

    assert value == pytest.approx(everything(x, y, p, q), rel=1e-12, abs=1e-12)


@given(x=st.floats(-3, 3), y=st.floats(0.2, 3), p=NUMBER, q=NUMBER)
def test_the_tangent_is_the_derivative(x, y, p, q):
    """Against central differences, wherever no kink lies within the difference."""
    tape = Tape(["x", "y"], ["p", "q"])
    ref = tape.call(everything, tape.refs)
    derivatives = Tangent(tape, ["x", "y", "p", "q"]).of(ref)
    values = {"x": x, "y": y, "p": p, "q": q}

    found = dict(zip(derivatives, evaluate_tape(tape, derivatives.values(), values), strict=True))

    for name, value in values.items():
        at = [everything(**{**values, name: value + d}) for d in (-2e-5, -1e-5, 0.0, 1e-5, 2e-5)]
        wide, narrow = (at[4] - at[0]) / 4e-5, (at[3] - at[1]) / 2e-5
        # On a kink itself the central differences agree with each other and with neither side.
        left, right = (at[2] - at[1]) / 1e-5, (at[3] - at[2]) / 1e-5
        if abs(wide - narrow) < 1e-6 * (1 + abs(wide)) and abs(right - left) < 1e-2 * (1 + abs(wide)):
            assert found.get(name, 0.0) == pytest.approx(narrow, rel=1e-4, abs=1e-4)


def test_what_depends_on_parameters_alone_is_computed_once():
    """No division by a parameter is left in the part that runs at every step."""
    tape = build_tape(NONLINEAR.equations)
    refs = tape.needed([tape.refs["omega_dot"], tape.refs["v_dot"]], stop=lambda node: node.parametric)

    assert not [ref for ref in refs if tape.nodes[ref].op == "/" and not tape.nodes[ref].parametric]


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("def f(x):\n    for i in range(3):\n        x = x + 1\n    return x\n", "is not an assignment"),
        ("def f(x):\n    if x > 0:\n        return x\n    return -x\n", "is not an assignment"),
        ("def f(x):\n    return x[0]\n", "can't be translated"),
        ("def f(x):\n    return print(x)\n", "neither a function of `math` nor a physics function"),
        ("def f(x):\n    return x + unknown\n", "neither an argument nor a numeric constant"),
        ("def f(x):\n    y = x\n", "is not the return that must end"),
    ],
)
def test_what_can_not_be_translated_is_named(tmp_path, monkeypatch, source, says):
    """A person who writes an effect is told which line the engine can't use, and in which file."""
    (tmp_path / "odd.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "odd", raising=False)
    import odd

    with pytest.raises(CompileError, match=says) as caught:
        Tape(["x"], []).call(odd.f, {"x": 0})

    assert "odd.py" in str(caught.value)


@pytest.mark.parametrize(
    "structure",
    [
        LINEAR,
        NONLINEAR,
        Structure(rod_friction="lugre", shaft_friction="karnopp", effects=("end_stop", "relief_valve")),
    ],
    ids=["linear", "nonlinear", "many"],
)
def test_equations_use_only_what_stands_before_them(structure):
    """The order of the wired equations is one in which they can be evaluated."""
    equations = structure.equations
    known = {*(s.name for s in equations.states), *equations.inputs, *equations.directions, *equations.parameter_names}
    for call in equations.calls:
        assert set(call.arguments.values()) <= known, call.target
        known.add(call.target)

    assert set(equations.rates) <= known
    assert len(set(equations.parameter_names)) == len(equations.parameter_names)
    np.testing.assert_equal(len(equations.rates), len(equations.states))
