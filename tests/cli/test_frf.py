"""`ehsa-ctrl frf`: JSON, table, figure and page."""

import json

import pytest


@pytest.mark.parametrize("method", ["auto", "spectral"])
def test_files_and_page(run, tmp_path, method):
    """Simulated multisines of a linear plant: all files, and models close to the measurement."""
    for seed in (0, 1):
        run("simulate", "ehsa", "--model", "linear", "--excitation", "multisine", "--duration", "12", "--seed",
            str(seed), "--out", str(tmp_path / f"{seed}"))  # fmt: skip
    logs = [str(tmp_path / f"{seed}" / "log.csv") for seed in (0, 1)]
    out = tmp_path / "frf"
    status, text, _ = run("frf", *logs, "--plant", "ehsa", "--model", "linear", "--method", method, "--out", str(out))

    assert status == 0 and "from the linear model" in text
    content = json.loads((out / "frequency_response.json").read_text())
    assert content["method"] == ("periodic" if method == "auto" else "spectral")
    speed = content["channels"]["speed"]
    assert speed["models"]["linear"]["distance"] < (0.02 if method == "auto" else 0.2)
    assert len(speed["frequency"]) == len(speed["real"]) == len(speed["noise_sd"])
    page = (out / "report.html").read_text()
    assert "Frequency response from current" in page and "linear" in page
    assert (out / "response.png").is_file() and (out / "response.csv").is_file()


def test_a_wrong_word_is_one_sentence(run, tmp_path):
    status, _, err = run("frf", str(tmp_path / "none.csv"), "--plant", "ehsa", "--method", "best")

    assert status == 2 and "'best' is not one of 'auto', 'periodic', 'spectral'" in err
