"""The next experiment: the input, within the plant's limits, that best separates the candidates of a diagnosis.

A library of inputs is simulated with every candidate, with the present load and with a spring added or removed. The
input with the largest minimum distance between two candidates is proposed.

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
from .model_discrimination import SPRING_STIFFNESS, CandidateModels, ExperimentTrial, Pair
from .model_selection import Selection
from .objective import NominalParameters
from .verdict_text import name_of

# The numbers below are engineering judgement.

#: Distances in standard deviations: below the first, two candidates are indistinguishable; above the second, a single
#: log separates them.
MIN_DISTANCE, SURE_DISTANCE = 1.0, 5.0
#: Shortest experiment [s].
SHORTEST = 2.0
#: Longest time of the screening [s]; number of inputs compared after a refit; number compared over the full time, and
#: tried for this, because some exceed a limit later.
SCREENING, N_COMPARED, N_FULL, N_ATTEMPTS = 6.0, 24, 2, 4
#: Stiffness of the spring that may be added [N/m]: that of the shipped spring scenarios.
SPRING = 50e3
#: Factor on the distances of an experiment that needs another load, which is more work.
LOAD_CHANGE_FACTOR = 0.8
#: Largest number of candidates to separate.
N_CANDIDATES = 4
#: File of an input that is no excitation of the command line, and folder of its log.
FILE, FOLDER = "next_experiment.csv", "results/next"

#: A trial, and the distance of each pair of candidates (pairs,).
ComparedTrial = tuple[ExperimentTrial, np.ndarray]


@dataclass(frozen=True)
class NextExperiment(Result):
    """A proposed experiment and its predicted result.

    Attributes
    ----------
    words: the experiment in one sentence.
    command: `ehsa-ctrl simulate` command that runs it on the virtual bench; FILE in it is written by `write`.
    current: (N,) A, or another drive, applied from rest, one value per sample_time [s]. amplitude: its peak.
    drive: its channel. centre: whether the slow loop that centres the rod is on.
    load: load keys to change -> new values, SI units; empty for the present load.
    distance: pair of candidates -> predicted distance in standard deviations of noise and assumed model error. Its
        square is the expected difference of their deviances.
    now: the same in the present log; empty without one.
    alike: pairs that no experiment of the library separates.
    tried: experiments compared over the full length, in words -> smallest distance of a pair.
    """

    words: str
    command: str
    current: np.ndarray = field(repr=False)
    sample_time: float
    amplitude: float
    drive: str
    centre: bool
    load: Mapping[str, float]
    distance: Mapping[Pair, float]
    now: Mapping[Pair, float]
    alike: tuple[Pair, ...]
    tried: Mapping[str, float]

    @property
    def worst(self) -> float:
        """Smallest distance of the pairs that can be separated."""
        return min(d for pair, d in self.distance.items() if pair not in self.alike)

    def write(self, path: str | Path) -> Path:
        """Write columns t and current (or another drive) for `ehsa-ctrl simulate --input`, replacing such a file."""
        import pandas

        time = self.sample_time * np.arange(self.current.size)
        table = pandas.DataFrame({"t": time.round(6), self.drive: self.current.round(6)})
        return write_text(path, table.to_csv(index=False))

    def command_in(self, folder: str | Path) -> str:
        """The command with FILE, and the folder of the log, in a folder."""
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
    present: Sequence[HypothesisModel] = (),
) -> NextExperiment | None:
    """The experiment that best separates the candidates: it maximises their smallest distance.

    Parameters
    ----------
    plant: with every effect, see `with_every_effect`, and with the present load.
    hypotheses: name of a candidate -> its fitted values, see `HypothesisModel.run`; at least two.
    noise: measured channel -> standard deviation of its noise, SI units.
    nominal: parameters that each candidate may refit, with their prior deviations.
    spring_possible: whether a spring may be added, or the present one removed.
    seconds: length of the experiment [s]; shorter if a candidate exceeds a limit later.
    seed: of random inputs.
    present: models with the present logs, for the distances in them.

    Returns
    -------
    None if no experiment of the library separates any two candidates: they are equivalent, or no input within the
    limits moves the plant.

    Raises
    ------
    InputError: fewer than two candidates, or an experiment shorter than SHORTEST.
    """
    if len(hypotheses) < 2:
        raise InputError(f"{len(hypotheses)} candidate(s); expected at least two to separate")
    if not SHORTEST <= seconds < inf:
        raise InputError(f"seconds = {seconds:g}; expected at least {SHORTEST:g} s")
    models = CandidateModels.of(plant, hypotheses, noise, nominal, [one.log for one in present])
    time = plant.sample_time * np.arange(int(round(seconds / plant.sample_time)) + 1)
    compared = _compare_best(models, list(_screen(models, _loads(plant, spring_possible), time, seed)), time)
    # Pairs that no experiment separates do not influence the choice.
    apart = np.array([d for _, d in compared]).reshape(len(compared), len(models.pairs))
    separable = np.asarray((apart >= MIN_DISTANCE).any(axis=0))
    if not separable.any():
        return None
    trial, distances = max(compared, key=lambda t: _load_factor(t[0]) * float(t[1][separable].min()))
    before = [outputs for one in present if (outputs := models.outputs(one, {})) is not None]
    # Of several logs: each refitted by itself, so that together they separate at least as far.
    now = np.sqrt(np.sum([models.distances(one) ** 2 for one in before], axis=0)).tolist() if before else []
    load = {word: models.with_load({}, trial.outputs.change).get(symbol) for word, symbol in LOAD_SYMBOLS.items()}
    distance = dict(zip(models.pairs, distances.tolist(), strict=True))
    alike = tuple(pair for pair, apart in zip(models.pairs, separable.tolist(), strict=True) if not apart)
    return NextExperiment(
        words=_describe(trial, distance, dict(zip(models.pairs, now, strict=False)), alike),
        command=_command(plant, models, trial, seed),
        current=trial.input.current(trial.outputs.model.log.time, trial.amplitude),
        sample_time=plant.sample_time,
        amplitude=trial.amplitude,
        drive=plant.structure.system.drive,
        centre=trial.centre,
        load={word: v for word, v in load.items() if v is not None and v != plant[LOAD_SYMBOLS[word]]},
        distance=distance,
        now=dict(zip(models.pairs, now, strict=False)),
        alike=alike,
        tried={_describe_input(t): float(d[separable].min()) for t, d in compared},
    )


def deciding_experiment(
    selection: Selection, hypotheses: Hypotheses, noise: Mapping[str, float]
) -> NextExperiment | None:
    """The experiment that separates the chosen hypothesis from its alternatives; None if there are none."""
    model = hypotheses.objective.model
    if selection.verdict not in ("ambiguous", "underdetermined") or model.plant.structure.system.prescribed:
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
    candidates = [selection.chosen, *alternatives][:N_CANDIDATES]
    if len(candidates) < 2:
        candidates = list(selection.ranked[:N_CANDIDATES])
    settings = {" + ".join(name_of(key) for key in one.label) or "none": one.fit.values for one in candidates}
    if len(settings) < 2:
        return None
    present = [record.model for record in hypotheses.objective.records]
    return next_experiment(model.plant, settings, noise=noise, nominal=hypotheses.objective.nominal, present=present)


def _loads(plant: Plant, spring_possible: bool) -> list[Setting]:
    """Possible changes of the load: parameter -> change, -inf for a parameter that becomes zero."""
    if not spring_possible or SPRING_STIFFNESS not in plant.parameters:
        return [{}]
    if plant[SPRING_STIFFNESS] == 0.0:
        return [{}, {SPRING_STIFFNESS: SPRING}]
    return [{}, {LOAD_SYMBOLS[word]: -inf for word in ("stiffness", "hardening", "preload")}]


def _screen(
    models: CandidateModels, loads: Sequence[Setting], time: np.ndarray, seed: int
) -> Iterator[ExperimentTrial]:
    """Every input with every load over a short time; also with the centring loop if the stroke is the limit."""
    short = time[time <= SCREENING * (1.0 + 1e-9)]
    for change in loads:
        largest: dict[tuple[str, bool], tuple[float, str]] = {}
        for one in library_inputs(seed):
            for centre in (False, True):
                if (one.words, centre) not in largest:
                    begin = largest[one.words, False][0] if centre else models.first_amplitude
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


def _compare_best(models: CandidateModels, trials: Sequence[ExperimentTrial], time: np.ndarray) -> list[ComparedTrial]:
    """The best trials with their distances; over the full time if they keep the limits that long."""
    if not trials:
        return []
    most = np.array([trial.outputs.largest_distances for trial in trials])
    separable = most.max(axis=0) >= MIN_DISTANCE
    if not separable.any():
        return []
    bound = most[:, separable].min(axis=1) * np.array([_load_factor(trial) for trial in trials])
    found: list[tuple[float, ComparedTrial]] = []
    for i in np.argsort(-bound)[:N_COMPARED]:
        # A refit never increases a distance.
        if len(found) >= N_FULL and bound[i] <= sorted(score for score, _ in found)[-N_FULL]:
            break
        apart = models.distances(trials[i].outputs)
        found.append((_load_factor(trials[i]) * float(apart[separable].min()), (trials[i], apart)))
    ordered = [compared for _, compared in sorted(found, key=lambda f: -f[0])]
    full: list[ComparedTrial] = []
    for trial, _ in ordered[:N_ATTEMPTS]:
        longer = models.trial(trial.input, trial.amplitude, trial.outputs.change, time, centre=trial.centre)
        if longer is not None:
            full.append((longer, models.distances(longer.outputs)))
        if len(full) == N_FULL:
            break
    return full or ordered


def _load_factor(trial: ExperimentTrial) -> float:
    """The factor by which distances of a trial count in comparisons."""
    return LOAD_CHANGE_FACTOR if trial.outputs.change else 1.0


def _describe_input(trial: ExperimentTrial) -> str:
    """For example "a slow triangle wave (0.1 Hz) of 1.2 A with a 50 kN/m spring"."""
    added = trial.outputs.change.get(SPRING_STIFFNESS, 0.0)
    load = f" with a {added / 1e3:g} kN/m spring" if added > 0.0 else " without the spring" if added else ""
    loop = ", with the loop that centres the rod" if trial.centre else ""
    unit = trial.outputs.model.plant.structure.system.drive_unit
    return f"{trial.input.words} {trial.amplitude:.3g} {unit}{load}{loop}"


def _describe(
    trial: ExperimentTrial, distance: Mapping[Pair, float], now: Mapping[Pair, float], alike: Sequence[Pair]
) -> str:
    pair = min((p for p in distance if p not in alike), key=lambda p: distance[p])
    before = f" ({now[pair]:.2g} in this log)" if pair in now else ""
    words = (
        f"drive the rig for {trial.outputs.model.log.time[-1]:g} s with {_describe_input(trial)}; predicted distance "
        f"of {' and '.join(pair)}: {distance[pair]:.2g} standard deviations{before}"
    )
    if distance[pair] < SURE_DISTANCE:
        words += f", so that about {ceil((SURE_DISTANCE / distance[pair]) ** 2)} such logs are needed"
    if alike:
        words += f"; no experiment that was tried separates {', '.join(' and '.join(p) for p in alike)}"
    return words


def _command(plant: Plant, models: CandidateModels, trial: ExperimentTrial, seed: int) -> str:
    """The command that runs this experiment on the virtual bench with the nominal plant."""
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
