"""Word lengths: exported controllers in floats and in fixed point beside Python's doubles, over all shipped scenarios.

Prints the first table of docs/how-to/export.md; `python benchmarks/word_length.py lqr_friction` the signals of one
controller.
"""

import math
import sys

from ehsa_ctrl import InputError, load_controller, load_plant, scenarios
from ehsa_ctrl.design.export import NUMBERS, check_code, export_controller
from ehsa_ctrl.plant.conditions import linear_model
from ehsa_ctrl.scenario.recorded_runs import recorded_runs
from ehsa_ctrl.simulation.exercise import exercise_controller

#: One of each kind, some of them with all stages.
NAMES = (
    "pid_position", "pid_friction", "pid_adaptive", "pid_scheduled", "cascade_position", "cascade_friction",
    "lqr_position", "lqr_friction", "lqi_position", "lqr_scheduled", "adrc_position", "adrc_friction",
    "sliding_friction", "repetitive_press", "force_press", "impedance_push", "carriage_pid",
)  # fmt: skip

#: Controller -> plant, where that is not the EHSA.
PLANTS = {"carriage_pid": "emps"}


def checks(name):
    """Number -> CodeCheck of a controller, or the reason why there is none."""
    plant, linear = (load_plant(PLANTS.get(name, "ehsa"), model=model) for model in ("nonlinear", "linear"))
    controller = load_controller(name, linear_model(linear))
    reference, measured, _ = exercise_controller(plant, controller, controller.current_limit, 0)
    runs, _ = recorded_runs(scenarios.values(), controller, plant)
    ranges = [(run.reference, run.measured) for run in runs]
    found = {}
    for word in ("float", "q31", "q15"):
        try:
            deployment = export_controller(controller, reference, measured, number=NUMBERS[word], runs=ranges)
        except InputError as error:
            found[word] = str(error)
            continue
        found[word] = check_code(deployment, controller, NUMBERS[word], runs)
    return found


def cell(check):
    if isinstance(check, str):
        return "no code"
    error = 1e3 * check.runs[check.worst].error
    unit = check.unit
    return f"{error:.2g} m{unit}" if check.usable else f"**{error / 1e3:.2g} {unit}, not usable**"


def main(names):
    print("| controller | float | q31 | q15 | operations, stack in q31 |\n|---|---|---|---|---|")
    last = {}
    for name in names:
        last = checks(name)
        fixed = last["q31"]
        cost = "" if isinstance(fixed, str) else f"{fixed.operations['flops']}, {fixed.stack} bytes"
        print(f"| `{name}` | {' | '.join(cell(last[word]) for word in ('float', 'q31', 'q15'))} | {cost} |", flush=True)
    if len(names) > 1 or isinstance(last["q31"], str):
        return
    print("\n| signal (SI) | largest | last bit q31, q15 | headroom | error float, q31, q15 |\n|---|---|---|---|---|")
    for name, signal in last["q31"].signals.items():
        others = [last[word].signals[name] for word in ("float", "q31", "q15")]
        room = "never moved" if math.isinf(signal.headroom) else f"{signal.headroom:.1f} bits"
        errors = ", ".join(f"{other.error:.2g}" for other in others)
        print(f"| `{name}` | {signal.largest:.3g} | {signal.step:.2g}, {others[2].step:.2g} | {room} | {errors} |")


if __name__ == "__main__":
    main(sys.argv[1:] or NAMES)
