"""The cache of compiled engines: warm starts don't compile, edits are never missed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core import compiled
from ehsa_ctrl.diagnosis.law.free_run import kept_effect
from ehsa_ctrl.physics.effects import LawFile
from ehsa_ctrl.simulation.plant_code import plant_code

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


def test_a_law_that_is_only_tried_leaves_no_file(tmp_path, monkeypatch):
    """A diagnosis tries a hundred of them; a plant's own effects are stored."""
    monkeypatch.setenv("EHSA_CTRL_CACHE", str(tmp_path))
    # Another test may have compiled the same plant in this process.
    plant_code.cache_clear()
    monkeypatch.setattr(compiled, "_engines", {})
    definition = {
        "schema": 1, "status": "proposed", "summary": "drag", "adds_to": "force", "expression": "c_tried * v * v * v",
        "parameters": {"c_tried": {"value": 3.0, "unit": "N s3/m3", "neutral": 0.0}},
    }  # fmt: skip
    plant = ehsa_ctrl.load_plant("emps")

    def files(effect, **values):
        before = {*tmp_path.glob("*-object-*.code")}
        run = ehsa_ctrl.simulate(plant.with_effects(effect, **values), np.full(20, 60.0))
        assert run["v"][-1] > 0.0
        return len({*tmp_path.glob("*-object-*.code")} - before)

    tried = kept_effect("tried_drag", LawFile.model_validate(definition))

    assert files(tried.name, c_tried=3.0) == 0
    assert files("rod_drag", k_v=3.0) == 1
