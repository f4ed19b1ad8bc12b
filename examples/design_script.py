"""All steps in one script: paper, model, log, plant, controllers, gap, cause, better controller.

python examples/design_script.py [FOLDER]

Run it as a whole, or cell by cell in an editor that supports cells (`# %%`). Figures and files go to FOLDER,
results/design by default. The four notebooks in this folder explain the same steps.
"""

# %% Set-up
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small here: threads would only wait for each other

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import ehsa_ctrl as e

given = [word for word in sys.argv[1:] if not word.startswith("-")]  # a notebook kernel adds options of its own
FOLDER = Path(given[0] if given and sys.argv[1] == given[0] else "results/design")
FOLDER.mkdir(parents=True, exist_ok=True)

# %% 1. The paper's model: (7) plus position for design, (12) with dry friction to check on
linear, nonlinear = e.load_plant("ehsa", model="linear"), e.load_plant("ehsa")
model = e.three_state(linear)  # a control.StateSpace
print(e.analyse(model))
e.figures.save(e.figures.bode_figure(e.analyse(model)), FOLDER / "1_bode")

threshold = (nonlinear["A_FM"] + nonlinear["C_FM"]) / nonlinear["K_T"]
not_printed = [p for p in nonlinear.parameters.values() if p.source in ("assumed", "literature") and p.value]
print(f"\nthe shaft breaks away at {threshold:.2f} A")
print("not in the paper: " + ", ".join(f"{p.name} = {p.value:g} {p.unit}" for p in not_printed))

# %% The paper's Fig. 7 with both sets: steps of 1.5 A (paper_figures.py has the others)
time, current = e.excitation("steps", amplitude=1.5, duration=2.25)
runs = {plant.model: e.simulate(plant, current) for plant in (linear, nonlinear)}
shown = {
    "speed (rpm)": ("omega", 2 * np.pi / 60),
    "pressure difference (bar)": ("dP", 1e5),
    "position (mm)": ("x", 1e-3),
}
panels = {label: {name: run[signal] / unit for name, run in runs.items()} for label, (signal, unit) in shown.items()}
e.figures.save(e.figures.overlay_figure(time, panels, title="Steps of 1.5 A by both sets"), FOLDER / "1_steps")
assert runs["linear"]["x"].max() > 2 * runs["nonlinear"]["x"].max()  # no dry friction: far too fast

# %% 2. From a log to a plant. The logs are from the virtual bench; read yours by e.read_plant_log("log.csv", plant)
log, _ = e.record(nonlinear, *e.excitation("noise", amplitude=3.0, duration=20.0), centre=True)
steps, _ = e.record(nonlinear, *e.excitation("steps", amplitude=1.5, duration=4.0), seed=1, centre=True)
coin = np.random.default_rng(0)
nominal = nonlinear.set(**{name: nonlinear[name] * coin.choice([0.7, 1.3]) for name in nonlinear.free})
print(f"\n30 % off: {e.replay(nominal, steps)}")
for finding in e.check_log(log, nominal):
    print(finding)

found = e.identify(nominal, log, validate=[steps])
print(found)
assert found.explained
e.figures.save(found.plot(), FOLDER / "2_identified")
e.write_plant(FOLDER / "identified.toml", found.plant, e.sliding_linear(found.plant), force=True)

# %% 3. Controllers are designed on the identified plant's linear set ...
rig_model = e.three_state(e.load_plant(FOLDER / "identified.toml", model="linear"))
names = ["pid_position", "lqr_position", "pid_friction", "cascade_friction", "lqr_friction", "mpc_friction"]
controllers = {name: e.load_controller(name, rig_model) for name in names}
known = e.known_of(found.plant)
for name, controller in controllers.items():
    loop = e.analyse_loop(rig_model, controller, noise=known.noise)
    print(f"\n{loop}")
    assert loop.stable and loop.Ms < 1.5
    e.figures.save(e.figures.loop_figure(loop), FOLDER / f"3_loop_{name}")

# %% ... and checked on the nonlinear one, with friction, under a spring, with the noise of the sensors
spring = e.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
hold = np.tile([0.010, 0.0, 0.0], (7500, 1))
rows = {}
for name in names:
    result = e.run("steps_spring", controller=name, plant=FOLDER / "identified.toml")
    e.figures.save(result.plot(), FOLDER / f"3_steps_spring_{name}")
    quiet = e.run_closed_loop(spring, controllers[name], hold, sensors=e.Sensors.of(spring, seed=0)).trajectory
    late = quiet.time > 3.0
    rows[name] = {
        "passed": result.passed,
        "settling (ms)": round(1e3 * result.metrics["SettlingTime"][1]),
        "times the shortest": round(result.metrics["SettlingRatio"][1], 1),
        "steady-state error (um)": round(1e6 * result.metrics["SteadyStateError"][1]),
        "slips in 30 s at rest": int(e.hunting(quiet.time[late], quiet["x"][late])["Slips"]),
    }
table = pd.DataFrame(rows).T
print(f"\nsteps_spring, and a hold of half a minute\n{table.to_string()}")
slips = table["slips in 30 s at rest"]
assert table["passed"].all() and slips["lqr_position"] > 5 and not slips.filter(like="_friction").any()
assert table.loc["lqr_friction", "settling (ms)"] < 0.5 * table.loc["pid_position", "settling (ms)"]

# %% Robustness: twenty plants with other parameters
models = e.drawn_models(
    linear,
    e.draw(linear, 16, seed=0, unknown=0.1, assumed=True),
    e.conditions(stiffnesses=[0.0, 50e3], masses=[0.0, 100.0]),
)
robust = e.robust_margins(models, controllers["lqr_friction"], points=120)
assert robust.stable
print(f"\n{e.review(rig_model, controllers['lqr_friction'], known=known, robust=robust)}")
e.figures.save(e.figures.robustness_figure(robust), FOLDER / "3_robustness_lqr_friction")
print(e.monte_carlo("spread_steps", runs=40, controller="lqr_friction"))

# %% 4. From a gap to its cause: this rig's pump has friction that the model lacks, and parameters 1 to 2 % off
off = {"K_T": 0.985, "J_M": 1.015, "A_FM": 1.01, "B_FR": 1.02, "K_S": 0.99}
rig = spring.set(**{name: factor * spring[name] for name, factor in off.items()})
rig = rig.with_effects("pump_torque_loss", c_f=0.12)

time, current = e.excitation("noise", amplitude=2.0, duration=24.0, seed=1)
levels = np.random.default_rng(1).uniform(-1.0, 1.0, 25) * (np.arange(25) > 0)
log, _ = e.record(rig, time, current + levels[(time + 1e-9).astype(int)], seed=1)

diagnosis = e.diagnose(spring, log)
print(f"\n{diagnosis}")
assert diagnosis.effects[0].id == "pump_torque_loss"
e.figures.save(diagnosis.plot(), FOLDER / "4_diagnosis")

# Diagnose to name the effect, identify to measure its parameter.
measured = e.identify(
    diagnosis.improved, log.segment(0, 12), validate=[log.segment(12, 24)], free=["c_f", "K_T", "K_S", "beta"], starts=1
)
print(measured)
corrected = measured.plant
assert measured.explained and abs(corrected["c_f"] - 0.12) < 0.01
e.write_plant(FOLDER / "corrected.toml", corrected, force=True)

# %% 5. A better controller: gains for the corrected plant while it slides, feed-forward with the pump loss
slides = e.three_state(e.sliding_linear(corrected.set(K_S=0.0)))
shipped, redesigned = e.load_controller("pid_friction", model), e.load_controller("pid_friction", slides)
needed, lost = e.motion_current(corrected), corrected["c_f"] * corrected["D"] / corrected["A"] / corrected["K_T"]
numbers = {
    "inertia": needed["inertia"],
    "load": needed["load"],
    "viscous": needed["viscous"] + lost * corrected["B_FR"],
    "coulomb": needed["coulomb"] + lost * corrected["A_FR"],
    "static": needed["static"] + lost * (corrected["A_FR"] + corrected["C_FR"]),
}
redesigned = replace(redesigned, feedforward=redesigned.feedforward.model_copy(update=numbers))

# Sixteen moves of 2 s to random places within 20 mm: predicted, and on the rig.
targets = np.round(np.random.default_rng(0).uniform(-0.020, 0.020, 16), 4)
positions = np.concatenate([np.zeros(50), np.repeat(targets, 500)])
moves = np.column_stack([positions, np.zeros((positions.size, 2))])
rows = {}
for name, controller, plant in (
    ("shipped, nominal", shipped, spring),
    ("shipped, corrected", shipped, corrected),
    ("shipped, the rig", shipped, rig),
    ("redesigned, corrected", redesigned, corrected),
    ("redesigned, the rig", redesigned, rig),
):
    run = e.run_closed_loop(plant, controller, moves, sensors=e.Sensors.of(plant, seed=0))
    ends = np.abs(run.error[50:].reshape(16, 500)[:, -1])
    rows[name] = {
        "within 0.1 mm": f"{np.count_nonzero(ends < 1e-4)} of 16",
        "worst (um)": round(1e6 * ends.max()),
        "current travel (A)": round(np.abs(np.diff(run.asked)).sum()),
    }
    if name.endswith("the rig"):
        e.figures.save(run.plot(), FOLDER / f"5_moves_{controller.name}_{name.split(',')[0]}")
table = pd.DataFrame(rows).T
print(f"\n{table.to_string()}\n\nfigures and plants are in {FOLDER}")
assert table.loc["shipped, nominal", "within 0.1 mm"] == table.loc["redesigned, the rig", "within 0.1 mm"] == "16 of 16"
assert table.loc["shipped, the rig", "within 0.1 mm"] == table.loc["shipped, corrected", "within 0.1 mm"]
