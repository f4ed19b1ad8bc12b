# ruff: noqa: B018, E501

# %% [markdown]
# # From a model to a controller
#
# This notebook starts with a linear model, a Bode diagram, a PID and its margins, and then runs the same PID on a plant
# with stick-slip friction. It shows the effect of friction on each classic design, the remedies, and how to check
# robustness against parameter errors.
#
# The plant is the paper's actuator in `plants/ehsa.toml`. Controllers are designed on its *linear* set and evaluated on
# its *nonlinear* set with stick-slip friction at shaft and rod, which no controller sees. Everything here is also a
# command: `ehsa-ctrl analyse`, `ehsa-ctrl design`, `ehsa-ctrl run`.
#
# This is the third of five notebooks, after `from_paper_to_model` and `from_log_to_plant`. `design_script.py` in the
# same folder has the same steps as a script.

# %%
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small here: threads would only wait for each other

import subprocess
import sys
import tempfile
import warnings
from dataclasses import replace
from pathlib import Path

import control
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import ehsa_ctrl as e

os.chdir(tempfile.mkdtemp())  # a folder of its own, as a project would have
plt.rcParams.update(e.style.RC)

# %% [markdown]
# ## 1. The linear model
#
# Equation (7) of the paper with the position added: states are the shaft's speed $\omega$, the pressure difference
# $\Delta P$, the rod's speed $v$ and its position $x$. It is a `control.StateSpace`, so all of python-control works on
# it.

# %%
linear = e.load_plant("ehsa", model="linear")
model = e.three_state(linear)
analysis = e.analyse(model)
print(analysis)

# %% [markdown]
# The model has a slow pole at 1.4 Hz (shaft and rod as one mass with viscous friction), a well damped pair at 70 Hz
# (the rod on the oil's stiffness), and the integrator from speed to position. From the current to the position there is
# no zero, so the phase falls to -360 degrees; the pair at 70 Hz limits the gain.

# %%
poles = np.sort(np.abs(analysis.poles))
assert poles[0] < 1e-6 and 8.5 < poles[1] < 9.5 and np.allclose(poles[2:] / (2 * np.pi), 70.0, atol=0.5)
e.figures.bode_figure(analysis)

# %% [markdown]
# ## 2. A PID by phase margin
#
# `controllers/pid_position.toml` specifies a crossover and a phase margin. The whole file:

# %%
print(e.controllers["pid_position"].read_text())
pid = e.load_controller("pid_position", model)
print(pid)

# %%
loop = e.analyse_loop(model, pid)
assert abs(loop.crossover - 35.0) < 0.1 and abs(loop.phase_margin - 60.0) < 0.1 and loop.Ms < 1.4
print(loop)
e.figures.loop_figure(loop)

# %% [markdown]
# The loop is not a continuous approximation: the plant is sampled exactly with a zero-order hold, the control law is
# the difference equation that runs every 4 ms, and the delay margin is that of the sampled loop. The margins are
# therefore exact.
#
# Gain margin and phase margin vary one quantity at a time. The **disk margin** varies gain and phase simultaneously:
# the loop avoids the disk below, so it stays stable for any gain factor in the range printed above *together with* any
# phase change up to the printed angle.

# %%
e.figures.nyquist_figure(loop)

# %% [markdown]
# ## 3. The same PID on the plant
#
# `e.run` takes a scenario: 10 mm against a spring of 50 kN/m, with the noise of the sensors. It designs and predicts on
# the linear model and checks on the nonlinear plant.

# %%
first = e.run("steps_spring", controller="pid_position")
assert first.passed
first.plot()

# %% [markdown]
# The prediction overshoots and returns. The rod stops where friction first holds it, 0.1 mm off. The scenario passes,
# but the loop is not at equilibrium: the integral keeps winding up. The next cell holds the target for a minute.


# %%
rig = e.load_plant("ehsa", settings={"load.stiffness": "50 kN/m"})
DT = pid.sample_time


def jumps(targets, every, wait=0.2):
    """A reference (N, 3) that jumps to each target [m] in turn, every so many seconds."""
    each, before = round(every / DT), round(wait / DT)
    positions = np.concatenate([np.zeros(before), np.repeat(targets, each)])
    return np.column_stack([positions, np.zeros((positions.size, 2))])


def follow(controller, reference, plant=rig):
    """A run with the noise of the plant's sensors."""
    return e.run_closed_loop(plant, controller, reference, sensors=e.Sensors.of(plant, seed=0))


minute = jumps([0.010], 60.0)
quantum = e.slip_quantum(rig)
chosen = {
    name: e.load_controller(name, model) for name in ("pid_position", "pid_tuned", "cascade_position", "lqr_position")
}
holds = {name: follow(chosen[name], minute) for name in ("pid_position", "pid_tuned", "lqr_position")}

figure, axes = plt.subplots(len(holds), 1, figsize=(8, 5.0), sharex=True, sharey=True, layout="constrained")
for ax, (name, run) in zip(axes, holds.items(), strict=True):
    ax.axhspan(-0.5e6 * quantum, 0.5e6 * quantum, color=e.style.GREEN, alpha=0.2, linewidth=0)
    ax.plot(run.trajectory.time, 1e6 * run.error, color=e.style.BLUE, linewidth=0.9)
    ax.set(ylim=(-150, 150), xlim=(0, 60), ylabel="error (µm)")
    ax.set_title(name, loc="left")
axes[-1].set_xlabel("time (s); the green band is as wide as the smallest slip")
plt.show()


# %%
def hold_table(runs, since=20.0):
    rows = {}
    for name, run in runs.items():
        late = run.trajectory.time > since
        found = e.hunting(run.trajectory.time[late], run.trajectory["x"][late])
        rows[name] = {
            "slips": found["Slips"],
            "peak to peak (um)": 1e6 * found["HuntingAmplitude"],
            "period (s)": found["HuntingPeriod"],
            "error at the end (um)": 1e6 * abs(run.error[-1]),
        }
    return pd.DataFrame(rows).T.round(1)


table = hold_table(holds)
assert (table["slips"] > 0).all() and table.loc["lqr_position", "slips"] > 20
print(f"from 20 s to 60 s; the smallest slip is {1e6 * quantum:.0f} um")
table

# %% [markdown]
# All three break away repeatedly: the classic PID after a quarter of a minute and again half a minute later, the LQR
# about every second. This is not bad tuning. Static friction exceeds Coulomb friction, so the integral winds up to the
# former and is then too large for the latter; every integral action does this (B. Armstrong, B. Amin, Automatica 32(5),
# 1996). The gains only determine the period.
#
# Two numbers bound the attainable performance.
#
# - `slip_quantum`: the smallest motion that a current pulse can cause from rest, since the energy released at breakaway
#   moves the rod on. A steady-state error below about half of it can't be corrected, only avoided.
# - `shortest_time`: full current, then full braking, friction included, up to the pump's speed limit. No controller
#   with this drive settles faster.

# %%
bound = e.shortest_time(rig, 0.010, pid.current_limit, band=0.2e-3)
took = first.metrics["SettlingTime"][1]
assert 30e-6 < quantum < 60e-6 and bound < 0.08 and took > 5 * bound
print(f"smallest slip {1e6 * quantum:.0f} um")
print(
    f"10 mm to within 0.2 mm: at least {1e3 * bound:.0f} ms; pid_position took {1e3 * took:.0f} ms, {took / bound:.1f} times that"
)

# %% [markdown]
# ## 4. More from a PID: tuned under bounds, and a cascade
#
# A specified crossover does not optimise performance. `[tuning]` does: it minimises the error after a load step under
# bounds on Ms, Mt, the disk margin and the noise gain to the current. The **cascade** has a fast inner loop on the
# shaft's speed, where much of the friction acts, and an outer position loop.

# %%
known = e.known_of(rig)  # the sensors' noise; and of friction, for section 8


def designs(names):
    """Linear figures of controllers, and what steps_spring says of them."""
    rows, runs = {}, {}
    for name in names:
        loop = e.analyse_loop(model, chosen[name], noise=known.noise)
        runs[name] = e.run("steps_spring", controller=name)
        value = {metric: checked for metric, (_, checked) in runs[name].metrics.items()}
        rows[name] = {
            "Ms": loop.Ms,
            "disk margin": loop.disk_margin,
            "delay margin (ms)": 1e3 * loop.delay_margin,
            "compliance (um/kN)": 1e9 * loop.compliance,
            "noise (mA)": 1e3 * loop.current_noise,
            "settling (ms)": 1e3 * value["SettlingTime"],
            "times the bound": value["SettlingRatio"],
            "overshoot (%)": 100 * value["Overshoot"],
            "standing error (um)": 1e6 * value["SteadyStateError"],
            "passed": runs[name].passed,
        }
    return pd.DataFrame(rows).T, runs


SHOWN = {
    "Ms": 2,
    "disk margin": 2,
    "delay margin (ms)": 1,
    "compliance (um/kN)": 0,
    "noise (mA)": 0,
    "settling (ms)": 0,
    "times the bound": 1,
    "overshoot (%)": 1,
    "standing error (um)": 0,
}


def rounded(table):
    return table.astype(dict.fromkeys(SHOWN, float)).style.format(
        {column: f"{{:.{digits}f}}" for column, digits in SHOWN.items()}
    )


table, runs = designs(["pid_position", "pid_tuned", "cascade_position"])
for name, run in runs.items():
    for failure in run.failures:
        print(f"{name} fails: {failure}")
tuned, classic, cascade = (table.loc[name] for name in ("pid_tuned", "pid_position", "cascade_position"))
assert tuned["Ms"] < 1.451 and tuned["compliance (um/kN)"] < 0.6 * classic["compliance (um/kN)"]
assert tuned["settling (ms)"] > 2 * classic["settling (ms)"] > 4 * cascade["settling (ms)"]
assert not cascade["passed"]
rounded(table)

# %% [markdown]
# The tuned PID reduces the deviation under a force to little more than half, and its Ms is at its bound, as expected.
# On the plant it settles *later* than the classic one, because its stronger integral overshoots more at breakaway. A
# better linear design is not a better design here.
#
# The cascade settles several times faster, with an error close to the smallest slip. But it fails: a step of 10 mm
# briefly exceeds the pump's speed limit, because the speed reference of the outer loop is limited but the overshoot of
# the inner loop is not. A planned motion solves this in section 6.
#
# ## 5. LQR with a Kalman filter
#
# State feedback needs all states; a Kalman filter estimates them and three disturbances: a friction current, a load
# force and a leakage. They absorb the model errors, and the controller compensates them (no integral is needed).
# Regulator and filter are designed separately, and the closed loop has the poles of both (separation principle), which
# checks the whole design:

# %%
lqr = chosen["lqr_position"]
loop = e.analyse_loop(model, lqr, noise=known.noise)
regulator = [pole for pole in lqr.law.regulator.poles if abs(pole) > 1e-9]  # at 0: the memory of the current before
apart = np.sort_complex(np.concatenate([regulator, lqr.law.kalman.poles]))
assert np.allclose(np.sort_complex(loop.poles), apart, atol=1e-6)
print(lqr)
print(
    f"{len(regulator)} poles of the regulator and {len(lqr.law.kalman.poles)} of the filter are the {len(apart)} of the loop"
)
print(loop)

# %% [markdown]
# Separation guarantees stability, not robustness. An LQR with measured states has Ms of about 1; a filter loses some of
# that. Assuming more process noise *at the motor* recovers it (Doyle and Stein, 1979): the filter then relies on the
# sensors more than on the model.

# %%
text = e.controllers["lqr_position"].read_text()
assert text.count('current = "0.1 A"') == 1
rows = {}
for trust in ("0.01 A", "0.03 A", "0.1 A", "0.3 A", "1 A"):
    Path("tried.toml").write_text(text.replace('current = "0.1 A"', f'current = "{trust}"'))
    tried = e.analyse_loop(model, e.load_controller("tried.toml", model), noise=known.noise)
    sine = e.run("slow_sine", controller="tried.toml")
    rows[trust] = {
        "Ms": tried.Ms,
        "disk margin": tried.disk_margin,
        "delay margin (ms)": 1e3 * tried.delay_margin,
        "noise (mA)": 1e3 * tried.current_noise,
        "RMS error in slow_sine (um)": 1e6 * sine.metrics["RMSError"][1],
    }
table = pd.DataFrame(rows).T.rename_axis("[observer] current")
assert table["Ms"].is_monotonic_decreasing and table["RMS error in slow_sine (um)"].is_monotonic_increasing
table.round(2)

# %% [markdown]
# The linear figures show no drawback, but the last column does: the error on the nonlinear plant in a slow sine. A
# filter that attributes an innovation to noise at the motor is slow to attribute it to friction, which changes its sign
# at each reversal. The shipped value of 0.1 A is a compromise.
#
# The load estimate on the plant with friction, compared with the spring force:

# %%
run = follow(lqr, jumps([0.020, 0.0], 1.5))
time, x, v = run.trajectory.time, run.trajectory["x"], run.trajectory["v"]
estimated = run.traces["estimate_load"]
opposes = np.where(v == 0.0, np.nan, rig["K_S"] * x + rig["A_FR"] * np.sign(v))
sliding = np.abs(v) > 0.05
assert np.median(np.abs(estimated - opposes)[sliding]) < 200.0
figure, (top, bottom) = plt.subplots(2, 1, figsize=(8, 4.4), sharex=True, layout="constrained")
top.plot(time, 1e3 * run.reference[:, 0], color=e.style.BLACK, linestyle=(0, (6, 3)), label="asked for")
top.plot(time, 1e3 * x, color=e.style.BLUE, label="rod")
top.set(ylabel="position\n(mm)", xlim=(0, time[-1]))
bottom.plot(time, 1e-3 * estimated, color=e.style.VERMILION, linewidth=0.8, label="estimated")
bottom.plot(
    time,
    1e-3 * opposes,
    color=e.style.GREY,
    linewidth=2.5,
    alpha=0.7,
    label="spring and Coulomb friction, while the rod slides",
)
bottom.set(ylabel="load\n(kN)", xlabel="time (s)")
for ax in (top, bottom):
    ax.legend(loc="upper right")
plt.show()

# %% [markdown]
# While the rod slides, the estimate follows closely. Once it sticks, spring and friction balance each other, and the
# load estimate slowly approaches the pressure force. The controller compensates this estimate and breaks the rod away
# again: the disturbance estimate acts as an integral.
#
# ## 6. Remedies against friction
#
# Feedback alone reacts only after friction has caused an error. Four stages around the control law help; each is a
# table in the controller's TOML.
#
# - `[trajectory]`: a step of the target becomes a motion that the actuator can follow.
# - `[feedforward]`: the current for that motion, including friction and load. The numbers come from a plant:

# %%
needed = e.motion_current(e.load_plant("ehsa"))
units = {
    "inertia": "A s2/m",
    "viscous": "A s/m",
    "stiffness": "A/m",
    "preload": "A",
    "coulomb": "A",
    "static": "A",
    "load": "A/N",
    "stribeck": "m/s",
}
pd.DataFrame({"value": needed, "unit": units}).round(5)

# %% [markdown]
# - `[rest]`: when the motion has ended and the rod rests within a band of about the smallest slip, the control law is
#   frozen, so neither the integral nor noise moves the shaft.
# - `forget = true` in `[rest]`: when the next motion begins, the integral is reset to its value at the end of the last
#   motion. Otherwise the windup during the rest would disturb the new motion by millimetres.
#
# `pid_friction` has all four. The table starts with its control law alone and adds one stage after the other, for
# sixteen moves to random positions within 20 mm, 2 s each, under the spring.

# %%
targets = np.round(np.random.default_rng(0).uniform(-0.020, 0.020, 16), 4)
moves = jumps(targets, 2.0)
EACH, BEFORE, BAND = round(2.0 / DT), round(0.2 / DT), 1e-4


def moved(run):
    """Of a run over `moves`: settling to 0.1 mm, error at the end of each move, overshoot, slips in its second half, travel of the current."""
    settled, ends, beyond, slips = [], [], [], 0.0
    for k, target in enumerate(targets):
        part = slice(BEFORE + EACH * k, BEFORE + EACH * (k + 1))
        x, error = run.trajectory["x"][part], run.error[part]
        outside = np.flatnonzero(np.abs(error) > BAND)
        after = outside[-1] + 1 if outside.size else 0
        settled.append(after * DT if after < EACH else np.inf)
        ends.append(abs(error[-1]))
        beyond.append(np.max((x - target) * np.sign(target - (targets[k - 1] if k else 0.0))))
        slips += e.hunting(run.trajectory.time[part][EACH // 2 :], x[EACH // 2 :])["Slips"]
    return {
        "settled": f"{np.isfinite(settled).sum()} of {len(targets)}",
        "slowest (ms)": 1e3 * max(settled),
        "end error, worst (um)": 1e6 * max(ends),
        "overshoot, worst (um)": 1e6 * max(beyond),
        "slips at rest": slips,
        "current travel (A)": np.abs(np.diff(run.asked)).sum(),
    }


full = e.load_controller("pid_friction", model)
kept = full.rest.model_copy(update={"forget": False})
stages = {
    "the law alone": replace(full, trajectory=None, feedforward=None, rest=None),
    "+ trajectory": replace(full, feedforward=None, rest=None),
    "+ feed-forward": replace(full, rest=None),
    "+ rest": replace(full, rest=kept),
    "+ forget": full,
}
cured = {name: follow(controller, moves) for name, controller in stages.items()}
before_after = pd.DataFrame({name: moved(run) for name, run in cured.items()}).T
alone, all_four = before_after.loc["the law alone"], before_after.loc["+ forget"]
assert all_four["settled"] == "16 of 16" and alone["slowest (ms)"] > 4 * all_four["slowest (ms)"]
assert alone["slips at rest"] > 50 and all_four["slips at rest"] == 0
assert alone["current travel (A)"] > 3 * all_four["current travel (A)"]
assert all(moved(cured[name])["settled"] != "16 of 16" for name in ("+ trajectory", "+ feed-forward", "+ rest"))
before_after.style.format({column: "{:.0f}" for column in before_after.columns if column != "settled"})

# %%
figure, (position, error, current) = plt.subplots(3, 1, figsize=(8, 6.0), sharex=True, layout="constrained")
position.plot(
    DT * np.arange(len(moves)),
    1e3 * moves[:, 0],
    color=e.style.BLACK,
    linestyle=(0, (6, 3)),
    linewidth=1.0,
    label="target",
)
for name, label, colour, dashes in (
    ("the law alone", "before", e.style.VERMILION, (0, (4, 1.2))),
    ("+ forget", "with all four", e.style.BLUE, "-"),
):
    run = cured[name]
    position.plot(run.trajectory.time, 1e3 * run.trajectory["x"], color=colour, linestyle=dashes, label=label)
    error.plot(run.trajectory.time, 1e6 * run.error, color=colour, linestyle=dashes)
    current.plot(run.trajectory.time, run.asked, color=colour, linewidth=0.7)
error.axhspan(-100, 100, color=e.style.GREEN, alpha=0.2, linewidth=0, label="0.1 mm")
position.set(ylabel="position\n(mm)", xlim=(4.0, 14.0))
error.set(ylabel="off the target\n(µm)", ylim=(-600, 600))
current.set(ylabel="current\n(A)", xlabel="time (s)", ylim=(-4, 4))
position.legend(ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
plt.show()

# %% [markdown]
# No single stage is enough. The control law alone arrives up to two seconds late and hunts between the moves. Planned
# motion and feed-forward alone make it worse: the wound-up integral disturbs the next motion, which then ends outside
# the band. Freezing alone helps little for the same reason. With the reset of the integral every move ends at its
# target and the rod rests. (The middle panel is scaled to the end of a motion; 0.1 mm is green.)
#
# The other control laws have shipped versions with the same remedies. None needs the reset: the cascade's integral and
# the filter's disturbance estimates have converged when a motion ends.

# %%
pairs = ["cascade_position", "cascade_friction", "lqr_position", "lqr_friction"]
cured |= {name: follow(e.load_controller(name, model), moves) for name in pairs}
others = pd.DataFrame({name: moved(cured[name]) for name in pairs}).T
assert (others["settled"] == "16 of 16").all()
assert all(
    others.loc[f"{law}_friction", "slips at rest"] == 0 < others.loc[f"{law}_position", "slips at rest"]
    for law in ("cascade", "lqr")
)
others.style.format({column: "{:.0f}" for column in others.columns if column != "settled"})

# %% [markdown]
# Here the remedies give a quiet loop: no slip at rest, and much less current travel. They cost a little accuracy, as a
# rod within the band is not corrected.
#
# ## 7. MPC: the limits are part of the problem
#
# The MPC is the same LQR with limits on current, its rate, pump speed, pressure and stroke over a horizon of 80 ms.
# Where no limit is active both give the same current, as for 0.5 mm. For a step of 60 mm without a planned motion they
# differ:

# %%
bare = e.load_plant("ehsa")
jump = jumps([0.060], 1.0, wait=0.1)
mpc = e.load_controller("mpc_position", model)
print(mpc)
bold = {
    "LQR": follow(replace(lqr, trajectory=None), jump, bare),
    "MPC": follow(replace(mpc, trajectory=None), jump, bare),
}
allowed = bare.limits["pump_speed"].value
small = [follow(replace(c, trajectory=None), jumps([0.0005], 0.5), bare).asked for c in (lqr, mpc)]
assert np.allclose(*small, atol=1e-6)
assert bold["LQR"].trajectory["omega"].max() > 2 * allowed > 2 * bold["MPC"].trajectory["omega"].max()

figure, axes = plt.subplots(3, 1, figsize=(8, 5.4), sharex=True, layout="constrained")
for (name, run), colour, dashes in zip(
    bold.items(), (e.style.VERMILION, e.style.BLUE), ((0, (4, 1.2)), "-"), strict=True
):
    for ax, values in zip(axes, (1e3 * run.trajectory["x"], run.trajectory["omega"], run.asked), strict=True):
        ax.plot(run.trajectory.time, values, color=colour, linestyle=dashes, label=name)
axes[1].axhline(allowed, color=e.style.PURPLE, linestyle=(0, (8, 2, 2, 2)), label="limit of the pump")
for ax, label in zip(axes, ("position\n(mm)", "shaft\n(rad/s)", "current\n(A)"), strict=True):
    ax.set(ylabel=label, xlim=(0, 0.8))
axes[1].legend(loc="upper right")
axes[2].set_xlabel("time (s)")
plt.show()
for trip in bold["LQR"].trajectory.exceeded:
    print("LQR:", trip)

# %% [markdown]
# If the solver fails, the controller must still return a current. The trace `solver_status` records its origin for each
# sample: 0 the solution; 1 the solution with a violated soft limit; 2 no solution in time, so the next current of the
# previous plan; 3 the LQR's current within the limits of current and rate. To show these cases, the solver gets too few
# iterations:

# %%
rows, runs = {}, {}
for most in (200, 20, 8):
    run = follow(replace(mpc, trajectory=None, law=replace(mpc.law, iteration_limit=most)), jump, bare)
    status = run.traces["solver_status"].astype(int)
    rows[most] = {f"status {k}": int(np.sum(status == k)) for k in range(4)} | {
        "most iterations": int(run.traces["solver_iterations"].max()),
        "fastest shaft (rad/s)": round(run.trajectory["omega"].max()),
        "error at the end (um)": round(1e6 * abs(run.error[-1])),
    }
    runs[most] = run
table = pd.DataFrame(rows).T.rename_axis("iterations allowed")
assert table.loc[200, "status 0"] + table.loc[200, "status 1"] == len(jump) and table.loc[8, "status 3"] > 0
table

# %% [markdown]
# With enough iterations every sample is solved. With too few the rod still arrives, and current and rate keep their
# limits; the speed does not, because the substituted LQR does not consider it. A planned motion within the limits, as
# in the shipped `mpc_position`, makes such samples rare: they occur near a limit.

# %%
quiet = follow(mpc, jump, bare)
assert not quiet.traces["solver_status"].any() and quiet.traces["solver_iterations"].max() < 10
print(f"with the planned motion: at most {quiet.traces['solver_iterations'].max():.0f} iterations, every sample solved")

# %% [markdown]
# ## 8. Robustness against parameter errors
#
# Margins hold for one model. Here are twenty: sixteen draws of the parameters (10 % on identified values without a
# stated uncertainty, the torque constant and other assumed numbers anywhere within their bounds), with and without the
# spring, with and without 100 kg behind the load cell. `robust_margins` gives the worst of each margin *and the plant
# that has it*.

# %%
models = e.drawn_models(
    linear,
    e.draw(linear, 16, seed=0, unknown=0.1, assumed=True),
    e.conditions(stiffnesses=[0.0, 50e3], masses=[0.0, 100.0]),
)
robust = {name: e.robust_margins(models, controller, points=120) for name, controller in chosen.items()}
table = pd.DataFrame(
    {
        name: {
            "nominal Ms": e.analyse_loop(model, chosen[name]).Ms,
            "worst Ms": found.Ms,
            "worst disk margin": found.disk_margin,
            "stable": found.stable,
            "the plant with the worst Ms": found.worst["Ms"].label,
        }
        for name, found in robust.items()
    }
).T
assert all(found.stable for found in robust.values())
assert robust["pid_tuned"].Ms > 2 * robust["lqr_position"].Ms
table.style.format(dict.fromkeys(("nominal Ms", "worst Ms", "worst disk margin"), "{:.2f}"))

# %%
e.figures.robustness_figure(robust["pid_tuned"])

# %% [markdown]
# All loops are stable. But the tuned PID, with Ms = 1.45 on its own model, comes close to instability with a heavy
# payload and a torque constant above the nominal one: a payload makes the hydraulic resonance slower and less damped,
# and a large gain excites it. Tuning uses all of the allowed margin. Cascade and LQR measure the shaft's speed and lose
# far less.
#
# `review` checks a design for common problems and recommends actions. In addition to the linear model it needs some
# data on friction and noise.

# %%
look = e.review(model, chosen["pid_tuned"], known=replace(known, slip=quantum), robust=robust["pid_tuned"])
assert {"limit cycle of the integral", "worst Ms"} <= {finding.test for finding in look.warnings}
look

# %% [markdown]
# ## 9. A scenario is a test
#
# A requirement is a TOML with limits and the reason for it. `pytest` collects it from a folder `scenarios/`. This one
# states the requirement of section 6.

# %%
Path("scenarios").mkdir()
Path("scenarios/quiet_rest.toml").write_text("""
schema = 1
title = "Three moves and a rest that is quiet"
why = "A rod that hunts at rest wears its seals and can be heard."
plant = "ehsa"
controller = "pid_friction"
duration = "12 s"

[load]
stiffness = "50 kN/m"

[reference]
kind = "steps"
times = ["0.2 s", "2 s", "4 s"]
positions = ["10 mm", "-5 mm", "8 mm"]

[limits]
SettlingTimeAbs = { max = "500 ms" }
HuntingAmplitude = { max = "0 um" }
Slips = { max = 0 }
""")
command = [
    sys.executable,
    "-m",
    "pytest",
    "scenarios",
    "-q",
    "--no-header",
    "-p",
    "no:cacheprovider",
    "--color=no",
    "--ehsa-controller",
]
tested = subprocess.run([*command, "pid_friction,pid_tuned"], capture_output=True, text=True, check=False)
report = [line for line in tested.stdout.splitlines() if line.strip() and not line.startswith(("=", "FAILED"))]
print("\n".join(line for line in report if " in " not in line or "passed" not in line))
assert tested.returncode == 1 and "1 failed, 1 passed" in tested.stdout

# %% [markdown]
# One run is one plant and one seed. `monte_carlo` draws both and gives the probability of passing with its interval and
# the deciding parameter. The shipped `spread_steps` varies friction, torque constant, inertia and load.

# %%
classic = e.monte_carlo("spread_steps", runs=100, controller="pid_position")
with_cures = e.monte_carlo("spread_steps", runs=100, controller="lqr_friction")
assert 0.85 < classic.probability < 1.0 and with_cures.probability == 1.0
assert classic.influences[0].name == "K_S"
print(classic)
print(with_cures)
classic.plot()

# %% [markdown]
# For the PID the spring matters most: the softer it is, the closer the steady-state error comes to its limit. "Not
# decisive" below a parameter: its influence is not significant. With the remedies every run passes; the interval shows
# what 100 runs can prove.
#
# ## 10. A law of your own
#
# Wherever a controller's name goes, a Python object goes too: a transfer function or state space of python-control from
# the position error to the current, a function of time, measurements and reference, or an object with such a method
# `step`. A list of controllers gives one table. Design models may come from `linearise`.

# %%
lead = control.tf([12.0, 300.0], [0.004, 1.0], name="lead")  # continuous: discretised by Tustin's rule


def damped(t, y, r):
    return 2000.0 * (r.position - y.position) - 0.03 * y.speed


stiff = e.load_controller("lqr_position", e.linearise(rig), weights={"position": 0.3e-3}, label="lqr_stiff")
table = e.run("steps_spring", controller=["pid_friction", stiff, lead, damped])
assert table["lqr_stiff"].passed and not table["lead"].passed
table

# %% [markdown]
# The spring leaves both laws without integral action standing off the target. `e.analyse_loop(model, lead)` gives the
# margins of a linear law of your own; a function has none.
#
# So does an H-infinity design: python-control's `mixsyn` (with the package slycot) shapes the sensitivity $S$ by a
# weight $W_1$ and the current $K S$ by $W_2$, and returns a state space. In scaled states, with the position in mm; the
# integrator is moved by 0.01 rad/s, because `mixsyn` takes no pole on the axis.

# %%
scale = np.array([100.0, 1e6, 0.1, 0.01])
A = model.A * scale / scale[:, None] - 0.01 * np.eye(4)
G = control.ss(A, model.B[:, :1] / scale[:, None], 1e3 * model.C[[model.output_labels.index("x")]] * scale, 0.0)
W_1 = control.tf([1 / 1.6, 30.0], [1.0, 0.3])  # |S| below 1.6, from 30 rad/s down as small as possible
W_2 = control.tf([1.0, 30.0], [0.02, 60.0])  # 2 A per mm, less and less beyond 30 rad/s
with warnings.catch_warnings():
    warnings.simplefilter("ignore", FutureWarning)  # python-control's own
    K, _, (gamma, _) = control.mixsyn(G, W_1, W_2)
h_infinity = control.ss(K.A, K.B, 1e3 * K.C, 1e3 * K.D, name="h_infinity")
h_loop = e.analyse_loop(model, e.load_controller(h_infinity, current_limit=6.0))
assert h_loop.stable and h_loop.Ms < 1.6
print(f"gamma {gamma:.3g}, order {h_infinity.nstates}")
h_loop

# %% [markdown]
# From the position alone it reaches half the crossover of `pid_position`; it gives up bandwidth for a small $K S$.
#
# ## 11. Weaknesses of each controller
#
# - `pid_position`: safe margins, readable gains. It hunts slowly and takes nine times the shortest time.
# - `pid_tuned`: stiff against loads. It hunts as well, settles later, and with an unfavourable payload has little
#   margin left.
# - `cascade_position`: fast and robust. A step drives the pump beyond its speed limit; it needs a planned motion.
# - `lqr_position`: fast, offset-free, quiet. It hunts at rest most often of all, as its disturbance estimate acts as an
#   integral; it tolerates less than two samples of extra delay.
# - `mpc_position`: respects limits that no other law considers. At rest it equals the LQR, including the hunting. It
#   needs a solver, and its speed limit is soft.
# - `*_friction`: quiet. They leave any error within the band, and depend on friction values identified from a log.
#
# Two more tests of the remedies: friction 30 % higher, as with cold oil, and a path that reverses slowly, without rest.

# %%
rows = {}
for name in ("pid_friction", "cascade_friction", "lqr_friction"):
    controller, row = e.load_controller(name, model), {}
    for growth in (1.0, 1.3):
        plant = rig.set(A_FM=growth * rig["A_FM"], A_FR=growth * rig["A_FR"])
        found = moved(follow(controller, moves, plant))
        row[f"settled, friction x {growth:g}"] = found["settled"]
        row[f"slips at rest, friction x {growth:g}"] = found["slips at rest"]
    sine = e.run("slow_sine", controller=name)
    row["largest error in slow_sine (um)"] = round(1e6 * sine.metrics["MaxError"][1])
    row["rod sticks in slow_sine (%)"] = round(100 * sine.metrics["StickShare"][1], 1)
    rows[name] = row
table = pd.DataFrame(rows).T
assert table.loc["pid_friction", "slips at rest, friction x 1.3"] > 20
assert (table.loc[["cascade_friction", "lqr_friction"], "slips at rest, friction x 1.3"] <= 5).all()
assert (table["rod sticks in slow_sine (%)"] > 15).all()
table

# %% [markdown]
# The remedy of the PID depends on its friction values: with more friction it hunts again, as without the remedy. The
# other two stay at rest, because a fast inner loop or an estimate compensates the missing feed-forward. In the slow
# sine all three stick for a fifth of the time, with errors far above the smallest slip; none of the remedies helps
# there.

# %%
lqr_loop = e.analyse_loop(model, lqr)
assert 1.0 < lqr_loop.delay_margin / DT < 2.0
assert first.metrics["SettlingRatio"][1] > 8
print(f"delay margin of lqr_position: {1e3 * lqr_loop.delay_margin:.2f} ms, {lqr_loop.delay_margin / DT:.2f} samples")

# %% [markdown]
# **Next:** [from_gap_to_cause](from_gap_to_cause.ipynb). All of this was checked on a known plant. The next notebook
# treats a rig that differs from its model.
