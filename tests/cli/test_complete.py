"""What a shell offers after TAB, through the machinery that the shell's own script calls."""

import os
import subprocess
import sys

import pytest

PROGRAM = "import sys; sys.argv = ['ehsa-ctrl']; from ehsa_ctrl.cli.main import main; main()"


@pytest.fixture
def complete(monkeypatch, capsys, tmp_path):
    """Offer for the last word of a line, as bash gets it."""
    from ehsa_ctrl.cli import main as entry

    monkeypatch.chdir(tmp_path)

    def call(line):
        words = line.split(" ")
        monkeypatch.setattr(sys, "argv", ["ehsa-ctrl"])
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        monkeypatch.setenv("_EHSA_CTRL_COMPLETE", "complete_bash")
        with pytest.raises(SystemExit) as stopped:
            entry.main()
        assert (stopped.value.code or 0) == 0
        return capsys.readouterr().out.split()

    return call


@pytest.mark.parametrize(
    ("line", "offer"),
    [
        ("ehsa-ctrl mon", ["montecarlo"]),
        ("ehsa-ctrl run steps_", ["steps_spring"]),
        ("ehsa-ctrl run force_step slow_s", ["slow_sine"]),
        ("ehsa-ctrl run --plant e", ["ehsa", "emps"]),
        ("ehsa-ctrl run --controller lqr_", ["lqr_friction", "lqr_position", "lqr_scheduled"]),
        ("ehsa-ctrl run --controller pid_position,mpc_p", ["pid_position,mpc_position"]),
        ("ehsa-ctrl run --controller lqr_position,lqr_", ["lqr_position,lqr_friction", "lqr_position,lqr_scheduled"]),
        ("ehsa-ctrl analyse eh", ["ehsa"]),
        ("ehsa-ctrl design ehsa --kind l", ["lqr"]),
        ("ehsa-ctrl simulate ehsa --set K_", ["K_L=", "K_T="]),
        ("ehsa-ctrl simulate ehsa --set load.st", ["load.stiffness="]),
        ("ehsa-ctrl simulate emps --set F", ["Fc=", "Fv="]),
        ("ehsa-ctrl identify log.csv --plant emps --free M,F", ["M,Fc", "M,Fv"]),
        ("ehsa-ctrl simulate ehsa --excitation mul", ["multisine"]),
        ("ehsa-ctrl diagnose log.csv --plant ehsa --scenario late", ["late_loop"]),
        ("ehsa-ctrl montecarlo spread", ["spread_steps"]),
        ("ehsa-ctrl list ef", ["effects"]),
        ("ehsa-ctrl new scenario --kind s", ["sine", "steps"]),
        ("ehsa-ctrl new controller --from pid_t", ["pid_tuned"]),
        ("ehsa-ctrl run nothing_", []),
    ],
)
def test_names_are_completed(complete, line, offer):
    """Wherever a command takes one; symbols are those of the plant that is named."""
    assert sorted(complete(line)) == offer


def test_a_users_own_names_are_completed(complete, tmp_path):
    """From ./plants and by path; a file that is no TOML does not stop it."""
    (tmp_path / "plants").mkdir()
    (tmp_path / "plants" / "zrig.toml").write_text("[parameters]\nZ_1 = { value = 1, unit = 'm', source = 'assumed' }")
    (tmp_path / "plants" / "zwrong.toml").write_text("= [")

    assert complete("ehsa-ctrl run --plant z") == ["zrig", "zwrong"]
    assert complete("ehsa-ctrl run --plant ./plants/zr") == ["./plants/zrig.toml"]
    assert complete("ehsa-ctrl simulate zrig --set Z") == ["Z_1="]
    assert complete("ehsa-ctrl simulate no_such --set Z") == []


@pytest.mark.parametrize("line", ["ehsa-ctrl run s", "ehsa-ctrl simulate ehsa --set K"])
def test_completion_is_fast(tmp_path, line):
    """What would make it slow is a heavy import, and none is there."""
    heavy = ("numpy", "scipy", "numba", "control", "matplotlib", "pandas", "cvxpy", "pint", "joblib")
    env = {**os.environ, "COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1)}
    env["_EHSA_CTRL_COMPLETE"] = "complete_bash"
    told = f"import atexit, sys\natexit.register(lambda: print([m for m in {heavy} if m in sys.modules]))\n"
    done = subprocess.run(
        [sys.executable, "-c", told + PROGRAM], cwd=tmp_path, env=env, capture_output=True, text=True, check=True
    )

    *offer, loaded = done.stdout.splitlines()
    assert offer
    assert loaded == "[]"
