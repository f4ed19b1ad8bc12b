"""The benchmark of withheld effects: its own physics, its own key, and a scorer that can be wrong."""

import ast
import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks" / "withheld"

# The bench's modules are scripts beside one another; numba's cache finds them again by these names.
sys.path.append(str(FOLDER))
import calibration  # noqa: E402
import cases  # noqa: E402
import draw  # noqa: E402
import figures  # noqa: E402
import gap  # noqa: E402
import score  # noqa: E402
import score_statistics  # noqa: E402
from answer_score import FAILED, score_answer  # noqa: E402
from cause import Bench, Conditions, set_parameter  # noqa: E402
from effect_gap import EffectGap  # noqa: E402
from effects import DRAWN, IDS, OUTSIDE  # noqa: E402
from effects import draw as draw_effect  # noqa: E402
from effects_outside import LAWS, draw_outside  # noqa: E402
from key import beside_the_others  # noqa: E402
from plant import simulate  # noqa: E402
from rig import LINEAR, Rig  # noqa: E402
from sensors import NOISE, Sensors  # noqa: E402

pytestmark = pytest.mark.slow


def sine(n=500, amplitude=2.0):
    return amplitude * np.sin(2.0 * np.pi * 1.5 * 0.004 * np.arange(n))


# The plant.


def imports(file):
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield node.module.split(".")[0]


def test_neither_side_imports_the_other():
    """The bench never sees the package, the package never sees the bench."""
    bench = {name for file in FOLDER.glob("*.py") for name in imports(file)}
    package = {name for file in (ROOT / "ehsa_ctrl").rglob("*.py") for name in imports(file)}

    assert "plant" in bench and "ehsa_ctrl" not in bench
    assert "numpy" in package and not package & {"benchmarks", *(file.stem for file in FOLDER.glob("*.py"))}


def test_without_dry_friction_it_is_the_linear_system():
    """The linear set, sampled with the current held, is what the matrix exponential makes of (6)."""
    from scipy.signal import cont2discrete

    p = LINEAR
    c = p.beta / p.V_10
    # speed, P1, P2, v, x
    A = np.array(
        [
            [-p.B_FM / p.J_M, -p.D / p.J_M, p.D / p.J_M, 0.0, 0.0],
            [c * p.D, -c * p.K_L, c * p.K_L, -c * p.A, 0.0],
            [-c * p.D, c * p.K_L, -c * p.K_L, c * p.A, 0.0],
            [0.0, p.A / p.M, -p.A / p.M, -p.B_FR / p.M, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0],
        ]
    )
    B = np.array([[p.K_T / p.J_M], [0.0], [0.0], [0.0], [0.0]])
    F, G, *_ = cont2discrete((A, B, np.eye(5), np.zeros((5, 1))), 0.004)
    current = sine(amplitude=0.8)
    y = [np.array([0.0, p.P_0, p.P_0, 0.0, 0.0])]
    for i in current:
        y.append(F @ y[-1] + G[:, 0] * i)

    run = simulate(p, current)

    scale = np.std(y, axis=0)
    assert np.all(np.abs(run.states - np.array(y)) < 2e-4 * scale)


def test_steady_speed_with_friction_is_that_of_the_balances():
    """At a held current shaft, flow and rod balances, solved by hand, give speed and pressure difference."""
    p, current = Rig(), 1.7
    # J w' = 0, flow = 0, M v' = 0 in (w, dP, v), Stribeck terms gone at this speed.
    M = np.array([[p.B_FM, p.D, 0.0], [p.D, -p.K_L, -p.A], [0.0, p.A, -p.B_FR]])
    w, dP, _ = np.linalg.solve(M, [p.K_T * current - p.A_FM, 0.0, p.A_FR])

    end = simulate(p, np.full(250, current)).states[-1]

    assert end[0] == pytest.approx(w, rel=1e-3)
    # The volumes still change, so that the difference is not quite at rest.
    assert end[1] - end[2] == pytest.approx(dP, rel=2e-3)


def test_dry_friction_holds_exactly():
    """Below breakaway nothing moves at all; between both breakaways the shaft creeps and the rod stays."""
    still = simulate(Rig(), np.full(200, 0.7)).states
    creeps = simulate(Rig(), np.full(50, 0.8)).states

    assert np.all(still[:, [0, 3, 4]] == 0.0)
    assert creeps[5, 0] > 0.0 and np.all(creeps[:, 4] == 0.0)


@pytest.mark.parametrize(
    "rig",
    [
        Rig(),
        Rig(K_S=5e4, width=1e-3, k_3=1e7, air=0.01, tau_I=2e-3, lag_law=1.0),
        Rig(x_stop=0.008, bristle=1e-7, K_t=5e-9, c_f=0.1, R_turb=1e12, line_law=1.0),
    ],
    ids=["plain", "play", "stops"],
)
def test_a_shorter_step_changes_less_than_the_noise(rig):
    """An eighth of the step moves no channel by more than a tenth of its noise, RMS."""
    coarse = simulate(rig, sine()).samples
    fine = simulate(rig, sine(), steps=640).samples

    noise = np.array([NOISE[name] for name in ("speed", "p1", "p2", "position", "force")])
    assert np.all(np.sqrt(np.mean((coarse - fine) ** 2, axis=0)) < 0.1 * noise)


@pytest.mark.parametrize("id", DRAWN)
def test_every_effect_grows_from_little_to_a_gap(id):
    """At the small end of its range an effect moves the signals less than at the large end, which makes a gap."""
    spring = 5e4 if id in ("backlash", "load_spring") else 0.0
    nominal = Rig(K_S=spring)
    current = sine(1500 if id == "viscosity_warmup" else 400, 2.2)
    conditions = Conditions(np.random.default_rng(1), simulate(nominal, current).samples, spring)
    effect = draw_effect(id, conditions)
    effect_gap = EffectGap(nominal, current)

    small, large = (gap.largest(effect_gap.of_effect(effect, s).alone) for s in (effect.smallest, effect.largest))

    assert effect.id == id
    assert small < 0.05 < large
    assert small < large


@pytest.mark.parametrize("law", LAWS)
def test_what_is_outside_the_catalogue_acts(law):
    """Each of them can cause a gap."""
    current = sine(2600, 2.2)
    samples = simulate(Rig(), current, steps=40).samples
    effect = draw_outside(Conditions(np.random.default_rng(1), samples, 0.0), law)

    cause = EffectGap(Rig(), current).of_effect(effect, effect.largest)

    assert effect.id == OUTSIDE and cause.counts


def test_sensors_add_the_noise_they_claim():
    """Standard deviations over a log at rest, with the position's steps of 10 um."""
    run = simulate(Rig(), np.zeros(4000), steps=4)

    log = Sensors().log(run, np.random.default_rng(0), force=True)

    assert np.std(log["position"]) == pytest.approx(np.hypot(20e-6, 10e-6 / np.sqrt(12.0)), rel=0.04)
    assert np.allclose(np.round(log["position"] / 1e-5), log["position"] / 1e-5)
    for name in ("current", "speed", "p1", "p2", "force"):
        assert np.std(log[name]) == pytest.approx(NOISE[name], rel=0.05)


def test_sensor_delay_and_filter_act_in_time():
    """A delay of one sample is the log a row later; a first-order filter lags a ramp by its time constant."""
    run = simulate(Rig(), np.full(120, 1.8))
    rng = np.random.default_rng(0)

    plain, late = (Sensors(delay=d).clean(run, rng)[:, 0] for d in ({}, {"speed": 0.004}))
    slow = Sensors(lag={"position": 0.01}).clean(run, rng)[:, 3]

    assert np.allclose(late[1:], plain[:-1], atol=1e-9)
    x = run.samples[:, 3]
    assert x[-1] - slow[-1] == pytest.approx(0.01 * run.states[-1, 3], rel=0.02)


# The gap and the key.


def test_gap_is_the_error_beyond_the_noise_in_parts_of_the_spread():
    """Noise alone is no gap; a scale error of 10 % is a gap of 10 % in that signal, whatever the noise."""
    rng = np.random.default_rng(3)
    samples = np.column_stack([np.sin(0.01 * k * np.arange(20_000)) for k in (1, 2, 3, 4)])
    noise = {"speed": 0.2, "p1": 0.2, "p2": 0.2, "rod_velocity": 1e-9}
    clean = gap.signals(*samples.T)
    noisy = gap.signals(*(samples * [1.1, 1.0, 1.0, 1.0] + rng.normal(0.0, 0.2, samples.shape) * [1, 1, 1, 0]).T)

    found = gap.gap(noisy, clean, noise)

    spread = np.std(noisy["speed"])
    assert found["speed"] == pytest.approx(0.1 / np.sqrt(2.0) / spread, rel=0.1)
    assert found["p1"] < 0.03 and found["rod_velocity"] == 0.0
    assert found["total"] == pytest.approx(np.sqrt(sum(found[s] ** 2 for s in gap.SIGNALS) / 4.0))


def test_sizes_are_found_for_the_gap_that_is_asked():
    """The size search ends within 10 % of the gap it was asked for."""
    current = sine(500, 2.2)
    conditions = Conditions(np.random.default_rng(1), simulate(Rig(), current).samples, 0.0)
    effect = draw_effect("internal_leakage", conditions)

    cause = EffectGap(Rig(), current).scaled_to(effect, 0.09)

    assert gap.largest(cause.alone) == pytest.approx(0.09, rel=0.11)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A few short cases in a folder, as the scorer gets them."""
    folder = tmp_path_factory.mktemp("cases")
    patch = pytest.MonkeyPatch()
    patch.setattr(draw, "SAMPLES", 1500)
    patch.setattr(draw, "SAMPLES_VALIDATE", 750)
    for family, index in (("single", 2), ("none", 1), ("outside", 0), ("weak", 0)):
        cases.write(draw.draw("tuning", family, index), f"tuning_{family}_{index:04d}", folder)
    again, other = draw.draw("tuning", "weak", 0), draw.draw("reported", "weak", 0)
    patch.undo()
    return folder, cases.collect_keys(folder), again, other


def test_an_end_stop_out_of_reach_makes_no_gap_beside_what_keeps_the_rod_away():
    """Half of the torque constant: the rod no longer reaches the stop, which alone makes a gap."""
    current = sine(amplitude=1.5)
    reach = float(np.max(np.abs(simulate(Rig(), current).samples[:, 3])))
    effect_gap = EffectGap(Rig(), current)
    weak, stop = (
        effect_gap.of_effect(set_parameter(id, "", name, 0.0, 2.0), size)
        for id, name, size in (("torque_constant", "K_T", 0.5 * Rig().K_T), ("end_stop", "x_stop", 0.8 * reach))
    )

    of_weak, of_stop = beside_the_others(Bench(Rig()), [weak, stop], current)

    assert gap.largest(stop.alone) > 0.03 and gap.largest(of_stop) < 1e-6 < gap.largest(of_weak)


def test_a_case_is_its_seed(drawn):
    """The same set, family and index give the same log and key; the other set's seeds give another."""
    folder, key, again, other = drawn
    with (folder / "tuning_weak_0000.csv").open() as file:
        rows = list(csv.DictReader(file))

    assert np.allclose([float(r["speed"]) for r in rows], again.log["speed"])
    assert key["tuning_weak_0000"] == json.loads(json.dumps(again.key))
    assert not np.array_equal(other.log["speed"], again.log["speed"])


def test_keys_say_what_the_threshold_says(drawn):
    """A cause alone moves a signal by the threshold; without causes all errors together stay below it."""
    _, key, *_ = drawn
    for case in key.values():
        total = max(case["gap"].values())

        assert (total >= draw.THRESHOLD) == bool(case["effects"])
        assert all(max(e["alone"][s] for s in gap.SIGNALS) >= draw.THRESHOLD for e in case["effects"])
        assert all(0.0099 < abs(e) <= 0.15 for e in case["parameter_errors"].values())
        assert case["family"] == "outside" or case["held_out"]["gap"]["truth"]["total"] < draw.THRESHOLD
    assert {case["verdict"] for case in key.values()} == {"no_gap", "effect", OUTSIDE}


def test_logs_have_the_columns_of_the_contract(drawn):
    """Header, decimals and uniform time; the model settings name their files."""
    folder, key, *_ = drawn
    for name in key:
        model_settings = json.loads((folder / f"{name}.json").read_text())
        with (folder / model_settings["log"]).open() as file:
            rows = list(csv.reader(file))

        assert rows[0][:6] == ["t", "current", "speed", "p1", "p2", "position"]
        assert rows[1][0] == "0.000" and rows[-1][0] == f"{0.004 * (len(rows) - 2):.3f}"
        assert not model_settings.get("validate") or (folder / model_settings["validate"]).exists()


def test_a_plan_keeps_the_shares():
    """A full set holds at least 300 without a gap and 100 outside; a longer plan begins with a shorter one."""
    plan = cases.plan(1300)

    assert sum(f == "none" for f, _ in plan) >= 300 and sum(f == "outside" for f, _ in plan) >= 100
    assert len(set(plan)) == 1300
    assert cases.plan(90) == plan[:90]


# The scorer.


def key_of(*effects, family="single", verdict=None, **more):
    rows = [
        {"id": id, "channel": channel, "law": "", "place": ["flow"], "alone": {}, "accepted": accepted}
        for id, channel, accepted in effects
    ]
    return {
        "verdict": verdict or ("effect" if rows else "no_gap"),
        "effects": rows,
        "gap": dict.fromkeys(gap.SIGNALS, 0.1 if rows else 0.01),
        "family": family,
        "loop": "centring",
        "load_cell": True,
        "parameter_errors": {},
        "held_out": {"gap": {"nominal": {"total": 0.1}, "truth": {"total": 0.01}}},
        **more,
    }


def cause(id, channel=None, *also):
    return id, channel, [{"id": i, "channel": c} for i, c in ((id, channel), *also)]


def answer_of(verdict, *effects, closed=0.01):
    """effects: (id, probability, set) or (id, probability, set, channel)."""
    rows = [
        {"id": e[0], "probability": e[1], "ambiguous_with": list(e[2]), "channel": e[3] if len(e) > 3 else None}
        for e in effects
    ]
    return {
        "verdict": verdict,
        "where": [{"place": "flow", "share": 0.8}, {"place": "force", "share": 0.2}],
        "effects": rows,
        "gap": {"nominal": {"total": 0.1}, "with_effects": {"total": closed}},
        "seconds": 2.0,
    }


KEYS = [
    *[key_of(cause(id)) for id in IDS],
    *[key_of(family="none") for _ in range(20)],
    *[key_of(cause(OUTSIDE), family="outside", verdict=OUTSIDE) for _ in range(5)],
    *[key_of(cause(a), cause(b), family="pair") for a, b in zip(IDS[:6], IDS[6:12], strict=True)],
]


def figure(rows, heading, label):
    return next(f for f in score_statistics.sections(rows)[heading] if f.label.startswith(label))


def test_a_size_is_right_within_ten_per_cent_or_two_deviations():
    """The larger of both decides; a cause of another name has no size."""
    key = key_of(cause("internal_leakage"))
    key["effects"][0]["parameters"] = {"K_L": 4e-12}

    def sizes(value, sd, id="internal_leakage"):
        answer = answer_of("effect", (id, 1.0, []))
        answer["effects"][0]["parameters"] = {"K_L": {"value": value, "sd": sd}}
        return score_answer("", key, answer).sizes

    assert sizes(4.39e-12, 1e-14) == (True,) and sizes(4.41e-12, 1e-14) == (False,)
    assert sizes(4.9e-12, 5e-13) == (True,)
    assert sizes(4e-12, 1e-14, "orifice_leakage") == ()


def test_perfect_answers_score_perfectly():
    """Truth with certainty: all right, nothing wrong, no loss but the floor's, the gap closed as by the truth."""
    rows = [
        score_answer(
            str(i), key, answer_of(key["verdict"], *[(e["id"], 1.0, []) for e in key["effects"] if e["id"] in IDS])
        )
        for i, key in enumerate(KEYS)
    ]

    for heading, label, value in [
        ("No gap", "false alarms", 0.0),
        ("One cause", "top-1", 1.0),
        ("One cause", "the cause is in the set", 1.0),
        ("One cause", "named alone and wrong", 0.0),
        ("One cause", "missed", 0.0),
        ("One cause", "probability on the cause", 1.0),
        ("Several causes", "exactly the causes", 1.0),
        ("Outside the catalogue", "answered outside_catalogue", 1.0),
        ("Outside the catalogue", "place right", 1.0),
        ("Probabilities", "Brier score of a case", 0.0),
        ("Probabilities", "skill in Brier", 1.0),
        ("Gap closed on held-out data", "answer over true", 1.0),
    ]:
        assert figure(rows, heading, label).value == pytest.approx(value), label
    assert figure(rows, "Probabilities", "log-loss of a case").value == pytest.approx(-len(IDS) * np.log(1 - 0.005))


def test_uniform_guessing_has_no_skill():
    """An answer that holds every id for equally likely, at the rate of causes, loses exactly what guessing loses."""
    perfect = [score_answer(str(i), key, None) for i, key in enumerate(KEYS)]
    guess = calibration.uniform_guess([r for r in perfect if r.verdict != OUTSIDE])
    everything = [(id, guess, []) for id in IDS]
    rows = [score_answer(str(i), key, answer_of("underdetermined", *everything)) for i, key in enumerate(KEYS)]

    for name in ("log-loss", "Brier"):
        assert figure(rows, "Probabilities", f"skill in {name}").value == pytest.approx(0.0, abs=1e-12)
    assert figure(rows, "One cause", "abstained").value == 1.0
    assert figure(rows, "No gap", "false alarms").value == 1.0
    assert figure(rows, "No gap", "false alarms that name").value == 0.0


def test_one_wrong_name_for_all_is_wrong_everywhere():
    """A tool that always names the same effect is right where that is the truth and has negative skill."""
    rows = [
        score_answer(str(i), key, answer_of("effect", ("backlash", 1.0, []), closed=0.1)) for i, key in enumerate(KEYS)
    ]

    assert figure(rows, "One cause", "top-1").value == pytest.approx(1.0 / len(IDS))
    assert figure(rows, "One cause", "named alone and wrong").value == pytest.approx(1.0 - 1.0 / len(IDS))
    assert figure(rows, "No gap", "false alarms that name").value == 1.0
    assert figure(rows, "Outside the catalogue", "a wrong name").value == 1.0
    assert figure(rows, "Probabilities", "skill in Brier").value < 0.0
    assert figure(rows, "Gap closed on held-out data", "answer over true").value == 0.0


def test_no_answer_counts_as_wrong():
    """A crash is neither a right "no gap" nor an abstention."""
    rows = [score_answer(str(i), key, None) for i, key in enumerate(KEYS)]

    assert figure(rows, "All", "answered").value == 0.0
    assert figure(rows, "No gap", "false alarms").value == 1.0
    assert figure(rows, "One cause", "abstained").value == 0.0
    assert {r.first for r in rows} == {FAILED}


def test_ids_that_are_the_same_in_principle_both_count():
    """The current sensor's scale is the torque constant's; another channel's scale is not."""
    key = key_of(cause("torque_constant", None, ("sensor_scale", "current")))

    right, same, other = (
        score_answer("", key, answer_of("effect", (id, 0.9, [], channel)))
        for id, channel in (("torque_constant", None), ("sensor_scale", "current"), ("sensor_scale", "p1"))
    )

    assert right.top_1 and same.top_1 and not other.top_1
    assert right.on_truth == same.on_truth == 0.9 and other.on_truth == 0.0
    assert calibration.losses(right) == calibration.losses(same)
    assert other.wrong == ("sensor_scale",) and same.wrong == ()


def test_sets_are_the_first_id_with_those_it_is_ambiguous_with():
    """A set holds the truth wherever it stands in it; only the first id makes top-1."""
    key = key_of(cause("rod_friction"))

    row = score_answer(
        "", key, answer_of("ambiguous", ("presliding", 0.6, ["rod_friction"]), ("rod_friction", 0.4, []))
    )
    without = score_answer("", key, answer_of("ambiguous", ("presliding", 0.6, ["backlash"])))

    assert row.in_set and not row.top_1 and row.set_size == 2 and row.wrong == ()
    assert not without.in_set and without.wrong == ("presliding",)


def test_real_errors_below_the_threshold_are_no_wrong_names():
    """Naming a parameter that is really off, too little to matter, is counted apart."""
    key = key_of(cause("rod_friction"), parameter_errors={"M": 0.1})

    row = score_answer(
        "", key, answer_of("effect", ("rod_friction", 0.9, []), ("payload_mass", 0.8, []), ("backlash", 0.7, []))
    )

    assert (row.minor, row.wrong, row.found) == (1, ("backlash",), 1)


def test_intervals_are_wilsons():
    """0 of 50 may be up to 7.1 %; 9 of 10 may be 59.6 to 98.2 %."""
    none, most = figures.share("", [False] * 50), figures.share("", [True] * 9 + [False])

    assert (none.low, none.high) == (0.0, pytest.approx(0.0713, abs=2e-4))
    assert (most.low, most.high) == (pytest.approx(0.596, abs=1e-3), pytest.approx(0.982, abs=1e-3))


def test_the_confusion_matrix_counts_every_cause_once():
    """Rows add up to the causes in the keys, and to the cases without."""
    rows = [score_answer(str(i), key, answer_of("effect", ("backlash", 1.0, []))) for i, key in enumerate(KEYS)]

    down, across, counts = score_statistics.confusion(rows)

    assert across == ["backlash"]
    assert counts.sum() == sum(max(len(key["effects"]), 1) for key in KEYS)
    assert counts[down.index("no_gap")].sum() == 20 and counts[down.index(OUTSIDE)].sum() == 5


# Running a tool.

FAKE_TOOL = """
import json, os, sys
argv = sys.argv[1:]
seen = sorted(os.listdir("."))
if "K_T=1.3" in argv:
    sys.exit("K_T is wrong")
out = argv[argv.index("--out") + 1]
os.makedirs(out)
answer = {"verdict": "no_gap", "where": [], "effects": [], "gap": {}, "seconds": 0.1, "argv": argv, "seen": seen}
json.dump(answer, open(os.path.join(out, "diagnosis.json"), "w"))
"""


@pytest.fixture
def two_cases(tmp_path):
    folder = tmp_path / "cases"
    folder.mkdir()
    for name, settings in (("a", {"beta": 1.2e9}), ("b", {"K_T": 1.3})):
        (folder / f"{name}.csv").write_text("t,current\n0.000,0\n")
        model_settings = {
            "log": f"{name}.csv",
            "plant": "ehsa",
            "model": "nonlinear",
            "spring_stiffness": 5e4,
            "set": settings,
        }
        (folder / f"{name}.json").write_text(json.dumps(model_settings))
    (folder / "key.json").write_text(json.dumps({"a": key_of(family="none"), "b": key_of(family="none")}))
    tool = tmp_path / "tool.py"
    tool.write_text(FAKE_TOOL)
    return folder, f"{sys.executable} {tool}"


def test_the_tool_gets_log_and_nominal_model_only(two_cases, capsys):
    """It sees a log by a neutral name and the nominal model, and does not run again once it has answered."""
    folder, tool = two_cases

    score.main([str(folder), "--tool", tool])
    answer = json.loads((folder / "answers" / "a" / "diagnosis.json").read_text())
    failure = (folder / "answers" / "b" / "failed.txt").read_text()
    score.main([str(folder), "--tool", "no-such-tool"])

    assert answer["seen"] == ["log.csv"]
    assert answer["argv"][:6] == ["diagnose", "log.csv", "--plant", "ehsa", "--model", "nonlinear"]
    assert {"beta=1200000000.0", "load.stiffness=50000.0"} <= set(answer["argv"])
    assert "K_T is wrong" in failure
    assert "0 of 2 cases to run" in capsys.readouterr().out
    with (folder / "answers" / "cases.csv").open() as file:
        assert {row["name"]: row["answer"] for row in csv.DictReader(file)} == {"a": "no_gap", "b": FAILED}
    assert "| false alarms | 50.0 % | 9.5 % to 90.5 % | 2 |" in (folder / "answers" / "score.md").read_text()


def test_a_tool_that_hangs_is_stopped(two_cases):
    """After the timeout the case is a failure with the reason in a file."""
    folder, _ = two_cases

    score.main([str(folder), "--tool", f"{sys.executable} -c 'import time; time.sleep(60)'", "--timeout", "0.5"])

    assert "no answer within 0.5 s" in (folder / "answers" / "a" / "failed.txt").read_text()
