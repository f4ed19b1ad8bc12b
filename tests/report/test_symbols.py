"""Symbols that nobody typed are told with the key that sets them, wherever a person reads them."""

import numpy as np
import pytest

from ehsa_ctrl import load_plant
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.core.result import plain
from ehsa_ctrl.diagnosis.diagnosis import Cause, CauseParameter, Diagnosis
from ehsa_ctrl.identification.parameters import free_parameters
from ehsa_ctrl.report.kinds.diagnosis import KIND
from ehsa_ctrl.scenario.sensitivity import Influence
from ehsa_ctrl.scenario.uncertainty import UncertainParameter

BOTH = "K_S (load.stiffness)"


@pytest.fixture
def plant():
    return load_plant("ehsa", settings={"load.stiffness": "1e6"})


def test_a_spring_that_was_drawn_goes_by_its_key():
    """In what was drawn, and in what decides."""
    assert str(UncertainParameter("K_S", 5e4, 0.0, 1e5, unit="N/m")).startswith(f"{BOTH} uniform from")
    assert str(Influence("K_S", "ks", 0.5, 1e-9, 1e4, 5e4)).startswith(f"{BOTH} is decisive")


def test_a_spring_that_was_set_goes_by_its_key(plant):
    """In a plant's table, and in an error's list of what is free."""
    assert f"  {BOTH} " in str(plant)
    with pytest.raises(InputError, match=r"free are .*K_S \(load\.stiffness\)"):
        free_parameters(plant, free=["load.stiffness"], fix=["K_T"])


def test_a_spring_that_is_the_cause_goes_by_its_key(plant, tmp_path):
    """In the print, on the page of what was set, and in an overview."""
    cause = Cause("load_spring", None, "force", 0.9, {"K_S": CauseParameter(2e4, 100.0, "N/m")})
    gaps = {model: {"p1": 0.1, "total": 0.1} for model in ("nominal", "with_effects")}
    log = Log(np.array([0.0, 0.004]), {})
    found = Diagnosis(
        plant, log, 0.03, "effect", (("force", 1.0),), (cause,), gaps, gaps["nominal"], "the last third", {}, {}, {}
    )

    assert f"{BOTH} = 2e+04 +- 1e+02 N/m" in str(found)
    page = KIND.read(plain(found.to_dict()), tmp_path)
    assert dict(page.facts)["parameters set"].startswith(f"{BOTH} = ")
    assert f"{BOTH} = " in " ".join(words for words, _ in page.sentences)
