# ruff: noqa: B018, F821

# %% [markdown]
# # From a log to a plant
#
# From a bench run and a plant with parameters 30 % off to a controller: compare, check the log, identify, question the
# result, and design on it. Everything here is also a command: `ehsa-ctrl compare`, `ehsa-ctrl identify`, `ehsa-ctrl
# run`.
#
# This is the second of five notebooks; the plant and its equations are in `from_paper_to_model`.
#
# The bench is virtual. It drives the paper's actuator and adds sensor noise, also to the current. So the results can be
# compared with the truth, which a real bench does not offer; the truth is used for nothing else.

# %%
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small here: threads would only wait for each other

import difflib
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import ehsa_ctrl as e

plt.rcParams.update(e.style.RC)

os.chdir(tempfile.mkdtemp())  # a folder of its own, as a project would have
truth = e.load_plant("ehsa")


def bench(kind, amplitude, duration, seed, centre=True):
    """A file as the bench writes it, read back: t, current, speed, p1, p2, position at 250 Hz."""
    time, current = e.excitation(kind, amplitude=amplitude, duration=duration, seed=seed)
    log, _ = e.record(truth, time, current, seed=seed, centre=centre)
    log.write(Path(f"{kind}.csv"))
    return e.read_plant_log(f"{kind}.csv", truth)


# %% [markdown]
# ## 1. The log and the nominal plant
#
# One log to identify from: 20 s of noise with peaks of 3 A, as in the paper. Two that are held out, the paper's Fig. 7
# and 8: steps of 1.5 A, and a sine of 1.5 A at 2 Hz. Only a fit on held-out data counts.
#
# Every free parameter is then set 30 % too high or too low at random. Free are the eleven parameters with the source
# `identified`.

# %%
noise = bench("noise", 3.0, 20.0, seed=0)
steps = bench("steps", 1.5, 4.0, seed=1)
sine = bench("sine", 1.5, 4.0, seed=2)

coin = np.random.default_rng(0)
nominal = truth.set(**{name: truth[name] * coin.choice([0.7, 1.3]) for name in truth.free})

replays = {"noise": e.replay(nominal, noise), "steps": e.replay(nominal, steps), "sine": e.replay(nominal, sine)}
print("fit of the nominal plant in free run, %")
pd.DataFrame({name: run.fit_percent for name, run in replays.items()}).T.round(1)

# %% [markdown]
# `replay` simulates the plant in free run with the logged current. A fit of 100 % is perfect, 0 % is as good as the
# mean of the measurement, and a negative fit is worse. Speed and pressures fit partly, the position does not: it
# integrates the speed error.
#
# **Check the log before the fit.** A swapped sign would silently lead to meaningless parameters. Here the log as it is,
# one with the sign of p1 reversed, and one with the two pressures exchanged:


# %%
def with_channels(log, **channels):
    return replace(log, channels={**log.channels, **channels})


turned = with_channels(noise, p1=-noise["p1"])
exchanged = with_channels(noise, p1=noise["p2"], p2=noise["p1"])

for name, log in {"as it is": noise, "p1 turned": turned, "pressures exchanged": exchanged}.items():
    print(f"{name}:")
    for finding in e.check_log(log, nominal) or ["nothing found"]:
        print("   ", finding)

# %% [markdown]
# A rough plant is enough for this: 30 % off still determines a sign. `identify` makes the same check and rejects a log
# with an error.

# %%
try:
    e.identify(nominal, exchanged)
except e.InputError as error:
    print(error)

# %% [markdown]
# ## 2. Identify
#
# The cost is the error of the free run over the whole log, each signal weighted by its noise. It is minimised from two
# starts, one from the balances of torque, flow and force, one from the nominal values, and ends when both reach the
# same minimum.

# %%
found = e.identify(nominal, noise, validate=[steps, sine])
assert found.explained and all(row.identifiable for row in found.estimates)
found

# %% [markdown]
# Read the line *residuals 1 times the noise's variance* first: the residuals are as large as the sensor noise. On the
# held-out logs the fit of all four channels is limited by noise only. The figure shows the steps: measured, before and
# after.

# %%
found.plot()

# %% [markdown]
# Change and uncertainty of each parameter. The scale of the left panel is linear up to 1 % and logarithmic beyond;
# otherwise the intervals would be dots.

# %%
e.figures.parameters_figure(found)

# %% [markdown]
# ### What these standard deviations mean
#
# On this bench the truth is known, so the standard deviations can be compared with the true errors. Errors divided by
# their standard deviation should be normally distributed: most within one, hardly any beyond two or three. Because the
# errors are correlated, a joint test is better: the squared distance in the metric of the covariance has a chi-square
# distribution with 11 degrees of freedom, 11 on average and below 20 in 95 of 100 logs.

# %%
table = found.to_pandas()[["value", "sd", "unit"]]
table["truth"] = [truth[name] for name in table.index]
table["error in %"] = 100 * (table["value"] / table["truth"] - 1)
table["error in sd"] = (table["value"] - table["truth"]) / table["sd"]

error = (table["value"] - table["truth"]).to_numpy()
distance = error @ np.linalg.solve(found.uncertainty.covariance, error)
assert distance < 31.3, "beyond what chance does once in 1000 logs"
print(f"squared distance {distance:.1f}")
table[["truth", "value", "unit", "error in %", "error in sd"]].round({"error in %": 2, "error in sd": 1})

# %% [markdown]
# A model with output noise alone would give wrong standard deviations. The logged current differs from the true current
# by 5 mA of noise in each sample. The simulation uses the logged current and drifts away from the measurement *even
# with all parameters true*: the rod's position integrates the difference, and friction turns a small difference into a
# breakaway that is a sample early or late. Below is the position error of the true plant: white noise of the
# potentiometer explains only a part of it.

# %%
t, current = e.excitation("noise", amplitude=3.0, duration=20.0, seed=0)
_, run = e.record(truth, t, current, seed=0, centre=True)
acted = with_channels(noise, current=run["current"])  # what nobody can measure
drift = e.replay(truth, noise).residual("position")
sensor = e.replay(truth, acted).residual("position")

figure, ax = plt.subplots(figsize=(8, 2.6), layout="constrained")
ax.plot(noise.time, 1e6 * drift, ".", markersize=2, color=e.style.VERMILION, label="driven by the logged current")
ax.plot(noise.time, 1e6 * sensor, ".", markersize=1.2, color=e.style.BLACK, label="driven by the current that acted")
ax.set(xlabel="time (s)", ylabel="position, measured\nless simulated (µm)", xlim=(0, 20))
ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2, markerscale=5)
plt.show()
print(f"rms {1e6 * drift.std():.0f} and {1e6 * sensor.std():.0f} um, largest {1e6 * abs(drift).max():.0f} um")

# %% [markdown]
# Neighbouring drift errors are correlated, but least squares counts each of them as independent information. `identify`
# models the noise of the logged current: it whitens the residuals by the response to current errors along the run. With
# weights for output noise alone, the standard deviations would be too small by these factors:

# %%
exact = replace(found.plant, sensors={**truth.sensors, "current": replace(truth.sensors["current"], noise=0.0)})
honest = e.forecast(found.plant, noise.time, noise["current"])
bold = e.forecast(exact, noise.time, noise["current"])
pd.DataFrame({row.name: {"too small by": row.sd / bold[row.name].sd} for row in honest.estimates}).round(1)

# %% [markdown]
# Finally, the correlation of the errors. For a framed pair the log determines the ratio or the sum better than each
# parameter.

# %%
e.figures.correlation_figure(found)

# %% [markdown]
# There is no frame here. The strongest correlation is between Coulomb, Stribeck and viscous friction of the rod: less
# of one and more of another gives nearly the same force over the speeds in the log.

# %% [markdown]
# ## 3. Residual tests
#
# Small residuals don't prove a model. The residuals of a correct model are uncorrelated with their own past, with the
# current, with the direction of motion (wrong friction would show there) and with the position (a wrong volume, a
# missing spring).

# %%
assert not [test for test in found.residual_tests if not test.passed]
e.figures.residuals_figure(found)

# %% [markdown]
# All sixteen tests pass. The position residual has a correlation of 0.04 with the direction of motion, with the same
# sign at several neighbouring lags. The rod's friction law is right here, as we know: the direction hardly changes from
# sample to sample, so neighbouring lags are not independent, and the bands account for that. An incomplete model looks
# different: for the linear model below, the speed residual has a correlation of 0.98 with its own past. A passed test
# is no proof; it says that this log contains no further information about the model.

# %% [markdown]
# ## 4. What this log does not determine
#
# **Torque constant and bulk modulus** are not free in the plant's file, as the paper does not print them. The log does
# determine them: area and displacement are known from the datasheet, and the pressures give the pump torque and so the
# torque constant; the stroke changes the volumes by a known amount and so separates volumes and modulus. Both start 8
# to 15 % off here.

# %%
wider = e.identify(found.plant.set(K_T=1.1, beta=1.2e9), noise, free=["K_T", "beta"])
assert all(abs(wider[name].value - truth[name]) < 4 * wider[name].sd for name in ("K_T", "beta"))
wider

# %% [markdown]
# Both are recovered, to 0.2 % and to about 1 %. The price: the standard deviation of the shaft's dry friction doubles,
# that of the inertia grows fourfold and those of the volumes ninefold, because the log determines their ratios to $K_T$
# or $\beta$ far better than themselves. The frames in this figure show these pairs. If a controller needs only the
# ratio, nothing is lost.

# %%
e.figures.correlation_figure(wider)

# %% [markdown]
# **Two forces that are both constant** can't be separated by any log: a preload of the spring and a constant force on
# the rod enter the same equation in the same way. `forecast` computes the expected covariance before a log is recorded,
# and shows it.

# %%
e.forecast(found.plant, noise.time, noise["current"], free=["load.preload", "load.force"])

# %% [markdown]
# **A ramp**, the paper's Fig. 4, is the classic experiment for the breakaway force. But the rod moves in one direction
# only.

# %%
ramp = bench("ramp", 1.6, 4.0, seed=3, centre=False)
for finding in e.check_log(ramp, nominal):
    print(finding)

by_ramp = e.identify(nominal, ramp, starts=3)  # more of them end no better
assert by_ramp["M"].sd > 3 * found["M"].sd
table = by_ramp.to_pandas()[["value", "sd", "verdict"]]
table["truth"] = [truth[name] for name in table.index]
table["off by %"] = (100 * (table["value"] / table["truth"] - 1)).round(1)
print(f"residuals {by_ramp.fit.reduced_cost:.2f} times the noise's variance, explained by noise: {by_ramp.explained}")
table

# %% [markdown]
# The warning is justified. The ramp breaks away once and hardly accelerates, so the mass is poorly determined and
# friction compensates for it, with values far off. Standard deviations are computed from derivatives at the minimum
# found; they can't show a better minimum elsewhere. Such a result is recognisable by the residuals, which noise does
# not explain; no parameter is then called well determined. Two rules follow: read the line on the residuals before the
# table, and move the rod in both directions, often. `ehsa-ctrl excite` (`e.design_experiment`) proposes such a current
# within the plant's limits.

# %% [markdown]
# ## 5. A linear model of the same rig
#
# Controllers are designed on a linear model without dry friction, which can be fitted to the same log. To show how much
# the result depends on the log, it is fitted twice: on the first and on the second half of the log, each validated on
# the other half.

# %%
halves = {"first half": noise.segment(0, 10), "second half": noise.segment(10, 20)}
first, second = halves.values()
linear = {
    "first half": e.identify(e.load_plant("ehsa", model="linear"), first, validate=[second], starts=1),
    "second half": e.identify(e.load_plant("ehsa", model="linear"), second, validate=[first], starts=1),
}
assert not any(result.explained for result in linear.values())

rows = {"nonlinear, whole log": found.train.fit_percent}
for name, result in linear.items():
    rows[f"linear, {name}"] = result.train.fit_percent
    rows[f"linear, {name}, on the other"] = result.validation.fit_percent
print("fit in free run, %")
display(pd.DataFrame(rows).T.round(1))
linear["first half"]

# %% [markdown]
# No values of the six parameters fit the log, and the tool reports it: residuals thousands of times the noise, no fit
# of the position, unreliable parameters. The cost has a flat minimum: the other half of the same log gives other
# values. Two alternatives are the paper's linear set (Table 2), and the *sliding* set: viscous friction, inertia, mass,
# volumes and leakage of the identified nonlinear plant. It holds between two standstills, while shaft and rod slide.

# %%
e.write_plant("plants/identified.toml", found.plant, force=True)  # found by name in a folder plants/
e.write_plant("plants/first.toml", found.plant, linear["first half"].plant, force=True)
e.write_plant("plants/second.toml", found.plant, linear["second half"].plant, force=True)
e.write_plant("plants/sliding.toml", found.plant, e.sliding_linear(found.plant), force=True)

designs = {"Table 2": "ehsa", "fitted, first half": "first", "fitted, second half": "second", "sliding": "sliding"}
models = {name: e.load_plant(plant, model="linear") for name, plant in designs.items()}
pd.DataFrame({name: plant.values for name, plant in models.items()}).T[["J_M", "B_FM", "M", "B_FR", "K_L", "V"]]

# %% [markdown]
# The fitted models take dry friction for damping: about ten times the viscous friction of the sliding shaft and rod,
# and also a leakage that the rig does not have. (Table 2 shows the same to a lesser degree: B_FM and B_FR of its linear
# set are a third and a twentieth larger than those of its nonlinear one.)
#
# `pid_position` specifies a crossover of 35 rad/s (5.6 Hz) and a phase margin of 60 degrees, and reaches both on every
# model. So the margins on the design model don't show which design is good. The gains do, and so do the margins of the
# same controller on the sliding model, which describes the moving rig.

# %%
slides = e.three_state(models["sliding"])
rows = {}


def rounded(value, digits=0):
    return round(value, digits) if np.isfinite(value) else value  # an unstable loop has no margins


for name, plant in models.items():
    pid = e.load_controller("pid_position", e.three_state(plant))
    own, real = e.analyse_loop(e.three_state(plant), pid), e.analyse_loop(slides, pid)
    rows[name] = {
        ("gains", "k_p [A/m]"): round(pid.law.gains.k_p),
        ("gains", "k_i [A/(m s)]"): round(pid.law.gains.k_i),
        ("gains", "k_d [A s/m]"): round(pid.law.gains.k_d),
        ("on its own model", "phase margin [deg]"): round(own.phase_margin),
        ("on its own model", "gain margin"): round(own.gain_margin, 1),
        ("on the sliding model", "crossover [Hz]"): rounded(real.crossover / (2 * np.pi), 1),
        ("on the sliding model", "phase margin [deg]"): rounded(real.phase_margin),
        ("on the sliding model", "gain margin"): rounded(real.gain_margin, 1),
        ("on the sliding model", "stable"): real.stable,
    }
left = {name: row["on the sliding model", "phase margin [deg]"] for name, row in rows.items()}
assert left["Table 2"] == 58 and left["sliding"] == 60
assert not any(left[name] > 30 for name in rows if "fitted" in name)  # or no margin at all
assert all(
    rows[name]["gains", "k_p [A/m]"] > 2 * rows["sliding"]["gains", "k_p [A/m]"] for name in rows if "fitted" in name
)
pd.DataFrame(rows).T

# %% [markdown]
# Designed on a fitted model, the controller is much too aggressive: on the sliding model its crossover is three times
# the specified one with less than half the phase margin, or the loop is even unstable. This depends on the half of
# the log and, because the minimum is flat, on details of the fit. Table 2 and the sliding model give nearly the same
# controller.
#
# The decisive check: the shipped scenarios on the identified *nonlinear* plant, against a spring of 50 kN/m, with the
# noise of the sensors.

# %%
results = {
    (name, scenario): e.run(scenario, plant="identified", design=plant)
    for scenario in ("steps_spring", "force_step", "slow_sine")
    for name, plant in designs.items()
}
rows = []
for (name, scenario), result in results.items():
    value = {metric: nonlinear for metric, (_, nonlinear) in result.metrics.items()}
    rows.append(
        {
            "scenario": scenario,
            "designed on": name,
            "passed": result.passed,
            "settling [ms]": 1e3 * value["SettlingTime"],
            "overshoot [%]": 100 * value["Overshoot"],
            "largest error [mm]": 1e3 * value["MaxError"],
            "standing error [um]": 1e6 * value["SteadyStateError"],
            "slips": value["Slips"],
            "hunting [um]": 1e6 * value["HuntingAmplitude"],
            "travel of current [A]": value["TV"],
        }
    )
for (name, scenario), result in results.items():
    for failure in result.failures:
        print(f"{scenario}, designed on {name}: {failure}")
assert all(result.passed for (name, _), result in results.items() if "fitted" not in name)
table = pd.DataFrame(rows).set_index(["scenario", "designed on"])
table.round(1).map(lambda value: value if value == value else "")

# %%
figure, (position, current) = plt.subplots(2, 1, figsize=(8, 4.8), sharex=True, layout="constrained")
looks = {
    "Table 2": (e.style.BLUE, "-", 1.8),
    "fitted, first half": (e.style.VERMILION, "-", 0.8),
    "fitted, second half": (e.style.PURPLE, (0, (4, 1.2)), 1.0),
    "sliding": (e.style.GREEN, (0, (2, 1)), 1.5),
}
for name, (colour, dashes, width) in looks.items():
    loop = results[name, "steps_spring"].nonlinear
    run = loop.trajectory
    position.plot(run.time, 1e3 * run["x"], color=colour, linestyle=dashes, linewidth=width, label=name)
    current.plot(run.time, run["current"], color=colour, linewidth=0.8)
position.plot(
    run.time, 1e3 * loop.reference[:, 0], color=e.style.BLACK, linewidth=0.9, linestyle=(0, (6, 3)), label="reference"
)
position.set(ylabel="position\n(mm)", xlim=(0, 5))
current.set(ylabel="current\n(A)", xlabel="time (s)")
position.legend(
    title="steps_spring; the controller is designed on",
    alignment="left",
    ncols=5,
    loc="lower left",
    bbox_to_anchor=(-0.08, 1),
)
plt.show()

# %% [markdown]
# Table 2 and the sliding model pass all scenarios. Of the fitted models, one passes and one fails.
#
# - The controllers from the fitted models have the smallest errors under the force and in the sine: a large gain
#   reduces the effect of dry friction. The price is overshoot, longer settling, and three to ten times the current
#   travel, because a large gain amplifies sensor noise. The one with a phase margin of 24 degrees on the sliding model
#   passes with little reserve; the one that is unstable there fails where the rod slides fast or must hold a force. A
#   scenario shows one case; a margin shows the distance to failure.
# - Table 2's controller passes with a phase margin of 58 degrees.
# - So does the sliding model's, with 60. Its gains are the smallest of the four, a tenth below Table 2's, and its
#   steady-state error under the force is the largest: the rod sticks, and the integral has to wind up against dry
#   friction, which no linear model contains.
#
# So design on one of the two models of the sliding rig: the specification is then met. The fit in percent would have
# selected neither. If the integral is too slow, specify a higher crossover instead of getting one from a model that
# takes friction for damping, and check on the nonlinear plant.

# %% [markdown]
# ## 6. Save the plant
#
# The identified plant is written as a TOML: a copy of its file with the new values, standard deviations and sources.
# Everything else, including comments, is unchanged.

# %%
before = e.plants["ehsa"].read_text().splitlines()
after = Path("plants/identified.toml").read_text().splitlines()
for line in difflib.unified_diff(before, after, "ehsa.toml", "identified.toml", lineterm="", n=0):
    if not line.startswith("@@"):
        print(line)

# %% [markdown]
# It is in a folder `plants/` of the project and so is found by name: `ehsa-ctrl run --plant identified`.
#
# ## Summary
#
# - Check the log first. Then read the line on the residuals, and only then the table.
# - Standard deviations are realistic only if the noise of the logged current is in the model. The correlation figure
#   shows which parameters trade off.
# - A ramp shows the breakaway threshold and identifies nothing else. Move the rod in both directions, often.
# - A linear model fitted to a log with dry friction is a compromise that depends on the log. Design on the sliding
#   model.
#
# **Next:** [from_model_to_controller](from_model_to_controller.ipynb) designs PID, cascade, LQR and MPC and shows the
# effect of friction on them.
