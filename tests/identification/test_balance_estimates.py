"""Parameters from balances: recovered where the truth is known, and undetermined where a record does not show them."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.errors import InputError
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.identification.balances import estimate_by_balances, first_estimate
from ehsa_ctrl.physics.residuals import P_ATM
from ehsa_ctrl.simulation.engine import simulate


def bench_log(plant, excitation="multisine", seed=0):
    time, current = ehsa_ctrl.excitation(excitation, amplitude=3, duration=20, sample_time=0.004)
    return ehsa_ctrl.record(plant, time, current, centre=True, seed=seed)[0]


@pytest.fixture(scope="module")
def log():
    return bench_log(ehsa_ctrl.load_plant("ehsa"))


def mistaken(plant, factor=1.4):
    """The plant as somebody believes who is wrong about everything that can be identified."""
    return plant.set(**{name: factor * plant[name] for name in plant.free})


@pytest.fixture
def carriage():
    """A carriage and the exact record of a motion x = X sin(wt) + X/3 sin(3wt): no simulation is needed for it."""
    plant = ehsa_ctrl.load_plant("emps")
    t = 0.001 * np.arange(8000)
    x, v, a = np.zeros(t.size), np.zeros(t.size), np.zeros(t.size)
    for size, w in ((0.05, 2 * np.pi * 0.7), (0.02, 2 * np.pi * 2.1)):
        x += size * np.sin(w * t)
        v += size * w * np.cos(w * t)
        a -= size * w**2 * np.sin(w * t)
    force = plant["M"] * a + plant["Fv"] * v + plant["Fc"] * np.sign(v) + plant["offset"]
    return plant, Log(t, {"position": x, "drive_force": force})


@pytest.mark.parametrize(
    ("how", "within"),
    [
        ({"method": "weak"}, 1e-3),
        ({"method": "weak", "width": 0.05}, 1e-3),
        ({"method": "filtered", "cutoff": 100.0}, 5e-3),
        ({"method": "filtered", "cutoff": 100.0, "parallel": 40.0}, 2e-2),
    ],
)
def test_a_known_motion_gives_back_its_parameters(carriage, how, within):
    """M, Fv, Fc and offset of a record in closed form, to what filters and reversals cost."""
    plant, log = carriage

    found = estimate_by_balances(mistaken(plant), log, **how)

    assert not found.undetermined
    for name in ("M", "Fv", "Fc", "offset"):
        assert found[name] == pytest.approx(plant[name], rel=within), name


def test_products_of_parameters(carriage):
    """Friction that differs by direction adds Fc a and Fv b |v|: products of unknown parameters. While the carriage
    slides, Fc a is a constant as the offset is: of these two the last named keeps its nominal value."""
    plain, log = carriage
    plant = plain.with_effects("asymmetric_friction", a_FR=0.0, b_FR=0.0)
    v = np.gradient(log["position"], log.time)
    extra = -0.15 * plant["Fv"] * np.abs(v)
    log = replace(log, channels={**log.channels, "drive_force": log["drive_force"] + extra})
    start = plant.set(M=120.0, Fv=300.0, Fc=10.0, a_FR=0.3)

    known = estimate_by_balances(start.set(offset=plain["offset"]), log, ["M", "Fv", "Fc", "a_FR", "b_FR"])
    both = estimate_by_balances(start, log, ["M", "Fv", "Fc", "offset", "a_FR", "b_FR"])

    for name, truth in {"M": plain["M"], "Fv": plain["Fv"], "Fc": plain["Fc"], "b_FR": -0.15}.items():
        assert known[name] == pytest.approx(truth, rel=5e-3), name
        assert both[name] == pytest.approx(truth, rel=5e-3), name
    assert known["a_FR"] == pytest.approx(0.0, abs=2e-3)
    assert both.undetermined == {"a_FR": "these records can't tell it from offset (force)"}
    assert both["offset"] + 0.3 * both["Fc"] == pytest.approx(plain["offset"], abs=0.05)


def test_a_simulated_carriage_with_a_noisy_encoder(carriage):
    """The engine's own run, sticking included, through sensor noise: within 2 %, offset within 0.2 N."""
    plant, _ = carriage
    t = plant.sample_time * np.arange(15000)
    force = 60 * np.sin(2 * np.pi * 0.8 * t) + 50 * np.sin(2 * np.pi * 2.5 * t + 1) + plant["offset"]
    run = simulate(plant, force, hold="first_order")
    noise = 1e-6 * np.random.default_rng(3).normal(size=t.size)
    log = Log(t, {"position": run["x"] + noise, "drive_force": run["F_M"]})

    found = estimate_by_balances(mistaken(plant), log, method="filtered", cutoff=50.0)

    for name in ("M", "Fv", "Fc"):
        assert found[name] == pytest.approx(plant[name], rel=0.02), name
    assert found["offset"] == pytest.approx(plant["offset"], abs=0.2)


@pytest.mark.parametrize("excitation", ["noise", "multisine"])
@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_bench_logs_of_the_actuator(model, excitation):
    """Starting 40 % off, 20 s of a noisy bench log give the large parameters within 15 %; nothing is impossible."""
    plant = ehsa_ctrl.load_plant("ehsa", model=model)
    nominal = mistaken(plant)

    found = first_estimate(nominal, bench_log(plant, excitation), [*plant.free, "bias.p1"])

    wanted = {"linear": ("J_M", "B_FM", "V", "B_FR")}.get(
        model, ("J_M", "A_FM", "B_FM", "V_10", "V_20", "A_FR", "B_FR")
    )
    for name in wanted:
        assert found[name] == pytest.approx(plant[name], rel=0.15), name
    nominal.set(**found)


def test_standard_deviations_are_those_of_repeated_experiments(plant):
    """Ten benches that differ by their noise scatter as the stated deviations say, within a factor of 2.5."""
    names = ("B_FM", "B_FR", "A_FR", "V_10")
    runs = [estimate_by_balances(plant, bench_log(plant, seed=seed), names) for seed in range(10)]

    for name in names:
        scatter = np.std([run[name] for run in runs], ddof=1)
        stated = np.mean([run.parameters[name].sd for run in runs])
        assert 0.4 < scatter / stated < 2.5, name


def test_several_logs_are_one_experiment(plant, log):
    """Two records together know more than one."""
    alone = estimate_by_balances(plant, log)
    both = estimate_by_balances(plant, [log, bench_log(plant, seed=1)])

    assert both.balances[0].rows == 2 * alone.balances[0].rows
    assert both.parameters["V_10"].sd < alone.parameters["V_10"].sd


def test_a_rod_that_never_moves_tells_nothing_of_its_friction(plant):
    """What a record does not show keeps its nominal value and is named with the reason."""
    time, current = ehsa_ctrl.excitation("sine", amplitude=0.5, duration=4, sample_time=0.004)
    log = ehsa_ctrl.record(plant, time, current)[0]

    found = estimate_by_balances(plant, log, ["A_FR", "B_FR", "A_FM"])

    assert set(found.undetermined) == {"A_FR", "B_FR", "A_FM"} and not found.parameters
    assert found.plant["A_FR"] == plant["A_FR"]
    with pytest.raises(InputError, match="A_FR: is in no balance"):
        found["A_FR"]
    assert first_estimate(plant, log, ["A_FR"]) == {}


def test_without_pressures_only_what_the_rest_tells(plant, log):
    """No pressures, no balance of the actuator: everything keeps its nominal value."""
    blind = replace(log, channels={k: v for k, v in log.channels.items() if k not in ("p1", "p2")})

    found = estimate_by_balances(plant, blind)

    assert set(found.undetermined) == set(plant.free)


def test_the_load_comes_from_the_load_cell(plant):
    """A spring behind a load cell is found by the cell, and without the cell by the rod's balance."""
    loaded = plant.set(K_S=60e3)
    log = bench_log(loaded)
    blind = replace(log, channels={k: v for k, v in log.channels.items() if k != "force"})

    by_cell = estimate_by_balances(plant.set(K_S=10e3), log, ["K_S"])
    by_rod = estimate_by_balances(plant.set(K_S=10e3), blind, ["K_S"])

    assert by_cell["K_S"] == pytest.approx(60e3, rel=0.01) and by_cell.parameters["K_S"].balance == "load"
    assert by_rod["K_S"] == pytest.approx(60e3, rel=0.05)


def test_where_only_a_ratio_shows_one_is_taken_as_known(plant, log):
    """Flow alone can't tell displacement and volumes and leakage apart from a common factor."""
    found = estimate_by_balances(plant, log, ["D", "A", "K_L", "V_10", "V_20"])

    held = [name for name, why in found.undetermined.items() if "ratio" in why]
    assert len(held) == 1 and held[0] in ("D", "A")
    other = {"D": "A", "A": "D"}[held[0]]
    assert found[other] == pytest.approx(plant[other], rel=0.02)


def test_areas_of_a_take_off_by_the_makers_formula():
    """Force, flow and torque as the makers of the take-off write them, with their signs, give back all its numbers."""
    plant = ehsa_ctrl.load_plant("mbari_pto")
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(10000)
    v = 0.3 * np.sin(2 * np.pi * 0.05 * t) + 0.1 * np.sin(2 * np.pi * 0.13 * t)
    a = 0.3 * 2 * np.pi * 0.05 * np.cos(2 * np.pi * 0.05 * t) + 0.1 * 2 * np.pi * 0.13 * np.cos(2 * np.pi * 0.13 * t)
    truth = {"A": 9e-4, "A_S1": 0.013, "A_S2": 0.011, "A_FR": 350.0, "D": 8e-7, "K_T": 0.5, "A_FM": 0.4}
    upper, lower = 30e5 + 20e5 * np.sin(2 * np.pi * 0.03 * t), 40e5 + 15e5 * np.cos(2 * np.pi * 0.02 * t)
    spring_up, spring_low = 5e5 + 2e5 * np.sin(2 * np.pi * 0.011 * t), 9e5 + 3e5 * np.cos(2 * np.pi * 0.017 * t)
    pulled = (lower - upper) * truth["A"] + (spring_low - P_ATM) * truth["A_S2"] - (spring_up - P_ATM) * truth["A_S1"]
    pulled += truth["A_FR"] * np.sign(v) + plant["B_FR"] * v + plant["M"] * a
    motor = -truth["A"] * v / truth["D"]
    friction = truth["A_FM"] * np.sign(-motor) + plant["B_FM"] * -motor
    winding = ((lower - upper) * truth["D"] - friction) / truth["K_T"]
    winding += (plant["J_M"] * np.gradient(motor, 0.02)) / truth["K_T"]
    channels = {
        "velocity": v, "speed": -motor, "current": -winding, "p1": upper, "p2": lower, "force": -pulled,
        "spring_p1": spring_up, "spring_p2": spring_low,
    }  # fmt: skip
    log = Log(t, {name: value + 1e-6 * np.std(value) * rng.normal(size=t.size) for name, value in channels.items()})
    stiff = plant.set(V=1e-9, K_L=0.0)

    found = estimate_by_balances(stiff, log, list(truth), width=0.5)

    assert not found.undetermined
    for name, value in truth.items():
        assert found[name] == pytest.approx(value, rel=0.01), name


def test_sensor_errors_that_the_plant_knows_are_undone(plant, log):
    """Bias, scale and delay of a sensor are taken out before the balance is formed."""
    sensors = dict(plant.sensors)
    sensors["p1"] = replace(sensors["p1"], bias=3e5, scale=1.1)
    sensors["speed"] = replace(sensors["speed"], delay=0.008)
    channels = dict(log.channels)
    channels["p1"] = 1.1 * channels["p1"] + 3e5
    channels["speed"] = np.concatenate([np.zeros(2), channels["speed"][:-2]])

    plain = estimate_by_balances(plant, log)
    known = estimate_by_balances(replace(plant, sensors=sensors), replace(log, channels=channels))
    ignored = estimate_by_balances(plant, replace(log, channels=channels))

    for name in plain.parameters:
        assert known[name] == pytest.approx(plain[name], rel=0.02), name
    assert ignored["A_FR"] != pytest.approx(plain["A_FR"], rel=0.05)


def test_it_prints_and_tabulates(plant, log):
    """Values with deviations, what was not determined and why, how well each balance closes."""
    found = estimate_by_balances(plant, log)
    table = found.to_pandas()

    assert list(table.index) == list(found.parameters) and table.loc["J_M", "unit"] == "kg m2"
    text = str(found)
    assert "weak form" in text and "not determined" in text and "% of its leading term" in text
    assert text.splitlines()[1].strip() in found._repr_html_()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"wanted": ["J_N"]}, "no parameter 'J_N'; did you mean 'J_M'"),
        ({"method": "strong"}, "method = 'strong'.*known: filtered, weak"),
        ({"width": 30.0}, "test functions of 7500 samples do not fit a log of 5001"),
        ({"method": "filtered", "cutoff": 400.0}, "cutoff = 400 Hz; expected more than 0 and less than 125 Hz"),
        ({"method": "filtered", "parallel": 400.0}, "parallel = 400 Hz; expected"),
    ],
)
def test_a_mistake_is_one_sentence(plant, log, arguments, says):
    """What was got, what was expected."""
    with pytest.raises(InputError, match=says):
        estimate_by_balances(plant, log, **arguments)


@pytest.mark.parametrize(
    ("effect", "numbers"),
    [
        ("entrained_air", {"air_fraction": 0.02}),
        ("entrained_air", {"air_fraction": 0.02, "P_diss": 10e5, "tau_diss": 0.5}),
        ("hose_wall", {"C_h": 1e-12, "tau_h": 0.1}),
    ],
    ids=["air", "air that dissolves", "wall"],
)
def test_soft_oil_and_walls_count_in_the_flow_balance(plant, effect, numbers):
    """Volumes to 5 %; of pure oil in stiff pipes they would be 40 to 260 % too large. The states of air and wall have
    no sensor and follow from the pressures."""
    rig = plant.set(K_S=5e4).with_effects(effect, **numbers)

    found = estimate_by_balances(mistaken(rig), bench_log(rig), ["K_L", "V_10", "V_20"])

    for name in ("V_10", "V_20"):
        assert found[name] == pytest.approx(rig[name], rel=0.05), name
    assert found["K_L"] == pytest.approx(rig["K_L"], rel=0.25)
