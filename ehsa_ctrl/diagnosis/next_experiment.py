"""What next: the experiment, within the plant's limits, that best tells the remaining candidates of a diagnosis apart.

A library of inputs is simulated with every candidate, with the load as it is and with a spring more or less; the one
whose nearest pair of candidates is furthest apart is proposed.

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
from ..core.text import TextResult
from ..plant.file import LOAD_SYMBOLS
from ..plant.load import load_plant
from ..plant.plant import Plant
from .fit import Nominal
from .probes import probes
from .rivals import FIRST, Pair, Rivals, Setting, Trial
from .twin import Twin

#: Nearer than this, in standard deviations, two candidates are alike; further apart than this, one log tells them.
LEAST, ENOUGH = 1.0, 5.0
#: Shortest experiment [s].
SHORTEST = 2.0
#: Inputs are compared over at most this time first [s]; so many of them with what a refit makes up; so many in full,
#: out of so many that may turn out not to keep the limits for the whole time.
SCREENING, PROJECTED, IN_FULL, ATTEMPTS = 6.0, 24, 2, 4
#: Stiffness of the spring that may be added [N/m].
SPRING = 50e3
#: Another load is work: it is worth that only where the same distance is reached with this share of it.
EFFORT = 0.8
#: Where the input is, if it is none of the command line's excitations, and where the log goes.
FILE, FOLDER = "next_experiment.csv", "results/next"

Told = tuple[Trial, np.ndarray]


@dataclass(frozen=True)
class Experiment(TextResult):
    """A proposed experiment and what to expect of it.

    Attributes
    ----------
    words: one sentence that can be carried out.
    command: the call of `ehsa-ctrl simulate` that makes this experiment on the virtual bench; where it names FILE,
        that is what `write` writes. See `command_in`.
    current: (N,) A, what to apply from rest, one value each sample_time [s]. amplitude: its peak [A].
    centre: whether the slow loop around the rod has to be on as well.
    load: words of the load that have to be changed, with their new values; empty for the load as it is.
    distance: pair of candidates -> how far apart they are then, in standard deviations of what noise and the model's
        tolerance leave; its square is the evidence, twice the log-likelihood, by which the wrong one falls behind.
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
    twin: Plant,
    hypotheses: Mapping[str, Setting],
    *,
    noise: Mapping[str, float],
    nominal: Nominal,
    spring_possible: bool = True,
    seconds: float = 24.0,
    seed: int = 0,
    present: Twin | None = None,
) -> Experiment | None:
    """The experiment that tells candidates apart best: that in which the nearest two are furthest apart.

    Parameters
    ----------
    twin: the plant with every effect, see `with_every_effect`, with the load that is there.
    hypotheses: name of a candidate -> its fitted symbols and sensor words as for `Twin.run`; at least two.
    noise: standard deviation of each measured channel's noise; what is not named is not measured.
    nominal: parameters that each candidate may still move, with their prior deviations.
    spring_possible: whether a spring may be added, or the one that is there removed.
    seconds: length of the experiment; it is shorter where a candidate keeps the limits for a short time alone.
    seed: of random inputs.
    present: the log that there is, to say how far apart the candidates are in it.

    Returns
    -------
    None where no two candidates can be told apart by any experiment of the library: they are the same in principle,
    or no input within the limits moves the plant.

    Raises
    ------
    InputError: fewer than two candidates, or an experiment that is too short.
    """
    if len(hypotheses) < 2:
        raise InputError(f"{len(hypotheses)} candidate(s); expected two or more that an experiment is to tell apart")
    if not SHORTEST <= seconds < inf:
        raise InputError(f"seconds = {seconds:g}; expected at least {SHORTEST:g} s")
    rivals = Rivals(twin, hypotheses, noise, nominal)
    time = twin.sample_time * np.arange(int(round(seconds / twin.sample_time)) + 1)
    told = _best(rivals, list(_screened(rivals, _loads(twin, spring_possible), time, seed)), time)
    # A pair that none of the best tells apart is not what the choice is about.
    apart = np.array([d for _, d in told]).reshape(len(told), len(rivals.pairs))
    alive = np.asarray((apart >= LEAST).any(axis=0))
    if not alive.any():
        return None
    trial, distances = max(told, key=lambda t: _effort(t[0]) * float(t[1][alive].min()))
    before = rivals.outputs(present, {}) if present is not None else None
    now = rivals.apart(before).tolist() if before is not None else []
    load = {word: rivals.loaded({}, trial.outputs.change).get(symbol) for word, symbol in LOAD_SYMBOLS.items()}
    distance = dict(zip(rivals.pairs, distances.tolist(), strict=True))
    alike = tuple(pair for pair, is_told in zip(rivals.pairs, alive.tolist(), strict=True) if not is_told)
    return Experiment(
        words=_words(trial, distance, dict(zip(rivals.pairs, now, strict=False)), alike),
        command=_command(twin, rivals, trial, seed),
        current=trial.probe.current(trial.outputs.twin.log.time, trial.amplitude),
        sample_time=twin.sample_time,
        amplitude=trial.amplitude,
        centre=trial.centre,
        load={word: v for word, v in load.items() if v is not None and v != twin[LOAD_SYMBOLS[word]]},
        distance=distance,
        now=dict(zip(rivals.pairs, now, strict=False)),
        alike=alike,
        tried={_what(t): float(d[alive].min()) for t, d in told},
    )


def _loads(plant: Plant, spring_possible: bool) -> list[Setting]:
    """What may be changed about the load: symbol -> by how much; -inf: removed."""
    if not spring_possible:
        return [{}]
    return [{}, {"K_S": SPRING} if plant["K_S"] == 0.0 else {"K_S": -inf, "k_3": -inf, "F_pre": -inf}]


def _screened(rivals: Rivals, loads: Sequence[Setting], time: np.ndarray, seed: int) -> Iterator[Trial]:
    """Every probe with every load, over a short time; with the slow loop as well where the stroke is what limits it."""
    short = time[time <= SCREENING * (1.0 + 1e-9)]
    for change in loads:
        largest: dict[tuple[str, bool], tuple[float, str]] = {}
        for probe in probes(seed):
            for centre in (False, True):
                if (probe.words, centre) not in largest:
                    begin = largest[probe.words, False][0] if centre else FIRST
                    largest[probe.words, centre] = rivals.largest(probe, change, short, centre=centre, begin=begin)
                amplitude, limit = largest[probe.words, centre]
                if amplitude > 0.0:
                    trial = rivals.trial(probe, probe.share * amplitude, change, short, centre=centre)
                    if trial is not None:
                        yield trial
                if limit != "stroke":
                    break


def _best(rivals: Rivals, trials: Sequence[Trial], time: np.ndarray) -> list[Told]:
    """The best few with the distance of each pair (pairs,), over the whole time where the limits are kept so long."""
    if not trials:
        return []
    most = np.array([trial.outputs.most for trial in trials])
    alive = most.max(axis=0) >= LEAST
    if not alive.any():
        return []
    bound = most[:, alive].min(axis=1) * np.array([_effort(trial) for trial in trials])
    found: list[tuple[float, Told]] = []
    for i in np.argsort(-bound)[:PROJECTED]:
        # Nothing that a refit makes up brings candidates further apart.
        if len(found) >= IN_FULL and bound[i] <= sorted(score for score, _ in found)[-IN_FULL]:
            break
        apart = rivals.apart(trials[i].outputs)
        found.append((_effort(trials[i]) * float(apart[alive].min()), (trials[i], apart)))
    ordered = [told for _, told in sorted(found, key=lambda f: -f[0])]
    full: list[Told] = []
    for trial, _ in ordered[:ATTEMPTS]:
        longer = rivals.trial(trial.probe, trial.amplitude, trial.outputs.change, time, centre=trial.centre)
        if longer is not None:
            full.append((longer, rivals.apart(longer.outputs)))
        if len(full) == IN_FULL:
            break
    return full or ordered


def _effort(trial: Trial) -> float:
    """What a distance is multiplied by where experiments are compared."""
    return EFFORT if trial.outputs.change else 1.0


def _what(trial: Trial) -> str:
    """As "slow ramps through zero at 0.1 Hz of 1.2 A with a 50 kN/m spring"."""
    added = trial.outputs.change.get("K_S", 0.0)
    load = f" with a {added / 1e3:g} kN/m spring" if added > 0.0 else " without the spring" if added else ""
    loop = ", the slow loop around the rod on" if trial.centre else ""
    return f"{trial.probe.words} {trial.amplitude:.3g} A{load}{loop}"


def _words(trial: Trial, distance: Mapping[Pair, float], now: Mapping[Pair, float], alike: Sequence[Pair]) -> str:
    pair = min((p for p in distance if p not in alike), key=lambda p: distance[p])
    before = f" ({now[pair]:.2g} in this log)" if pair in now else ""
    words = (
        f"drive it for {trial.outputs.twin.log.time[-1]:g} s with {_what(trial)}; {' and '.join(pair)} are then "
        f"{distance[pair]:.2g} standard deviations apart{before}"
    )
    if distance[pair] < ENOUGH:
        words += f", and it takes about {ceil((ENOUGH / distance[pair]) ** 2)} such logs to be sure"
    if alike:
        words += f"; {', '.join(' and '.join(p) for p in alike)} stay alike in every experiment that was tried"
    return words


def _command(plant: Plant, rivals: Rivals, trial: Trial, seed: int) -> str:
    """What makes this experiment on the virtual bench, with the plant as it is believed."""
    shipped = plant.path is None or (plant.name in plants.titles() and plants.find(plant.name) == plant.path)
    line = ["ehsa-ctrl", "simulate", plant.name if shipped else str(plant.path), "--model", plant.model]
    if trial.probe.excitation is not None:
        line += ["--excitation", trial.probe.excitation, "--amplitude", f"{trial.amplitude:.6g}"]
        line += ["--duration", f"{trial.outputs.twin.log.time[-1]:g}", "--seed", str(seed)]
    else:
        line += ["--input", FILE]
    if plant.path is not None:
        words = {symbol: f"load.{word}" for word, symbol in LOAD_SYMBOLS.items()}
        there = rivals.loaded(plant.values, trial.outputs.change)
        for name, parameter in load_plant(plant.path, model=plant.model).parameters.items():
            if there[name] != parameter.value:
                line += ["--set", f"{words.get(name, name)}={there[name]:.6g}"]
    return shlex.join([*line, *(["--centre"] if trial.centre else []), "--out", FOLDER])
