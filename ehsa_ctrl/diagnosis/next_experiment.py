"""The next experiment: which input, within the plant's limits, best tells the candidates of a diagnosis apart.

A library of inputs is simulated with every candidate, with the load as it is and with a spring added or removed; the
input whose nearest pair of candidates is furthest apart is proposed.

Source: discrimination between rival models (T-optimality), A. C. Atkinson, V. V. Fedorov, "The design of experiments
for discriminating between two rival models", Biometrika 62(1), 1975; here over a library of inputs.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, inf
from pathlib import Path

import numpy as np

from ..core.catalogue import plants
from ..core.errors import InputError
from ..core.files import write_text
from ..core.result import Result
from ..plant.file import LOAD_SYMBOLS
from ..plant.load import load_plant
from ..plant.plant import Plant
from .excitation_library import library_inputs
from .hypothesis_model import HypothesisModel, Setting
from .hypothesis_search import Hypotheses
from .model_discrimination import FIRST, SPRING_STIFFNESS, CandidateModels, ExperimentTrial, Pair
from .model_selection import Selection
from .refit import NominalParameters
from .verdict_text import name_of

#: Two candidates nearer than this, in standard deviations, are alike; further apart than this, one log tells them.
LEAST, ENOUGH = 1.0, 5.0
#: Shortest experiment [s].
SHORTEST = 2.0
#: Inputs are screened over at most this time [s]; this many are compared after a refit, and this many over the full
#: time, out of this many that may turn out not to keep the limits for so long.
SCREENING, PROJECTED, IN_FULL, ATTEMPTS = 6.0, 24, 2, 4
#: Stiffness of the spring that may be added [N/m].
SPRING = 50e3
#: Changing the load is work: its distances count by this factor.
EFFORT = 0.8
#: Candidates among which an experiment has to decide.
CANDIDATES = 4
#: File of an input that is none of the command line's excitations, and folder of the log.
FILE, FOLDER = "next_experiment.csv", "results/next"

#: A trial and the distance of each pair (pairs,).
Compared = tuple[ExperimentTrial, np.ndarray]


@dataclass(frozen=True)
class NextExperiment(Result):
    """A proposed experiment and what to expect of it.

    Attributes
    ----------
    words: the experiment in one sentence.
    command: the call of `ehsa-ctrl simulate` that runs it on the virtual bench; FILE in it is what `write` writes.
    current: (N,) A, to be applied from rest, one value each sample_time [s]. amplitude: its peak [A].
    centre: whether the slow loop around the rod has to be on as well.
    load: keys of the load that have to be changed, with their new values; empty for the load as it is.
    distance: pair of candidates -> their distance in standard deviations of noise and assumed model error; its square
        is the deviance by which the wrong one will be worse.
    now: the same in the present log; empty if none was given.
    alike: pairs that no experiment of the library tells apart.
    tried: words of every experiment that was compared over its full length -> distance of its nearest pair.
    """

    words: str
    command: str
    current: np.ndarray = field(repr=False)
    sample_time: float
    amplitude: float
    centre: bool
    load: Mapping[str, float]
    distance: Mapping[Pair, float]
    now: Mapping[Pair, float]
    alike: tuple[Pair, ...]
    tried: Mapping[str, float]

    @property
    def worst(self) -> float:
        """Distance of the nearest pair that can be told apart at all."""
        return min(d for pair, d in self.distance.items() if pair not in self.alike)

    def write(self, path: str | Path) -> Path:
        """Write columns t, current as `ehsa-ctrl simulate --input` reads them, over a file of that name."""
        import pandas

        time = self.sample_time * np.arange(self.current.size)
        table = pandas.DataFrame({"t": time.round(6), "current": self.current.round(6)})
        return write_text(path, table.to_csv(index=False))

    def command_in(self, folder: str | Path) -> str:
        """The command where the input was written to FILE in a folder, and the log goes beside it."""
        folder = Path(folder)
        places = {FILE: str(folder / FILE), FOLDER: str(folder / "next")}
        return shlex.join(places.get(word, word) for word in shlex.split(self.command))

    def __str__(self) -> str:
        lines = [self.words]
        for pair, d in self.distance.items():
            now = f" ({self.now[pair]:.2g} now)" if pair in self.now else ""
            lines.append(f"  {' and '.join(pair)}: {d:.2g} standard deviations apart{now}")
        return "\n".join([*lines, f"  {self.command}"])


def next_experiment(
    plant: Plant,
    hypotheses: Mapping[str, Setting],
    *,
    noise: Mapping[str, float],
    nominal: NominalParameters,
    spring_possible: bool = True,
    seconds: float = 24.0,
    seed: int = 0,
    present: HypothesisModel | None = None,
) -> NextExperiment | None:
    """The experiment that best tells candidates apart: the nearest two are furthest apart.

    Parameters
    ----------
    plant: with every effect, see `with_every_effect`, and the present load.
    hypotheses: name of a candidate -> its fitted values as for `HypothesisModel.run`; at least two.
    noise: standard deviation of each measured channel's noise; a channel without one is not measured.
    nominal: parameters that each candidate may still change, with their prior deviations.
    spring_possible: whether a spring may be added, or the present one removed.
    seconds: length of the experiment; shorter where a candidate keeps the limits only for less time.
    seed: of random inputs.
    present: model with the present log, to give the candidates' distances in it.

    Returns
    -------
    None where no experiment of the library tells any two candidates apart: they are equivalent, or no input within the
    limits moves the plant.

    Raises
    ------
    InputError: fewer than two candidates, or an experiment that is too short.
    """
    if len(hypotheses) < 2:
        raise InputError(f"{len(hypotheses)} candidate(s); expected two or more to tell apart")
    if not SHORTEST <= seconds < inf:
        raise InputError(f"seconds = {seconds:g}; expected at least {SHORTEST:g} s")
    models = CandidateModels.of(plant, hypotheses, noise, nominal)
    time = plant.sample_time * np.arange(int(round(seconds / plant.sample_time)) + 1)
    compared = _best(models, list(_screened(models, _loads(plant, spring_possible), time, seed)), time)
    # Pairs that none of the best tells apart do not enter the choice.
    apart = np.array([d for _, d in compared]).reshape(len(compared), len(models.pairs))
    alive = np.asarray((apart >= LEAST).any(axis=0))
    if not alive.any():
        return None
    trial, distances = max(compared, key=lambda t: _effort(t[0]) * float(t[1][alive].min()))
    before = models.outputs(present, {}) if present is not None else None
    now = models.distances(before).tolist() if before is not None else []
    load = {word: models.with_load({}, trial.outputs.change).get(symbol) for word, symbol in LOAD_SYMBOLS.items()}
    distance = dict(zip(models.pairs, distances.tolist(), strict=True))
    alike = tuple(pair for pair, apart in zip(models.pairs, alive.tolist(), strict=True) if not apart)
    return NextExperiment(
        words=_words(trial, distance, dict(zip(models.pairs, now, strict=False)), alike),
        command=_command(plant, models, trial, seed),
        current=trial.input.current(trial.outputs.model.log.time, trial.amplitude),
        sample_time=plant.sample_time,
        amplitude=trial.amplitude,
        centre=trial.centre,
        load={word: v for word, v in load.items() if v is not None and v != plant[LOAD_SYMBOLS[word]]},
        distance=distance,
        now=dict(zip(models.pairs, now, strict=False)),
        alike=alike,
        tried={_what(t): float(d[alive].min()) for t, d in compared},
    )


def deciding_experiment(
    selection: Selection, hypotheses: Hypotheses, noise: Mapping[str, float]
) -> NextExperiment | None:
    """The experiment that tells the chosen hypothesis from its alternatives; None where there is nothing to decide."""
    model = hypotheses.objective.model
    structure = model.plant.structure
    driven = structure.chambers is None or bool(structure.system.prescribed)
    if selection.verdict not in ("ambiguous", "underdetermined") or driven:
        return None
    chosen = set(selection.chosen.causes)
    others = {key for keys in selection.alternatives.values() for key in keys}
    alternatives = [
        one
        for one in selection.ranked
        if len(chosen - set(one.causes)) == 1
        and len(set(one.causes) - chosen) == 1
        and set(one.causes) - chosen <= others
    ]
    candidates = [selection.chosen, *alternatives][:CANDIDATES]
    if len(candidates) < 2:
        candidates = list(selection.ranked[:CANDIDATES])
    settings = {" + ".join(name_of(key) for key in one.label) or "none": one.fit.values for one in candidates}
    if len(settings) < 2:
        return None
    return next_experiment(model.plant, settings, noise=noise, nominal=hypotheses.objective.nominal, present=model)


def _loads(plant: Plant, spring_possible: bool) -> list[Setting]:
    """Possible changes of the load: parameter -> by how much; -inf: removed."""
    if not spring_possible:
        return [{}]
    if plant[SPRING_STIFFNESS] == 0.0:
        return [{}, {SPRING_STIFFNESS: SPRING}]
    return [{}, {LOAD_SYMBOLS[word]: -inf for word in ("stiffness", "hardening", "preload")}]


def _screened(
    models: CandidateModels, loads: Sequence[Setting], time: np.ndarray, seed: int
) -> Iterator[ExperimentTrial]:
    """Every input with every load, over a short time; with the slow loop too where the stroke is the limit."""
    short = time[time <= SCREENING * (1.0 + 1e-9)]
    for change in loads:
        largest: dict[tuple[str, bool], tuple[float, str]] = {}
        for one in library_inputs(seed):
            for centre in (False, True):
                if (one.words, centre) not in largest:
                    begin = largest[one.words, False][0] if centre else FIRST
                    largest[one.words, centre] = models.largest_amplitude(
                        one, change, short, centre=centre, begin=begin
                    )
                amplitude, limit = largest[one.words, centre]
                if amplitude > 0.0:
                    trial = models.trial(one, one.share * amplitude, change, short, centre=centre)
                    if trial is not None:
                        yield trial
                if limit != "stroke":
                    break


def _best(models: CandidateModels, trials: Sequence[ExperimentTrial], time: np.ndarray) -> list[Compared]:
    """The best few with the distance of each pair (pairs,), over the whole time where the limits are kept that long."""
    if not trials:
        return []
    most = np.array([trial.outputs.largest_distances for trial in trials])
    alive = most.max(axis=0) >= LEAST
    if not alive.any():
        return []
    bound = most[:, alive].min(axis=1) * np.array([_effort(trial) for trial in trials])
    found: list[tuple[float, Compared]] = []
    for i in np.argsort(-bound)[:PROJECTED]:
        # A refit never increases a distance.
        if len(found) >= IN_FULL and bound[i] <= sorted(score for score, _ in found)[-IN_FULL]:
            break
        apart = models.distances(trials[i].outputs)
        found.append((_effort(trials[i]) * float(apart[alive].min()), (trials[i], apart)))
    ordered = [compared for _, compared in sorted(found, key=lambda f: -f[0])]
    full: list[Compared] = []
    for trial, _ in ordered[:ATTEMPTS]:
        longer = models.trial(trial.input, trial.amplitude, trial.outputs.change, time, centre=trial.centre)
        if longer is not None:
            full.append((longer, models.distances(longer.outputs)))
        if len(full) == IN_FULL:
            break
    return full or ordered


def _effort(trial: ExperimentTrial) -> float:
    """The factor of a distance where experiments are compared."""
    return EFFORT if trial.outputs.change else 1.0


def _what(trial: ExperimentTrial) -> str:
    """As "slow ramps through zero at 0.1 Hz of 1.2 A with a 50 kN/m spring"."""
    added = trial.outputs.change.get(SPRING_STIFFNESS, 0.0)
    load = f" with a {added / 1e3:g} kN/m spring" if added > 0.0 else " without the spring" if added else ""
    loop = ", the slow loop around the rod on" if trial.centre else ""
    return f"{trial.input.words} {trial.amplitude:.3g} A{load}{loop}"


def _words(
    trial: ExperimentTrial, distance: Mapping[Pair, float], now: Mapping[Pair, float], alike: Sequence[Pair]
) -> str:
    pair = min((p for p in distance if p not in alike), key=lambda p: distance[p])
    before = f" ({now[pair]:.2g} in this log)" if pair in now else ""
    words = (
        f"drive it for {trial.outputs.model.log.time[-1]:g} s with {_what(trial)}; {' and '.join(pair)} are then "
        f"{distance[pair]:.2g} standard deviations apart{before}"
    )
    if distance[pair] < ENOUGH:
        words += f", and it takes about {ceil((ENOUGH / distance[pair]) ** 2)} such logs to be sure"
    if alike:
        words += f"; {', '.join(' and '.join(p) for p in alike)} stay alike in every experiment that was tried"
    return words


def _command(plant: Plant, models: CandidateModels, trial: ExperimentTrial, seed: int) -> str:
    """The command for this experiment on the virtual bench, with the nominal plant."""
    shipped = plant.path is None or (plant.name in plants.titles() and plants.find(plant.name) == plant.path)
    line = ["ehsa-ctrl", "simulate", plant.name if shipped else str(plant.path), "--model", plant.model]
    if trial.input.excitation is not None:
        line += ["--excitation", trial.input.excitation, "--amplitude", f"{trial.amplitude:.6g}"]
        line += ["--duration", f"{trial.outputs.model.log.time[-1]:g}", "--seed", str(seed)]
    else:
        line += ["--input", FILE]
    if plant.path is not None:
        words = {symbol: f"load.{word}" for word, symbol in LOAD_SYMBOLS.items()}
        there = models.with_load(plant.values, trial.outputs.change)
        for name, parameter in load_plant(plant.path, model=plant.model).parameters.items():
            if there[name] != parameter.value:
                line += ["--set", f"{words.get(name, name)}={there[name]:.6g}"]
    return shlex.join([*line, *(["--centre"] if trial.centre else []), "--out", FOLDER])
