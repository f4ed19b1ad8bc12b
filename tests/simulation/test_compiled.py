"""The cache of compiled engines: warm starts don't compile, edits are never missed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ehsa_ctrl

PROGRAM = """
import sys
import numpy as np
import ehsa_ctrl
from ehsa_ctrl.core.compiled import cache_folder

before = set(cache_folder().glob("*.code"))
plant = ehsa_ctrl.load_plant("emps")
print(repr(float(ehsa_ctrl.simulate(plant, np.full(20, 60.0))["v"][-1])))
print(len(set(cache_folder().glob("*.code")) - before))
"""


@pytest.mark.slow
def test_a_second_start_does_not_compile_and_an_edit_does(tmp_path):
    """Cold: the loop and the plant. Warm: nothing. After an edit of a physics file: another result, the plant anew."""
    root = Path(ehsa_ctrl.__file__).parent.parent
    for folder in ("ehsa_ctrl", "plants"):
        shutil.copytree(root / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "EHSA_CTRL_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}

    def start():
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        speed, compiled = done.stdout.split("\n")[:2]
        return float(speed), int(compiled)

    cold, warm = start(), start()
    carriage = tmp_path / "ehsa_ctrl" / "physics" / "carriage.py"
    stamp = carriage.stat()
    text = carriage.read_text()
    carriage.write_text(text.replace("return F_M - offset", "return 2.0 * F_M - offset"))
    os.utime(carriage, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    edited = start()

    assert cold[1] > 1
    assert warm == (cold[0], 0)
    assert edited[1] == 1
    assert edited[0] > 1.5 * cold[0]
