"""Controllers in fixed point: the specialised program against the law, and its integers against doubles."""

import ctypes
import math
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from export_inputs import STRICT, full, loop_readings, readings

from ehsa_ctrl import InputError, load_controller, load_plant, three_state
from ehsa_ctrl.design.export import FIXED, check_code, export_controller, replay
from ehsa_ctrl.design.export.fixed.functions import CALLS, used_functions
from ehsa_ctrl.design.export.fixed.ranges import replay_specialised
from ehsa_ctrl.design.export.fixed.specialise import specialise
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS
from ehsa_ctrl.design.specification import starting_definition
from ehsa_ctrl.design.stages.scheduling import Schedule

CC = shutil.which("cc") or shutil.which("gcc")
needs_compiler = pytest.mark.skipif(CC is None, reason="there is no C compiler here")
#: A controller of every kind that has fixed-point code, and two more forms of state feedback.
WITHOUT = ("mpc", "scheduled_mpc")
LAWS = sorted(
    {starting_definition(kind)[1].stem for kind in CONTROLLER_KINDS if kind not in WITHOUT}
    | {"lqi_position", "lqr_friction", "pid_adaptive"}
)


@pytest.fixture(scope="module")
def system():
    return three_state(load_plant("ehsa", model="linear"))


@pytest.mark.parametrize("stages", ["own", "all"])
@pytest.mark.parametrize("name", LAWS)
def test_the_specialised_program_is_the_law(name, stages, system):
    """In doubles, to the bit: with the settings known, nothing but operations that they decide has gone."""
    controller = load_controller(name, system)
    controller = full(controller) if stages == "all" else controller
    reference, measured = readings(1200)
    if controller.follows_force:
        reference = np.column_stack([reference, np.resize([0.0, 9.0, 9.0, 4.0, 0.0], len(reference))])
    program = specialise(controller)
    seen, (currents,) = replay_specialised(program, controller, [(reference, measured)])

    np.testing.assert_array_equal(currents, replay(controller, reference, measured))
    # No term is left that multiplies by a known 0, and the ranges hold every number of the inputs.
    assert not any(t.operation == "*" and any(_known(a, 0.0) for a in t.arguments) for t in program.terms())
    np.testing.assert_array_equal(seen.measured, np.nanmax(np.abs(measured), axis=0))


@pytest.mark.slow
def test_the_program_is_the_same_in_every_run():
    """Whatever the order of sets, which Python draws anew at each start: an export can be compared with the last."""
    program = (
        "from ehsa_ctrl import load_controller, load_plant, three_state\n"
        "from ehsa_ctrl.design.export.fixed.specialise import specialise\n"
        "system = three_state(load_plant('ehsa', model='linear'))\n"
        "print(specialise(load_controller('force_press', system)))"
    )
    texts = {
        subprocess.run(
            [sys.executable, "-c", program], env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True
        ).stdout
        for seed in ("1", "2", "3")
    }

    assert len(texts) == 1


def _known(term, value):
    return term.operation == "constant" and term.value == value


@needs_compiler
@pytest.mark.parametrize(
    "name", ["pid_friction", *(pytest.param(law, marks=pytest.mark.slow) for law in LAWS if law != "pid_friction")]
)
def test_integers_are_near_doubles(name, system, tmp_path):
    """In words of 32 bits the current is nearer to Python's than the converters of a drive; strict compilers have
    nothing to say, and nothing of the code is floating-point or from a library."""
    controller = load_controller(name, system)
    reference, measured = loop_readings(controller)
    deployment = export_controller(controller, reference, measured, number=FIXED["q31"])
    deployment.write(tmp_path)
    report = check_code(deployment, controller, FIXED["q31"], [])

    assert report.usable and report.runs["test vector"].error < 1e-4 * controller.current_limit
    assert report.operations["flops"] > 20 and (report.stack is None or 0 < report.stack < 2048)
    code = re.sub(r"/\*.*?\*/", "", deployment.files["controller.c"], flags=re.DOTALL)
    assert not re.search(r"\b(double|float)\b|\d\.\d|malloc", code)
    subprocess.run([CC, *STRICT, "-c", "controller.c", "-o", "controller.o"], cwd=tmp_path, check=True)
    listed = subprocess.run(["nm", "-u", "controller.o"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert {line.split()[-1] for line in listed.stdout.splitlines()} <= {"_GLOBAL_OFFSET_TABLE_", "memset"}


@needs_compiler
def test_words_of_16_bits_are_coarser(system):
    """The same law is usable with 32 bits and, with its small increments of the integral, worse with 16; the report has
    every signal's last bit."""
    controller = load_controller("pid_position", system)
    reference, measured = loop_readings(controller)
    reports = {}
    for word, number in FIXED.items():
        deployment = export_controller(controller, reference, measured, number=number)
        reports[word] = check_code(deployment, controller, number, [("again", reference, measured)])
    fine, coarse = reports["q31"].signals, reports["q15"].signals

    assert reports["q31"].usable
    assert 100 * fine["current"].error < coarse["current"].error
    for name, signal in fine.items():
        assert signal.step is not None and math.isclose(coarse[name].step, 2**16 * signal.step)
        assert signal.headroom > 0
    assert "not usable" in str(replace(reports["q15"], tolerance=1e-6)) and "last bit" in str(reports["q15"])


def over_all_points(controller, samples=1500):
    """Reference and readings that lead the pressure level and the position over and beyond all points of a schedule."""
    k = np.arange(samples)
    reference = np.column_stack([0.03 + 0.06 * np.sin(k / 150), np.zeros((samples, 2))])
    level = 1.2e6 * (1.0 + np.sin(k / 60))
    still = np.zeros(samples)
    measured = np.column_stack([still, level, level, reference[:, 0] + 1e-3 * np.sin(k / 9), still])
    return reference, measured


@pytest.mark.parametrize("stages", ["own", "all"])
@pytest.mark.parametrize("name", ["pid_scheduled", "lqr_scheduled", "three by three"])
def test_a_schedule_is_searched_and_interpolated(name, stages, system):
    """Over all points and beyond, with one variable and with two: to the bit, although the settings are tables now."""
    controller = three_by_three(system) if name == "three by three" else load_controller(name, system)
    controller = full(controller) if stages == "all" else controller
    reference, measured = over_all_points(controller)
    program = specialise(controller)
    _, (currents,) = replay_specialised(program, controller, [(reference, measured)])

    np.testing.assert_array_equal(currents, replay(controller, reference, measured))
    assert any(term.operation == "table" for term in program.terms())


def three_by_three(system):
    """A scheduled PID over a grid in which both variables are searched; its gains have no order."""
    scheduled = load_controller("pid_scheduled", system)
    first = scheduled.law.pids[0]
    levels, places = ("2 bar", "6 bar", "20 bar"), ("-20 mm", "30 mm", "80 mm")
    points = [{"at": level, "second_at": place} for level in levels for place in places]
    schedule = Schedule(variable="level", second_variable="position", points=points)
    factors = (1.0, 0.4, 2.0, 0.7, 1.6, 0.3, 1.1, 0.9, 2.5)
    pids = [replace(first, gains=replace(first.gains, k_p=first.gains.k_p * f)) for f in factors]
    return replace(scheduled, law=replace(scheduled.law, schedule=schedule, pids=tuple(pids)))


@needs_compiler
@pytest.mark.parametrize("name", ["pid_scheduled", "lqr_scheduled", "three by three"])
def test_integers_follow_a_schedule(name, system):
    """Also at points that the runs for the scales did not reach: a row has the range of its table."""
    controller = three_by_three(system) if name == "three by three" else load_controller(name, system)
    reference, measured = over_all_points(controller)
    # The scales see one end of the table alone, which is where the gains of the shipped ones are largest.
    highest = np.argsort(measured[:, 1])[-200:]
    seen = reference[highest], np.where(measured[highest] > 0.0, measured[highest], 0.0)
    deployment = export_controller(controller, *seen, number=FIXED["q31"])
    report = check_code(deployment, controller, FIXED["q31"], [("all points", reference, measured)])

    assert report.runs["all points"].error < 1e-4 * controller.current_limit
    assert report.signals["scheduling"].largest > 2.2e6


SATURATED = ("lqr_friction", "repetitive_press", "pid_scheduled", "lqr_scheduled")
MAIN = """
#include <stdio.h>
#include <string.h>
int main(void)
{
    unsigned seed = 1;
    WORD memory[EHSA_MEMORY], reference[4], measured[5];
    ehsa_reset(memory);
    for (int k = 0; k < 20000; k++) {
        for (int i = 0; i < 9; i++) {
            seed = seed * 1664525U + 1013904223U;
            unsigned draw = seed >> 8;
            seed = seed * 1664525U + 1013904223U;
            /* Any bits, the ends of the type, zero, or a lost reading. */
            WORD value = (WORD)(draw % 5 == 0 ? LARGEST : draw % 5 == 1 ? -LARGEST : draw % 5 == 2 ? 0 : (int)seed);
            if (i < 4) reference[i] = value; else measured[i - 4] = draw % 50 == 7 ? EHSA_LOST : value;
        }
        if (k % 500 == 0) ehsa_reset(memory);
        long long current = ehsa_step(reference, measured, memory);
        if (current > LIMIT || current < -LIMIT) { printf("%lld\\n", current); return 1; }
    }
    return 0;
}
"""


@needs_compiler
@pytest.mark.parametrize("word", FIXED)
@pytest.mark.parametrize(
    "name",
    ["sliding_friction", *(pytest.param(law, marks=pytest.mark.slow) for law in SATURATED)],
)
def test_no_input_overflows(name, word, system, tmp_path):
    """Readings of any bits: no operation that C leaves undefined, and the current stays within its limit."""
    controller = full(load_controller(name, system))
    reference, measured = loop_readings(controller)
    number = FIXED[word]
    deployment = export_controller(controller, reference, measured, number=number)
    deployment.write(tmp_path)
    fixed = deployment.fixed
    limit = math.ceil(controller.current_limit / fixed.current.step)
    defined = {"WORD": number.word, "LARGEST": number.largest, "LIMIT": limit}
    head = "".join(f"#define {key} {value}\n" for key, value in defined.items())
    (tmp_path / "main.c").write_text(f'#include "controller.h"\n{head}{MAIN}')
    call = [CC, "-std=c99", "-O1", "-fsanitize=undefined", "-fno-sanitize-recover=all", "controller.c", "main.c"]
    built = subprocess.run([*call, "-o", "all"], cwd=tmp_path, capture_output=True, text=True)
    if "ubsan" in built.stderr:
        pytest.skip("this compiler has no sanitizer")
    assert built.returncode == 0, built.stderr
    done = subprocess.run(["./all"], cwd=tmp_path, capture_output=True, text=True)

    assert done.returncode == 0, done.stderr + done.stdout


@needs_compiler
@pytest.mark.parametrize("word", FIXED)
def test_functions_of_integers_are_those_of_numpy(word, tmp_path):
    """sqrt, 2^x, sin, division and remainder, at random and at their ends, to a few units of the last bit."""
    number = FIXED[word]
    bits = number.bits
    text = used_functions(" ".join(f"{name}(" for name in CALLS), number)
    exported = re.sub(r"^static ", "", text, flags=re.MULTILINE)
    (tmp_path / "f.c").write_text(f"#include <stdint.h>\n{exported}\n")
    subprocess.run([CC, "-std=c99", "-O2", "-shared", "-fPIC", "f.c", "-o", "f.so"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "f.so"))
    wide, narrow = {32: (ctypes.c_int64, ctypes.c_int32), 16: (ctypes.c_int32, ctypes.c_int16)}[bits]
    for name in ("root", "quotient", "remainder_of", "rounded", "polynomial"):
        getattr(library, name).restype = wide
    for name in ("power_of_two", "sine", "saturated", "raised"):
        getattr(library, name).restype = narrow
    rng = np.random.default_rng(0)
    one = 2 ** (bits - 2)

    for x in [0, 1, 2, 3, 4, 2**number.room - 1, *rng.integers(0, 2**number.room, 200).tolist()]:
        assert library.root(wide(x)) == math.isqrt(x)
    for x in [0, 1, one // 4, one // 2, one - 1, 3 * one // 4, *rng.integers(0, one, 200).tolist()]:
        assert abs(library.sine(wide(x)) - one * math.sin(2 * math.pi * x / one)) < 8
    for x in [0, -1, -one, 1 - one, -5 * one, *(-rng.integers(0, 2 * one, 200)).tolist()]:
        assert abs(library.power_of_two(wide(x), bits - 2) - one * 2.0 ** (x / one)) < 8
    for a, b in rng.integers(-number.largest, number.largest, (200, 2)).tolist():
        exact = a * 2 ** (bits - 1) / b if b else math.inf
        assert abs(library.quotient(narrow(a), narrow(b)) - exact) <= 1
        assert library.remainder_of(wide(a), wide(b)) == a % b
        assert library.rounded(wide(a), 5) == math.floor(a / 32 + 0.5)
    most = number.largest
    assert [library.saturated(wide(x)) for x in (most + 1, -most - 1, 7)] == [most, -most, 7]
    assert [library.raised(wide(x), 4) for x in (most, -most, 7)] == [most, -most, 112]


@pytest.mark.parametrize("name", ["mpc_position", "mpc_scheduled"])
def test_a_law_without_fixed_point_code_is_a_sentence(name, system):
    """A solver needs floats."""
    controller = load_controller(name, system)

    with pytest.raises(InputError, match=rf"{name} has a solver.*no fixed-point code; expected --number double"):
        export_controller(controller, *readings(20), number=FIXED["q31"])
