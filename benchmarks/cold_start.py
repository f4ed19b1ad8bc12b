"""User CPU time of the first use of a plant, with an empty and with a full cache.

    python benchmarks/cold_start.py

Each row runs in a new process with its own cache folder; importing numpy and the package does not count.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

#: Program before the timed statement. `cpu()` is the user time of the process so far [s].
HEAD = """
import resource
import numpy as np
import ehsa_ctrl
from ehsa_ctrl.diagnosis.hypothesis_model import with_every_effect

def cpu():
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime

plant, linear = ehsa_ctrl.load_plant("ehsa"), ehsa_ctrl.load_plant("ehsa", model="linear")
everything = with_every_effect(plant)
controller = ehsa_ctrl.load_controller("pid_position", ehsa_ctrl.three_state(linear))
current, reference = np.zeros(10), np.zeros((10, 3))
"""
#: Row of the table -> timed statement, and statement that fills the cache before.
LOOPS = "ehsa_ctrl.simulate(linear, current); ehsa_ctrl.sensitivities(linear, ['K_T'], current)"
CASES = {
    "first run on a machine": ("ehsa_ctrl.simulate(plant, current)", ""),
    "first derivatives on a machine": ("ehsa_ctrl.sensitivities(plant, ['K_T'], current)", ""),
    "first closed loop on a machine": ("ehsa_ctrl.run_closed_loop(plant, controller, reference)", ""),
    "another structure": ("ehsa_ctrl.simulate(plant, current)", LOOPS),
    "derivatives of another structure": ("ehsa_ctrl.sensitivities(plant, ['K_T'], current)", LOOPS),
    "structure with all effects": ("ehsa_ctrl.simulate(everything, current)", LOOPS),
}


def seconds(statement: str, before: str, cache: str) -> float:
    """User CPU time [s] of a statement in a new process."""
    environment = {**os.environ, "EHSA_CTRL_CACHE": cache}
    if before:
        subprocess.run([sys.executable, "-c", HEAD + before], env=environment, check=True)
    program = f"{HEAD}begin = cpu()\n{statement}\nprint(cpu() - begin)"
    done = subprocess.run([sys.executable, "-c", program], env=environment, check=True, capture_output=True, text=True)
    return float(done.stdout)


def main() -> None:
    print(f"{'user CPU seconds':34s} {'empty cache':>12s} {'full cache':>12s}")
    for name, (statement, before) in CASES.items():
        with tempfile.TemporaryDirectory() as cache:
            cold, warm = seconds(statement, before, cache), seconds(statement, "", cache)
        print(f"{name:34s} {cold:12.2f} {warm:12.2f}")


if __name__ == "__main__":
    main()
