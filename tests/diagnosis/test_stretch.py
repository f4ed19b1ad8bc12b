"""The stretch in which effects are searched: short data as a whole, long data where they move and have a gap."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.hypothesis_model import HypothesisModel
from ehsa_ctrl.diagnosis.records import Record, Segment
from ehsa_ctrl.diagnosis.stretch import LONG, SEARCHED, SHORTEST_STRETCH, search_segment

SAMPLE_TIME = 0.02
NOISE = {"speed": 0.5, "p1": 1.5e4, "p2": 1.5e4, "position": 2e-5}


@pytest.fixture(scope="module")
def plant():
    return ehsa_ctrl.load_plant("ehsa")


def training(plant, seconds, moves):
    """A segment of one log that moves from `moves[0]` to `moves[1]` s; the simulation has no current to follow."""
    time = np.arange(0.0, seconds, SAMPLE_TIME)
    wave = np.sin(0.7 * time) * ((time >= moves[0]) & (time < moves[1]))
    random = np.random.default_rng(0)
    motion = {"speed": 100.0 * wave, "p1": 2e6 + 1e6 * wave, "p2": 2e6 - 1e6 * wave, "position": 0.02 * wave}
    channels = {name: values + NOISE[name] * random.standard_normal(time.size) for name, values in motion.items()}
    model = HypothesisModel(plant, Log(time, {"current": np.zeros(time.size), **channels}))
    return Segment((Record(model, NOISE),), "the training data")


def test_short_data_are_searched_as_a_whole(plant):
    whole = training(plant, 0.9 * LONG, (0.0, LONG))

    assert search_segment([plant], whole) is whole


@pytest.mark.parametrize("moves", [(20.0, 90.0), (180.0, 250.0)])
def test_long_data_are_searched_where_they_move(plant, moves):
    """The stretch is scored for SEARCHED seconds, and lies in the only part that moves."""
    whole = training(plant, 3.0 * LONG, moves)

    (record,) = search_segment([plant], whole).records

    times = record.take(record.model.log.time)
    assert times[-1] - times[0] == pytest.approx(SEARCHED, abs=2 * SAMPLE_TIME)
    assert moves[0] - 5.0 < times[0] and times[-1] < moves[1] + 5.0


def test_several_long_logs_share_the_time(plant):
    whole = training(plant, 2.0 * LONG, (0.0, 2.0 * LONG))
    together = Segment(3 * whole.records, "the training data")

    found = search_segment(3 * [plant], together)

    seconds = [sum(record.lengths) * SAMPLE_TIME for record in found.records]
    assert seconds == pytest.approx(3 * [SEARCHED / 3], abs=2 * SAMPLE_TIME)


def test_many_short_logs_are_searched_as_a_whole(plant):
    """They are long together only; a stretch of each would be no shorter."""
    short = training(plant, 0.9 * SHORTEST_STRETCH, (0.0, SHORTEST_STRETCH))
    count = int(1.5 * LONG / SHORTEST_STRETCH)
    together = Segment(count * short.records, "the training data")

    assert search_segment(count * [plant], together) is together


def test_data_whose_state_the_log_does_not_show_are_cut_at_the_beginning_of_a_log_alone(plant):
    """After other data, each run begins with the log in any case."""
    (record,) = training(plant, 3.0 * LONG, (0.0, 3.0 * LONG)).records
    log = record.model.log
    model = replace(record.model, log=replace(log, channels={n: y for n, y in log.channels.items() if n != "p1"}))
    whole = Segment((replace(record, model=model),), "the training data")
    later = Segment((replace(record, model=model, parts=(slice(len(log) // 2, len(log)),)),), "held-out data")

    (found,) = search_segment([plant], whole).records

    times = found.take(found.model.log.time)
    assert times[0] == 0.0 and times[-1] == pytest.approx(SEARCHED, abs=2 * SAMPLE_TIME)
    assert search_segment([plant], later) is later
