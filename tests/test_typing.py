"""The types of the public names: the stub agrees with the code, and a user's script is checked with real types."""

import ast
import inspect
from pathlib import Path

import pytest
from mypy import api

import ehsa_ctrl

STUB = ast.parse((Path(ehsa_ctrl.__file__).with_suffix(".pyi")).read_text())
FUNCTIONS = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}
SCRIPT = """\
from typing import assert_type

import ehsa_ctrl as e
from ehsa_ctrl.identification.identification import Identification
from ehsa_ctrl.scenario.comparison import ControllerComparison
from ehsa_ctrl.scenario.result import ScenarioResult
from ehsa_ctrl.simulation.trajectory import Trajectory

assert_type(e.load_plant("ehsa"), e.Plant)
assert_type(e.identify("ehsa", "log.csv", free="K_T"), Identification)
assert_type(e.diagnose(e.plants.ehsa, "log.csv"), e.Diagnosis)
assert_type(e.run("steps_spring", controller="pid_position"), ScenarioResult)
assert_type(e.run("steps_spring", controller=["pid_position", lambda t, y, r: 0.0]), ControllerComparison)
assert_type(e.simulate("ehsa", [1.0, 2.0]), Trajectory)
e.simulate(3, [1.0])
e.simulat
"""


def test_the_stub_has_every_public_name():
    """And no other: re-exports, functions and the version."""
    exported = {alias.asname for node in STUB.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    exported = {name for name in exported if name and not name.startswith("_")}

    assert exported | set(FUNCTIONS) | {"__version__"} == set(ehsa_ctrl.__all__)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_a_function_of_the_stub_is_that_of_the_code(name):
    """The same arguments in the same order, with the same defaults, and the same result."""
    node, signature = FUNCTIONS[name], inspect.signature(getattr(ehsa_ctrl, name))
    positional = [arg.arg for arg in node.args.args]
    defaults = dict(zip(reversed(positional), reversed(node.args.defaults), strict=False))
    defaults |= {arg.arg: default for arg, default in zip(node.args.kwonlyargs, node.args.kw_defaults, strict=True)}
    kinds = {
        **dict.fromkeys(positional, inspect.Parameter.POSITIONAL_OR_KEYWORD),
        **({node.args.vararg.arg: inspect.Parameter.VAR_POSITIONAL} if node.args.vararg else {}),
        **{arg.arg: inspect.Parameter.KEYWORD_ONLY for arg in node.args.kwonlyargs},
        **({node.args.kwarg.arg: inspect.Parameter.VAR_KEYWORD} if node.args.kwarg else {}),
    }

    assert kinds == {parameter.name: parameter.kind for parameter in signature.parameters.values()}
    for parameter in signature.parameters.values():
        default = defaults.get(parameter.name)
        if default is None or (isinstance(default, ast.Constant) and default.value is ...):
            assert (default is None) == (parameter.default is parameter.empty), parameter.name
        else:
            assert ast.literal_eval(default) == parameter.default, parameter.name
    results = [ast.unparse(one.returns) for one in STUB.body if getattr(one, "name", None) == name]
    assert sorted(results) == sorted(signature.return_annotation.split(" | ") if len(results) > 1 else results)
    assert len(results) > 1 or results == [signature.return_annotation]


@pytest.mark.slow
def test_a_users_script_has_real_types(tmp_path, monkeypatch):
    """Names and paths are accepted where they are loaded; a wrong argument and a wrong name are found."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    monkeypatch.setenv("MYPYPATH", str(Path(ehsa_ctrl.__file__).parents[1]))
    monkeypatch.chdir(tmp_path)

    root = Path(ehsa_ctrl.__file__).parents[1]
    # The cache and the options of `make lint`, so that only the script is analysed.
    options = ["--config-file", str(root / "pyproject.toml"), "--cache-dir", str(root / ".mypy_cache")]
    found, _, status = api.run([*options, str(script)])

    assert status == 1
    errors = [line for line in found.splitlines() if ": error:" in line]
    assert len(errors) == 2, found
    assert ':15: error: Argument 1 to "simulate"' in errors[0] and ":16: error: Module has no attribute" in errors[1]
