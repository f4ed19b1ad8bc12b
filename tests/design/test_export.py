"""Controllers as C99: the C that comes out against the Python that went in."""

import ctypes
import importlib.util
import math
import shutil
import subprocess
from dataclasses import replace

import control
import numpy as np
import pytest
from export_inputs import STRICT, full, loop_readings, readings
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ehsa_ctrl import InputError, load_controller, load_plant, three_state
from ehsa_ctrl.design.export import FIXED, FLOATING, NUMBERS, Program, check_code, export_controller, replay
from ehsa_ctrl.design.export.compiled_code import deepest_stack
from ehsa_ctrl.design.export.deployment import embedded_controller
from ehsa_ctrl.design.export.operations import CountedFloat
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.specification import starting_definition
from ehsa_ctrl.plant.conditions import linear_model

CC = shutil.which("cc") or shutil.which("gcc")
needs_compiler = pytest.mark.skipif(CC is None, reason="there is no C compiler here")
HEAD = "#include <math.h>\n#include <stdbool.h>\n#include <string.h>\n\n"
POINTER = ctypes.POINTER(ctypes.c_double)
#: A controller of every kind without a solver, and two more forms of state feedback.
LAWS = sorted(
    {starting_definition(kind)[1].stem for kind in CONTROLLER_KINDS if kind not in ("mpc", "scheduled_mpc")}
    | {"lqi_position", "lqr_friction"}
)

SURFACE = {"kind": "sliding_mode", "sliding_mode": {"bandwidth": 30.0, "disturbance": 10.0}}
LOOPS = {
    "kind": "cascade",
    "speed": {"crossover": 100.0, "phase_margin": 0.9},
    "position": {"crossover": 20.0, "phase_margin": 0.9, "velocity_limit": 0.5},
}
#: Laws that take the rod's speed from the position, for a plant without a shaft.
ROD_LAWS = {
    "rod cascade": LOOPS,
    "rod sliding mode": SURFACE,
    "repetitive rod cascade": {"kind": "repetitive", "cycle": {"period": 2.0, "cutoff": 10.0}, "base": LOOPS},
    "repetitive rod sliding mode": {"kind": "repetitive", "cycle": {"period": 2.0, "cutoff": 10.0}, "base": SURFACE},
}


def library(folder, *sources):
    """A shared library of C sources, compiled so that any warning fails."""
    target = folder / "library.so"
    subprocess.run([CC, *STRICT, "-shared", "-fPIC", *map(str, sources), "-lm", "-o", str(target)], check=True)
    return ctypes.CDLL(str(target))


def pointer(vector):
    return vector.ctypes.data_as(POINTER)


def module(folder, text, name="functions"):
    """Functions from text, in a file of their own so that their source can be found."""
    file = folder / f"{name}.py"
    file.write_text(f"from math import sqrt, exp, isfinite, inf\nimport math\nimport numpy as np\n\n{text}")
    spec = importlib.util.spec_from_file_location(f"{name}_{id(folder)}", file)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def run_c(folder, function, *others):
    """The C of `f(m, a, k) -> float` as a Python function."""
    text = Program([function, *others]).text(function)
    outer = "double outer(double m[], double a, int k);\ndouble outer(double m[], double a, int k)\n"
    (folder / "f.c").write_text(f"{HEAD}{text}\n\n{outer}{{\n    return {function.__name__}(m, a, k);\n}}\n")
    outer = library(folder, folder / "f.c").outer
    outer.restype, outer.argtypes = ctypes.c_double, [POINTER, ctypes.c_double, ctypes.c_int]
    return lambda m, a, k: outer(pointer(m), a, k)


def same(function, compiled, m, a, k):
    """Result and vector of both, to the bit; nan is nan."""
    mine, theirs = m.copy(), m.copy()
    with np.errstate(all="ignore"):
        expected = float(function(mine, a, k))
    got = compiled(theirs, a, k)
    np.testing.assert_array_equal([got, *theirs], [expected, *mine])
    np.testing.assert_array_equal(
        np.signbit([got, *theirs])[~np.isnan([got, *theirs])],
        np.signbit([expected, *mine])[~np.isnan([expected, *mine])],
    )


NAMES = ("a", "x", "y")
LEAVES = st.one_of(
    st.sampled_from(NAMES),
    st.integers(0, 3).map("m[{}]".format),
    st.sampled_from(["m[k]", "m[k - 1]", "k", "0.1", "2.0", "3", "-0.0", "1e-3"]),
)


def _deeper(inner):
    two = st.tuples(inner, inner)
    return st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
        st.tuples(inner, st.sampled_from("+-*"), inner, st.sampled_from("+-*"), inner).map(" ".join).map("({})".format),
        two.map(lambda t: f"{t[0]} / (1.5 + abs(1.0 * {t[1]}))"),
        two.map(lambda t: f"(1.0 * {t[0]}) % (0.5 + abs(1.0 * {t[1]}))"),
        two.map(lambda t: f"(0.5 * {t[0]}) % -0.75"),
        two.map(lambda t: f"min({t[0]}, {t[1]}, 1.0)"),
        two.map(lambda t: f"max({t[0]}, {t[1]})"),
        inner.map(lambda e: f"-{e}" if e[0] != "-" else e),
        inner.map(lambda e: f"sqrt(abs(1.0 * {e}))"),
        st.tuples(inner, st.sampled_from(["<", "<=", "==", "!=", ">"]), inner, inner, inner).map(
            lambda t: f"({t[3]} if {t[0]} {t[1]} {t[2]} and not m[0] > 1.0 or x < 0.0 else {t[4]})"
        ),
    )


EXPRESSIONS = st.recursive(LEAVES, _deeper, max_leaves=6)
TARGETS = st.sampled_from(["x", "y", "m[0]", "m[1]", "m[k]", "m[k + 1]"])
SIMPLE = st.one_of(
    st.tuples(TARGETS, st.sampled_from(["=", "+=", "-=", "*="]), EXPRESSIONS).map(lambda t: [f"{t[0]} {t[1]} {t[2]}"]),
    st.tuples(TARGETS, TARGETS, EXPRESSIONS, EXPRESSIONS).map(lambda t: [f"{t[0]}, {t[1]} = {t[2]}, {t[3]}"]),
    st.sampled_from([["x, y = m[2:4]"], ["m[1:3] = m[0:2]"], ["m[0], m[1], m[2] = m[1:4]"], ["a = x"]]),
)


def _blocks(inner):
    body = st.lists(inner, min_size=1, max_size=3).map(lambda parts: [f"    {line}" for part in parts for line in part])
    return st.one_of(
        st.tuples(EXPRESSIONS, body, body).map(lambda t: [f"if {t[0]} > 0.5:", *t[1], "else:", *t[2]]),
        st.tuples(body, st.sampled_from(["break", "continue"])).map(
            lambda t: ["for i in range(1, k + 2):", "    m[i] += 0.5", "    if m[i] > 1.0:", f"        {t[1]}", *t[0]]
        ),
    )


BODIES = st.lists(st.recursive(SIMPLE, _blocks, max_leaves=4), min_size=2, max_size=6)


def _no_nested_counter(lines):
    """Python lets two nested loops share a counter; the subset does not."""
    return sum("for i in" in line for line in lines) < 2


@pytest.mark.slow
@needs_compiler
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(bodies=st.lists(BODIES, min_size=1, max_size=1), seed=st.integers(0, 2**32 - 1))
def test_random_programs_are_equal_to_the_bit(tmp_path_factory, bodies, seed):
    """Programs of the subset, drawn at random, over random numbers: same result, same vector."""
    folder = tmp_path_factory.mktemp("program")
    lines = [line for part in bodies[0] for line in part]
    if not _no_nested_counter(lines):
        return
    text = "\n".join(f"    {line}" for line in ["x = 0.5", "y = a", *lines, "return x + y"])
    function = module(folder, f"def f(m: np.ndarray, a: float, k: int) -> float:\n{text}\n").f
    compiled = run_c(folder, function)
    rng = np.random.default_rng(seed)

    for _ in range(20):
        same(function, compiled, rng.uniform(-2, 2, 5), float(rng.uniform(-2, 2)), int(rng.integers(1, 3)))


SWAPS = """
def inner(part: np.ndarray, limit: float) -> float:
    part[1] = min(part[0], limit)
    return part[1] - part[0]


def f(m: np.ndarray, a: float, k: int) -> float:
    '''Things that differ between Python and C unless care is taken.'''
    double = a
    m[0], m[1] = m[1], m[0]
    x, double = double, 2.0
    n = k
    for i in range(n):
        n = 1
        m[2] += i / 2
    count = 0
    while count < 3 and m[3] < 1.0:
        count += 1
        m[3] += 0.25
    part = m[1:]
    low = inner(part, 0.25)
    m[4] = -a % 0.75
    started = m[4] > 0.1
    k = k + 1
    a += 1.0
    y = 1 if started else 0
    y += 0.5
    _GAP = max(1, k) / 2
    return a + x * double + low + y + _GAP + (1.0 if not isfinite(m[0] / 1e-3) else m[1 + int(2.9)])
"""


@needs_compiler
def test_where_c_would_differ_it_does_not(tmp_path):
    """Swaps, ranges that are looked at once, whole division, the sign of %, names that C claims, truncation."""
    made = module(tmp_path, SWAPS)
    compiled = run_c(tmp_path, made.f, made.inner)
    rng = np.random.default_rng(5)

    for _ in range(50):
        same(made.f, compiled, rng.uniform(-2, 2, 5), float(rng.uniform(-2, 2)), int(rng.integers(1, 5)))


@needs_compiler
@pytest.mark.parametrize("a", [0.0, -0.0, 1.0, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("b", [0.0, -0.0, 2.0, math.nan, -math.inf])
def test_extremes_are_pythons(tmp_path_factory, a, b):
    """min and max of equals and of nan give the operand that Python gives."""
    folder = tmp_path_factory.getbasetemp() / "extremes"
    if not folder.exists():
        folder.mkdir()
    text = "def f(m: np.ndarray, a: float, k: int) -> float:\n    m[1] = min(m[0], a)\n    return max(m[0], a)\n"
    function = module(folder, text).f
    if not hasattr(test_extremes_are_pythons, "compiled"):
        test_extremes_are_pythons.compiled = run_c(folder, function)

    same(function, test_extremes_are_pythons.compiled, np.array([b, 0.0]), a, 0)


WRONG = {
    "m[0] = sum([a, a])": "the name sum",
    "m[0] = np.dot(m, m)": "the call `np.dot(m, m)`",
    "m[0] = [a][0]": "`[a][0]`",
    "m[0] = a ** 2": "`a ** 2`",
    "m[0] = a // 2": "`a // 2`",
    "m[-1] = a": "the index -1",
    "m[a] = a": "`a` as an index",
    "x = m[::2]": "a slice without steps",
    "m[1:] = m[2:]": "a slice with an end",
    "x = 'word'": "`'word'`",
    "if a:\n        pass": "`a` as a condition",
    "x = a\n    x = a > 0.0": "x, once double and once bool,",
    "m[0] = later\n    later = a": "later, which is read before it is assigned",
    "try:\n        pass\n    except ValueError:\n        pass": "`try:`",
    "for x in m:\n        pass": "`for x in m`",
    "for i in range(3):\n        i = 2": "the counter i, used outside its loop,",
    "for i in range(3):\n        pass\n    m[0] = i": "the counter i, used outside its loop,",
    "m[0] = f(m, a, k)": "a function that calls itself",
    "m[0] = m[1] + g(m)": "a call that writes into a vector in a statement of its own",
    "m[0] = g(m) + g(m)": "a call that writes into a vector in a statement of its own",
    "m[0] = g(part=m)": "plain arguments",
    "m[0] = nowhere": "the name nowhere",
    "x, y = a, a, a": "2 values",
    "m = m[1:]": "the new meaning of m",
    "k = 2147483648": "a whole number below 2^31",
    "return m": "a double, as in the function's annotation",
    "if a > 0.0:\n        part = m[1:]\n    else:\n        part = m[2:]": "the vector part",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_outside_the_subset_is_a_sentence(tmp_path, text):
    """The error names file, line, function, the given code and the expected one."""
    head = "def g(part: np.ndarray) -> float:\n    part[0] += 1.0\n    return part[0]\n\n\n"
    made = module(tmp_path, f"{head}def f(m: np.ndarray, a: float, k: int) -> float:\n    {text}\n    return a\n")
    with pytest.raises(InputError) as caught:
        Program([made.f, made.g]).text(made.f)
    sentence = str(caught.value)

    assert WRONG[text] in sentence
    assert sentence.startswith("functions.py, line ") and ": f: " in sentence
    assert "can't be written as C; expected" in sentence and "\n" not in sentence


@pytest.mark.parametrize(
    ("head", "what"),
    [
        ("def f(m, a: float) -> float:", "the argument m"),
        ("def f(a: str) -> float:", "the argument a"),
        ("def f(a: float = 1.0) -> float:", "optional, keyword or starred arguments"),
        ("def f(a: float):", "a result ''"),
        ("def f(a: float) -> float:\n    if a > 0.0:\n        return a", "a path without `return`"),
    ],
)
def test_a_wrong_head_is_a_sentence(tmp_path, head, what):
    """Annotations are how the C gets its types."""
    made = module(tmp_path, f"{head}\n    x = 1.0\n")

    with pytest.raises(InputError, match=r"functions\.py, line 5: f: ") as caught:
        Program([made.f]).text(made.f)
    assert what in str(caught.value)


def test_functions_without_text_are_a_sentence():
    """Built-in functions, and functions made at run time."""
    made = {}
    # Python 3.13 finds the text of `python -c` for a file <string>.
    exec(compile("def f(a: float) -> float:\n    return a\n", "<made at run time>", "exec"), made)

    for function in (math.sqrt, made["f"]):
        with pytest.raises(InputError, match="its text can't be found"):
            Program([function]).text(function)


@pytest.fixture(scope="module")
def system():
    from ehsa_ctrl import load_plant

    return three_state(load_plant("ehsa", model="linear"))


def step_of(folder, controller):
    """ehsa_step and ehsa_reset of a written controller, as Python functions."""
    made = library(folder, folder / "controller.c")
    made.ehsa_step.restype = ctypes.c_double
    made.ehsa_step.argtypes = [POINTER] * 3
    memory = np.full(controller.initial_memory().size, 7.0)
    made.ehsa_reset(pointer(memory))
    np.testing.assert_array_equal(memory, controller.initial_memory())
    return lambda r, y: (made.ehsa_step(pointer(r), pointer(y), pointer(memory)), memory)


@needs_compiler
@pytest.mark.parametrize("stages", ["own", "all"])
@pytest.mark.parametrize("name", [*LAWS, *ROD_LAWS, "PI of python-control"])
def test_c_is_python_to_the_bit(name, stages, system, tmp_path):
    """Current and memory of every sample, over random readings with losses, jumps, rests and saturation."""
    if name in LAWS:
        controller = load_controller(name, system)
    elif name in ROD_LAWS:
        law = {**ROD_LAWS[name], "sample_time": 0.004, "current_limit": 50.0}
        controller = load_controller(law, linear_model(load_plant("emps", model="linear")))
    else:
        controller = load_controller(control.tf([12.0, 300.0, 900.0], [0.004, 1.0, 0.0]), current_limit=2.0)
    controller = full(controller) if stages == "all" else controller
    reference, measured = readings(1200)
    if controller.follows_force:
        # Approach, contact, a smaller force and the release; the readings are between -10 and 10 N.
        reference = np.column_stack([reference, np.resize([0.0, 9.0, 9.0, 4.0, 0.0], len(reference))])
    export_controller(controller, reference[:20], measured[:20]).write(tmp_path)
    step, memory = step_of(tmp_path, controller), controller.initial_memory()
    currents = []
    for r, y in zip(reference, measured, strict=True):
        currents.append(controller.step(r, y, memory))
        current, theirs = step(r, y)

        assert current == currents[-1]
    np.testing.assert_array_equal(theirs, memory)
    assert np.count_nonzero(np.abs(currents) == controller.current_limit) > 10
    assert currents[-1] == 0.0 and np.count_nonzero(currents) > 900


@pytest.mark.slow
@needs_compiler
def test_the_written_test_passes_and_can_fail(system, tmp_path):
    """`make test` with its own flags; one current that is 1e-8 A off, or a row that is missing, fails it."""
    if shutil.which("make") is None:
        pytest.skip("there is no make here")
    controller = load_controller("lqr_position", system)
    deployment = export_controller(controller, *readings(300))
    deployment.write(tmp_path)
    call = ["make", "-s", "-C", str(tmp_path), "test", f"CC={CC}"]
    good = subprocess.run(call, capture_output=True, text=True)

    assert good.returncode == 0, good.stderr
    assert good.stdout == "300 samples, largest difference from Python 0 A, tolerance 1e-09 A\n"
    rows = (tmp_path / "test_vector.csv").read_text().splitlines()
    first, last = rows[40].rsplit(",", 1)
    for spoiled in ([*rows[:40], f"{first},{float(last) + 1e-8!r}", *rows[41:]], rows[:-1], [*rows[:9], "1,2,three"]):
        (tmp_path / "test_vector.csv").write_text("\n".join(spoiled) + "\n")
        assert subprocess.run(call, capture_output=True).returncode != 0


@needs_compiler
@pytest.mark.parametrize(
    "name",
    ["pid_friction", *(pytest.param(law, marks=pytest.mark.slow) for law in LAWS)],
)
def test_floats_are_near_doubles(name, system):
    """A run of motions, ramps and losses: no decision depends on rounding, and the report says what the code costs."""
    controller = load_controller(name, system)
    reference, measured = loop_readings(controller)
    runs = [("again", reference, measured)]
    reports = {}
    for word, number in FLOATING.items():
        deployment = export_controller(controller, reference, measured, number=number)
        reports[word] = check_code(deployment, controller, number, runs)
    exact, rounded = reports["double"], reports["float"]

    assert [run.error for run in exact.runs.values()] == [0.0, 0.0]
    first, again = rounded.runs.values()
    assert 0.0 < first.error == again.error < 1e-3 * controller.current_limit
    assert exact.operations == rounded.operations and rounded.operations["flops"] > 20
    assert exact.stack is None or 0 < exact.stack < 4096


def test_operations_are_counted():
    """By kind; a constant on either side is an operation too, and a comparison gives a truth value."""
    CountedFloat.counts.clear()
    a, b = CountedFloat(3.0), CountedFloat(2.0)
    result = 1.0 - (a * b + 4.0) / b + max(a, b) * 2

    assert result == 2.0 and (a < b) is False
    assert CountedFloat.counts == {"additions": 3, "multiplications": 2, "divisions": 1, "comparisons": 3}


def test_the_deepest_chain_of_calls_is_the_stack():
    """Of two ways down the deeper one counts; recursion and a stack without a bound are sentences."""
    node, edge = (
        'node: {{ title: "{0}" label: "{0}\\nf.c:1:1\\n{1} bytes ({2})" }}',
        'edge: {{ sourcename: "{}" targetname: "{}" }}',
    )
    nodes = [node.format(*each) for each in (("top", 16, "static"), ("a", 100, "static"), ("b", 8, "static"))]
    nodes += [node.format("c", 120, "static"), 'node: { title: "exp" label: "__builtin_exp" shape : ellipse }']
    edges = [edge.format(*each) for each in (("top", "a"), ("top", "b"), ("b", "c"), ("a", "exp"))]

    assert deepest_stack("\n".join([*nodes, *edges]), "top") == 16 + 8 + 120
    with pytest.raises(InputError, match="calls itself"):
        deepest_stack("\n".join([*nodes, *edges, edge.format("c", "top")]), "top")
    with pytest.raises(InputError, match="a stack of variable size"):
        deepest_stack(node.format("top", 16, "dynamic"), "top")


@needs_compiler
def test_nothing_but_arithmetic_is_called(system, tmp_path):
    """No allocation, no files: the object file asks for functions of math and memmove at most."""
    export_controller(full(load_controller("lqr_friction", system)), *readings(20)).write(tmp_path)
    subprocess.run([CC, *STRICT, "-c", "controller.c", "-o", "controller.o"], cwd=tmp_path, check=True)
    listed = subprocess.run(["nm", "-u", "controller.o"], cwd=tmp_path, check=True, capture_output=True, text=True)
    asked = {line.split()[-1] for line in listed.stdout.splitlines()} - {"_GLOBAL_OFFSET_TABLE_"}

    assert asked <= {"exp", "sin", "fmod", "sqrt", "memmove", "memcpy"}


def test_settings_carry_their_names(system):
    """A person who reads the C finds the gains."""
    controller = load_controller("pid_position", system)
    text = export_controller(controller, *readings(20)).files["controller.c"]
    gains = controller.law.gains

    for name in ("k_p", "k_i", "k_d", "T_f"):
        assert f"{getattr(gains, name)!r}, /* {name} */" in text
    assert "/* pid_law */" in text and "/* supervision */" in text
    text = export_controller(load_controller("lqr_position", system), *readings(20)).files["controller.c"]
    assert "/* A (7, 7) */" in text and "/* gain (7, 3) */" in text and "/* limit */" in text


def test_the_vector_is_what_python_gives(system):
    """Read back to the last bit, lost readings as nan."""
    controller = load_controller("pid_position", system)
    reference, measured = readings(200)
    text = export_controller(controller, reference, measured).files["test_vector.csv"]
    table = np.array([[float(word) for word in line.split(",")] for line in text.splitlines()[1:]])

    np.testing.assert_array_equal(table[:, :3], reference)
    np.testing.assert_array_equal(table[:, 3:8], measured)
    np.testing.assert_array_equal(table[:, 8], replay(controller, reference, measured))
    assert text.startswith("reference_position,reference_velocity,reference_acceleration,speed,")


@pytest.mark.parametrize("number", [NUMBERS["double"], FIXED["q31"]])
def test_texts_have_the_unit_of_the_drive(system, number):
    """A carriage is driven by a force."""
    for model, unit, other in ((system, "A", "N"), (load_plant("emps", model="linear"), "N", "A")):
        controller = load_controller("pid_position", model, current_limit=f"6 {unit}")
        found = export_controller(controller, *readings(50), number=number)

        assert f", tolerance {found.tolerance:g} {unit}" in str(found)
        for name, line in (
            ("test.c", f"#define TOLERANCE {found.tolerance!r} /* {unit} */"),
            ("test.c", f"largest difference from Python %.3g {unit}"),
            ("controller.h", f"#define EHSA_CURRENT_LIMIT 6.0 /* {unit} */"),
            ("README.md", f"{found.tolerance!r} {unit}."),
        ):
            assert line in found.files[name] and line.replace(unit, other) not in found.files[name]


def test_wrong_shapes_are_a_sentence(system):
    controller = load_controller("pid_position", system)

    with pytest.raises(InputError, match=r"shapes \(3, 2\) and \(3, 5\); expected \(N, 3\) and \(N, 5\)"):
        export_controller(controller, np.zeros((3, 2)), np.zeros((3, 5)))


def law_of_numpy(
    reference: np.ndarray, measured: np.ndarray, memory: np.ndarray, settings: np.ndarray, extra: float, hold: float
) -> float:
    return float(np.clip(reference[0] - measured[3], -1.0, 1.0))


def test_a_law_outside_the_subset_is_a_sentence(system):
    """Somebody's own law that uses more than the subset: which function, which line."""
    controller = load_controller("pid_position", system)

    class Own(type(controller.law)):
        function = staticmethod(law_of_numpy)

    own = replace(controller, law=Own(**{k: getattr(controller.law, k) for k in vars(controller.law)}))
    line = law_of_numpy.__code__.co_firstlineno + 3
    with pytest.raises(InputError, match=rf"test_export.py, line {line}: law_of_numpy: the call `np.clip"):
        export_controller(own, *readings(20))


def hurried(law, few):
    """An MPC with few iterations."""
    if hasattr(law, "laws"):
        return replace(law, laws=tuple(hurried(one, few) for one in law.laws))
    return replace(law, iteration_limit=few)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(("name", "few"), [("mpc_position", 12), ("mpc_scheduled", 30)])
def test_an_mpc_is_solved_in_c_as_by_daqp(name, few, system, tmp_path):
    """To the bit the translated Python, and DAQP's solution in every sample, also under violated soft limits; few
    iterations are enough, and with too few the fallback acts in C as in Python."""
    controller = load_controller(name, system)
    rng = np.random.default_rng(2)
    reference, measured = np.zeros((100, 3)), np.tile([0.0, 2e6, 2e6, 0.0, 0.0], (100, 1))
    reference[20:, 0], reference[60:, 0] = 0.002, 0.03
    measured += rng.normal(size=measured.shape) * [0.5, 1.5e4, 1.5e4, 2e-5, 1.0]
    # From 20 bar to less than the lowest point of the schedule.
    measured[:, 1:3] -= np.linspace(0.0, 1.98e6, 100)[:, None]
    measured[40:43] = np.nan
    measured[80:82, 0] += 500.0  # too fast for the soft limit of the speed
    deployment = export_controller(controller, reference, measured)
    report = check_code(deployment, controller, NUMBERS["double"], [])
    vector, run = deployment.vector, report.runs["test vector"]

    assert run.error < 1e-8 and (run.unsolved, vector.fallbacks) == (0, 0)
    assert vector.distance < 1e-9 and run.iterations == vector.iterations.max() > 5
    assert np.any(np.abs(vector.current) > 1.0) and report.operations["flops"] > 5000
    floats = check_code(
        export_controller(controller, reference, measured, number=NUMBERS["float"]), controller, NUMBERS["float"], []
    )
    assert floats.runs["test vector"].unsolved == 0 and floats.runs["test vector"].error < 0.03
    hasty = replace(controller, law=hurried(controller.law, few))
    deployment = export_controller(hasty, reference, measured)
    deployment.write(tmp_path)
    step = step_of(tmp_path, embedded_controller(hasty))

    assert 0 < deployment.vector.fallbacks < 30
    for r, y, current in zip(reference, measured, deployment.vector.current, strict=True):
        assert step(r, y)[0] == current
