"""Bench logs that several tests of the identification use."""

import pickle

import numpy as np
import pytest
from filelock import FileLock

import ehsa_ctrl


def bench_log(plant, kind, amplitude, duration, seed):
    """A log of the virtual bench with the rod kept in its stroke."""
    time, current = ehsa_ctrl.excitation(kind, amplitude=amplitude, duration=duration, sample_time=0.004, seed=seed)
    return ehsa_ctrl.record(plant, time, current, centre=True, seed=seed)[0]


def thirty_percent_off(plant, seed):
    """The plant with each free parameter 0.7 or 1.3 times what it is."""
    signs = np.random.default_rng(seed).random(len(plant.free)) > 0.5
    return plant.set(**{n: plant[n] * (1.3 if up else 0.7) for n, up in zip(plant.free, signs, strict=True)})


@pytest.fixture(scope="session")
def truth():
    return ehsa_ctrl.load_plant("ehsa")


@pytest.fixture(scope="session")
def noise_log(truth):
    """10 s of noise, as in the paper's estimation."""
    return bench_log(truth, "noise", 3.0, 10.0, 1)


@pytest.fixture(scope="session")
def steps_log(truth):
    return bench_log(truth, "steps", 1.5, 5.0, 2)


@pytest.fixture(scope="session")
def once(tmp_path_factory, worker_id):
    """once(name, make): what make() gives, made by the first of all workers that asks and kept for this session."""
    folder = tmp_path_factory.getbasetemp()
    # Workers of one session have neighbouring folders.
    folder = folder if worker_id == "master" else folder.parent

    def get(name, make):
        file = folder / f"{name}.pickle"
        with FileLock(f"{file}.lock"):
            if not file.exists():
                file.write_bytes(pickle.dumps(make()))
        return pickle.loads(file.read_bytes())

    return get


@pytest.fixture(scope="session")
def found(truth, noise_log, steps_log, once):
    """The nonlinear plant identified from the noise, 30 % off at the start, the steps held out."""
    return once("found", lambda: ehsa_ctrl.identify(thirty_percent_off(truth, 1), noise_log, validate=[steps_log]))


@pytest.fixture(scope="session")
def from_truth(truth, noise_log, once):
    """The same log identified with the true values to begin with."""
    return once("from_truth", lambda: ehsa_ctrl.identify(truth, noise_log, starts=3))
