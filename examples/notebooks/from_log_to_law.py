# ruff: noqa: E501

# %% [markdown]
# # From a log to a law
#
# A rig differs from its simulation, and no effect of the catalogue explains how. This notebook goes from such a log to
# the law behind it: an expression with numbers and units, found by `diagnose`; a plant that has it; a second log that
# confirms it; and a controller that uses it. On the command line: `ehsa-ctrl diagnose` and `ehsa-ctrl effects confirm`.
#
# It is the last of five notebooks, after `from_gap_to_cause`, which shows what a diagnosis does where the catalogue has the
# effect.

# %%
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small here: threads would only wait for each other

import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import ehsa_ctrl as e

os.chdir(tempfile.mkdtemp())  # a folder of its own, as a project would have
plt.rcParams.update(e.style.RC)

# %% [markdown]
# ## 1. A rig, a nominal model, a log
#
# **You would have a log instead of this cell.** The motor of this rig gets weaker as it warms up: within half a minute of a
# cold start it loses 15 % of its torque. No effect of the catalogue changes a torque constant with time. The rig has an
# effect's file of its own in another folder, which is put away once the logs are recorded. Two parameters are 1 % off.

# %%
WARM = """
schema = 1
status = "confirmed"
summary = "a motor that gets weaker as it warms up"
adds_to = "torque"
expression = "-k_warm * current * (1 - exp(-age / tau_warm))"

[parameters]
k_warm = { value = 0.178, unit = "N m/A", neutral = 0.0 }
tau_warm = { value = 6.0, unit = "s" }

[states]
age = { rate = "1", unit = "s", scale = 1.0 }
"""
Path("the_rig/effects").mkdir(parents=True)
Path("the_rig/plants").mkdir()
shutil.copy(e.plants["ehsa"], "the_rig/plants/rig.toml")
nominal = e.load_plant("ehsa")


def build_rig():
    """The rig; its own law is known to this session as long as its file exists."""
    Path("the_rig/effects/warming.toml").write_text(WARM)
    return e.load_plant("the_rig/plants/rig.toml").with_effects("warming").set(K_T=1.188, A_FM=0.808)


def bench(rig, time, current, name, seed):
    """A file as the bench writes it: t, current, speed, p1, p2, position, force at 250 Hz, with noise."""
    log, run = e.record(rig, time, current, seed=seed, centre=True)
    assert not run.stopped
    log.write(Path(name))


LOAD = {"F_0": 2000.0}
push = e.motion_current(nominal)["load"] * LOAD["F_0"]
rig = build_rig()
bench(rig, *e.excitation("noise", amplitude=3.0, duration=18.0, seed=1), "rig.csv", seed=1)
time, current = e.excitation("multisine", amplitude=3.0, duration=10.0, seed=5)
bench(rig.set(**LOAD), time, current + push, "second.csv", seed=7)
Path("the_rig/effects/warming.toml").unlink()

nominal = e.load_plant("ehsa")
log = e.read_plant_log("rig.csv", nominal)
pd.DataFrame({"gap, %": {signal: 100.0 * value for signal, value in e.gap(nominal, log).items()}}).round(1)

# %% [markdown]
# ## 2. Diagnose
#
# The diagnosis tries all effects of the catalogue. What they leave is recovered as an unknown input of each balance,
# and regressed on the variables of that balance: powers, roots, hinges, bumps, waves, dry friction, time, lags. What
# survives cross-validation and a block bootstrap becomes an effect, is refitted in free run with the nominal
# parameters, and is judged on the part of the log that no fit has seen.

# %%
diagnosis = e.diagnose(nominal, log)
law = diagnosis.law
assert law is not None and law.place == "torque" and law.variables == ("current", "time")
print(diagnosis.sentence)

# %%
before, after = diagnosis.gap["nominal"]["total"], diagnosis.gap["with_law"]["total"]
assert after < 0.1 * before
e.figures.law_figure(diagnosis)

# %% [markdown]
# Left, the unknown torque in bins of the current, with the law; right, what the law leaves. Below, the forms that this log
# can't tell apart, with their probabilities. `explained` is the share of the unknown input by cross-validation;
# `placebo` is what the same search finds in the input reversed in time: chance.

# %%
forms = [
    {"form": form.file.form, "probability": form.probability, "gap closed, %": 100.0 * form.gap_closed}
    for form in law.forms
]
print(f"explained {law.explained:.2f}, placebo {law.placebo:.2f}")
assert law.placebo < 0.2 < law.explained
pd.DataFrame(forms).round(2)

# %% [markdown]
# ## 3. The law as an effect
#
# The best form is an effect's file without code, with the status `proposed`, the range of the variables that the log
# had, and the hash of the log. `diagnose --out` writes it and the improved plant beside each other; here by hand.

# %%
file = Path(law.proposal)
file.parent.mkdir()
assert diagnosis.improved.structure.effects == (law.name,)
file.write_text(law.text([log]))
e.write_plant("plants/improved.toml", diagnosis.improved)
improved = e.load_plant("improved")
print(file.read_text())

# %% [markdown]
# ## 4. A second log confirms it, or does not
#
# One log is one experiment. The second one begins cold too, with another waveform and a force of 2 kN on the rod. The law is
# simulated in free run as proposed, and with its numbers refitted; it is refused if it gains nothing there, if its size
# changes, if the log hardly excites it, or if the catalogue explains the log better.

# %%
second = e.read_plant_log("second.csv", nominal)
confirmation = e.confirm_law(nominal.set(**LOAD), law.name, [second])
assert confirmation.confirmed
confirmation.write()
assert 'status = "confirmed"' in file.read_text()
print(confirmation)

# %% [markdown]
# The same log from which the law was found is not accepted:

# %%
again = e.confirm_law(nominal, law.name, [log])
assert not again.confirmed
print(again.refused[0])

# %% [markdown]
# ## 5. A controller that uses it
#
# `pid_friction` moves the rod along planned motions and feeds friction forward, in amperes: its numbers are those of a
# cold motor. The law says what a warm one needs: the same torques take $1 / (1 - c / K_T)$ times the current. Fourteen
# moves of two seconds, of which those after the first twelve seconds count: how far from its target does the rod stop?

# %%
numbers = law.forms[0].file.parameters
drop = -next(one.value for one in numbers.values() if one.neutral is not None) / improved["K_T"]
assert abs(drop - 0.15) < 0.02
shipped = e.load_controller("pid_friction", e.three_state(e.load_plant("ehsa", model="linear")))
names = ("inertia", "viscous", "coulomb", "static", "load")
warm = {name: getattr(shipped.feedforward, name) / (1.0 - drop) for name in names}
informed = replace(shipped, feedforward=shipped.feedforward.model_copy(update=warm))

EACH, COLD = 500, 6
targets = np.round(np.random.default_rng(0).uniform(-0.02, 0.02, 14), 4)
moves = np.column_stack([np.repeat(targets, EACH), np.zeros((targets.size * EACH, 2))])


def follow(controller, plant):
    """Errors at the ends of the warm moves [um]."""
    run = e.run_closed_loop(plant, controller, moves, sensors=e.Sensors.of(plant, seed=0))
    return 1e6 * run.error[EACH - 1 :: EACH][COLD:]


rig = build_rig()
plants = {"nominal": nominal, "with the law": improved, "the rig": rig}
table = {
    (controller, plant): np.sqrt(np.mean(follow(one, plants[plant]) ** 2))
    for controller, one in {"shipped": shipped, "numbers of the law": informed}.items()
    for plant in plants
}
table = pd.Series(table).unstack()[list(plants)]
assert table.loc["shipped", "the rig"] > 5 * table.loc["shipped", "nominal"]
assert abs(table.loc["shipped", "with the law"] / table.loc["shipped", "the rig"] - 1.0) < 0.3
assert table.loc["numbers of the law", "the rig"] < 0.6 * table.loc["shipped", "the rig"]
print(f"the motor loses {100 * drop:.1f} % of its torque; end error of the warm moves, rms (um):")
table.round(0)

# %% [markdown]
# The nominal plant promises the shipped controller what the rig does not keep: friction stops the rod short. The plant with the law
# predicts that, and the numbers from the law put it right on the rig.
#
# A law holds in the range that was seen, and it says what happens, not why: an ohmmeter on the warm motor would tell. If
# the law were needed often, it would stay in the project's `effects/`, where every diagnosis tries it like any other effect.
#
# **Next:** your own log. `ehsa-ctrl compare log.csv --plant ehsa` is the first command for it. Back to the beginning:
# [from_paper_to_model](from_paper_to_model.ipynb).
