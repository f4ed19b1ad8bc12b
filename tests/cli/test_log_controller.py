"""A plant whose file names the controller of its records: where it does not fit, a diagnosis goes on without it."""

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.cli.diagnose import SingleLogOptions, _controller_of_log
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log


@pytest.fixture
def emps():
    return ehsa_ctrl.load_plant("emps")


def sampled(period):
    """A log with a reference, every `period` seconds."""
    time = period * np.arange(500)
    return Log(time, {name: np.sin(time) for name in ("drive_force", "position", "reference")})


def test_the_plants_controller_is_used_at_its_own_rate_and_left_out_at_another(emps, capsys):
    assert _controller_of_log(emps, SingleLogOptions(), [sampled(0.001)]) is not None
    assert _controller_of_log(emps, SingleLogOptions(), [sampled(0.004)]) is None
    assert "no closed-loop replay with the plant's [log.controller]" in capsys.readouterr().err


def test_a_controller_that_was_asked_for_has_to_fit(emps, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        'schema = 1\nkind = "pid"\ntitle = "mine"\nsample_time = "1 ms"\ncurrent_limit = "100 N"\n[gains]\n'
        'k_p = "1000 N/m"\nk_i = "0 N/(m s)"\nk_d = "0 N s/m"\nT_f = "2 ms"\n'
    )

    with pytest.raises(InputError, match="a whole multiple"):
        _controller_of_log(emps, SingleLogOptions(controller=str(file)), [sampled(0.004)])
