"""Reading a measured record: right ones as they are, wrong ones with file, column and row."""

import numpy as np
import pytest

from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log, read_log


def write(path, text):
    path.write_text(text)
    return path


def test_a_log_survives_writing_and_reading(tmp_path):
    """What is written is read back to the decimals of its sensor."""
    time = 0.004 * np.arange(5)
    log = Log(time, {"current": np.array([0, 1, -1, 0.12345, 2]), "position": np.linspace(0, 1e-3, 5)})
    log.write(tmp_path / "log.csv")

    again = read_log(tmp_path / "log.csv", ["current"])

    np.testing.assert_allclose(again.time, time, atol=1e-9)
    np.testing.assert_allclose(again["current"], log["current"], atol=1e-9)
    np.testing.assert_allclose(again["position"], log["position"], atol=1e-9)
    assert again.sample_time == pytest.approx(0.004)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,curent\n0,1\n0.1,1\n", r"no column 'current'; did you mean 'curent'"),
        ("t,current\n0,1\n0.1,nan\n0.2,1\n", r"column 'current', row 3: 'nan' is no finite number"),
        ("t,current\n0,1\n0.1,abc\n0.2,1\n", r"column 'current', row 3: 'abc' is no finite number"),
        ("t,current\n0,1\n0.1,1\n0.2,1\n0.5,1\n0.6,1\n", r"column 't', row 5: a gap of 0.3 s after 0.2 s"),
        ("t,current\n0,1\n0,1\n0,1\n", r"does not advance"),
        ("t,current\n0,1\n", r"has 1 rows of data; expected at least 2"),
        ("", r"is no CSV table"),
    ],
)
def test_a_wrong_log_is_one_sentence(tmp_path, text, says):
    """Each mistake names the file and where in it the mistake is."""
    path = write(tmp_path / "u.csv", text)

    with pytest.raises(InputError, match=says) as caught:
        read_log(path, ["current"])

    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    """No traceback of pandas for a file that is not there."""
    with pytest.raises(InputError, match="no such file"):
        read_log(tmp_path / "nothing.csv", ["current"])
