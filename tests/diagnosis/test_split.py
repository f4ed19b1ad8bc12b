"""The part of a log that is held out: it moves, and so does the rest."""

from types import SimpleNamespace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel
from ehsa_ctrl.diagnosis.prepared_logs import one_sided_gap
from ehsa_ctrl.diagnosis.records import Record
from ehsa_ctrl.diagnosis.signals import estimate_noise, moving_signals
from ehsa_ctrl.diagnosis.split import EXCITED, choose_split, excitation, splits
from ehsa_ctrl.identification.plant_log import read_plant_log
from ehsa_ctrl.identification.preparation import Preparation

SAMPLES = 3000
TIME = 0.004 * np.arange(SAMPLES)
NOISE = {"speed": 0.5, "p1": 1.5e4, "p2": 1.5e4, "position": 2e-5}


@pytest.fixture(scope="module")
def plant():
    return ehsa_ctrl.load_plant("ehsa")


@pytest.fixture
def record_of(plant):
    """Function from an envelope of the motion (N,) to a record with that motion and noise."""

    def build(envelope):
        random, wave = np.random.default_rng(0), np.sin(6.0 * TIME) * envelope
        motion = {"speed": 100.0 * wave, "p1": 1e6 * wave, "p2": -1e6 * wave, "position": 0.02 * wave}
        channels = {name: values + NOISE[name] * random.standard_normal(SAMPLES) for name, values in motion.items()}
        return Record(HypothesisModel(plant, Log(TIME, {"current": wave, **channels})), NOISE)

    return build


@pytest.mark.parametrize("split", splits(SAMPLES + 1), ids=lambda split: split.name)
def test_every_sample_is_fitted_or_held_out(split):
    """Each of them once; a third is held out."""
    samples = np.arange(SAMPLES + 1)
    training, held_out = (np.concatenate([samples[part] for part in p]) for p in (split.training, split.held_out))

    assert sorted([*training, *held_out]) == samples.tolist()
    assert held_out.size == pytest.approx(SAMPLES / 3, abs=3)


def test_the_last_third_is_held_out_of_a_log_that_moves_throughout(record_of):
    assert choose_split(record_of(np.ones(SAMPLES)), 0.03).name == "the last third"


@pytest.mark.parametrize(
    ("resting", "expected"),
    [([2], "the first third"), ([0, 2], "every third ninth"), ([1, 2], "every third ninth"), ([0], "the last third")],
)
def test_a_part_that_rests_is_not_held_out(record_of, resting, expected):
    """Nor is the only third that moves: then there would be nothing to fit."""
    envelope = np.ones(SAMPLES)
    for third in resting:
        envelope[SAMPLES * third // 3 : SAMPLES * (third + 1) // 3] = 0.0

    assert choose_split(record_of(envelope), 0.03).name == expected


def test_both_parts_have_the_gap_where_a_split_allows_it(record_of):
    """A valve that opens in the last ninths only: no third will do, every third ninth does."""
    record = record_of(np.ones(SAMPLES))
    first = SAMPLES * 7 // 9

    def gaps(split):
        inside = [
            sum(len(range(max(p.start, first), p.stop)) for p in parts) for parts in (split.training, split.held_out)
        ]
        return tuple(0.1 if count else 0.0 for count in inside)

    assert choose_split(record, 0.03, gaps).name == "every third ninth"


def test_what_has_the_gap_is_fitted_if_no_split_has_it_on_both_sides(record_of):
    """An instant in the last third: then the first third is held out."""
    record = record_of(np.ones(SAMPLES))

    def gaps(split):
        def has(parts):
            return any(p.start <= SAMPLES - 1 < p.stop for p in parts)

        return tuple(0.1 if has(parts) else 0.0 for parts in (split.training, split.held_out))

    assert choose_split(record, 0.03, gaps).name == "the first third"


def test_a_signal_that_stands_still_has_no_gap():
    """Neither a constant, whose standard deviation is rounding, nor one that shows its noise alone."""
    random = np.random.default_rng(0)
    signals = {
        "constant": np.full(1000, 0.1),
        "noise": 0.99 * random.standard_normal(1000),
        "declared": random.standard_normal(1000),
        "moving": 3.0 * np.sin(TIME[:1000]),
    }

    found = moving_signals(signals, {"noise": 1.0, "moving": 1.0}, {"declared": 1.5})

    assert found == {"moving"}


@pytest.mark.parametrize(
    ("training", "held_out", "splits", "words"),
    [
        (0.12, 0.001, (), "lies in the training data alone (12 %, 0.1 % in the held-out data), so that what was"),
        (0.001, 0.12, (), "lies in the held-out data alone (12 %, 0.1 % in the training data), so that nothing could"),
        (0.12, 0.001, None, "could not be validated: the logs are of different rigs or states"),
        (0.12, 0.02, (), ""),
        (0.02, 0.02, (), ""),
    ],
)
def test_a_gap_that_lies_in_one_part_alone_is_said_to(training, held_out, splits, words):
    """One below half of the threshold, the other above it."""
    segments = SimpleNamespace(
        splits=splits,
        training=SimpleNamespace(gap=lambda _: {"p1": training, "total": training}),
        held_out=SimpleNamespace(gap=lambda _: {"p1": held_out, "total": held_out}),
    )

    found = one_sided_gap(segments, 0.03)

    assert len(found) == bool(words)
    assert all(words in sentence for sentence in found)


def test_servo_records_that_end_at_rest_are_split_where_they_move(shared_logs):
    """Each record of the published servo moves in both parts, also those whose last third is a standstill."""
    plant = ehsa_ctrl.load_plant("xl330_pendulum")
    names = {}
    for path in sorted((shared_logs.parents[1] / "data" / "bam").glob("*.csv")):
        log, _ = Preparation(resample=200.0).apply(read_plant_log(path, plant, uniform=False), plant)
        record = Record(HypothesisModel(plant, log), estimate_noise(log))
        split = choose_split(record, 0.03)
        names[path.stem] = split.name
        assert excitation(record, split) >= EXCITED, path.stem

    resting = {name: words for name, words in names.items() if "lift" in name or "up_and" in name}
    assert resting
    assert "the last third" not in resting.values()


def test_the_words_name_part_and_time(record_of):
    log = record_of(np.ones(SAMPLES)).model.log
    last, first, _, blocks = splits(SAMPLES)

    assert last.words(log) == "the last third of the log, from 8 s on"
    assert first.words(log) == "the first third of the log, from 0 to 3.996 s"
    assert blocks.words(log).count(" to ") == 3
    assert last.spans(log) == ((8.0, 11.996),)
