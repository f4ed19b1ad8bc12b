"""Several nominal parameters that are off at once, on a log of a rig whose parameters are known."""

from dataclasses import replace

import numpy as np
import pytest

import ehsa_ctrl
from ehsa_ctrl.diagnosis.objective import objective_of
from ehsa_ctrl.diagnosis.prepared_logs import prepare_logs, split_logs
from ehsa_ctrl.diagnosis.records import Record, Segment
from ehsa_ctrl.diagnosis.refit import refit
from ehsa_ctrl.diagnosis.several_parameters import starts_from_balances

PLANT = ehsa_ctrl.load_plant("ehsa")
OFF = {"K_T": 1.12, "A_FM": 1.13, "J_M": 0.77, "C_FM": 0.88}
RIG = PLANT.set(**{name: factor * PLANT[name] for name, factor in OFF.items()})


def training_data(current, seed):
    """Of a log of the rig, and what a refit minimises on it, with nominal parameters as uncertain as on a rig."""
    time = np.arange(current.size) * 0.004
    log, _ = ehsa_ctrl.record(RIG, time, current, seed=seed, centre=True)
    prepared = prepare_logs(PLANT, [log], None, 0.03, check=True)
    training = split_logs(prepared, Segment((prepared.logs[0].record,), log.name), has_gap=True).training
    objective, _ = objective_of(training, 0.03)
    return training, replace(objective, nominal=replace(objective.nominal, sd=objective.nominal.typical))


def moves_and_pauses(seed):
    """Current (3000,) [A]: moves to and fro, with pauses of 0.3 s at rest after some."""
    random = np.random.default_rng(seed)
    current, begin, sign = np.zeros(3000), 50, 1.0
    while begin < current.size:
        length, size = int(random.uniform(0.15, 0.6) / 0.004), random.uniform(1.0, 3.5)
        current[begin : begin + length] = sign * size
        begin, sign = begin + length + int(random.choice([0, 75])), -sign
    return current


def test_the_balances_show_the_wrong_parameters():
    _, current = ehsa_ctrl.excitation("steps", amplitude=3, duration=9, seed=3)
    training, objective = training_data(current, seed=3)
    nominal = objective.nominal

    estimated, weighted = starts_from_balances([PLANT], training.records, nominal)

    for name in ("K_T", "A_FM", "J_M"):
        assert estimated[name] / PLANT[name] == pytest.approx(OFF[name], abs=0.02)
    for name, value in estimated.items():
        assert abs(weighted[name] - PLANT[name]) <= abs(value - PLANT[name])


def test_their_estimate_leads_past_a_local_minimum():
    """In this log a refit from the nominal values ends in a minimum that is half as high again as the lowest."""
    training, objective = training_data(moves_and_pauses(7), seed=7)
    starts = [{}, *starts_from_balances([PLANT], training.records, objective.nominal)]

    from_nominal, estimated, weighted = (refit(objective, (), s, {}, steps=6, renew_after=3).cost for s in starts)

    assert max(estimated, weighted) < 0.85 * from_nominal


def test_a_log_without_the_signals_of_a_balance_gives_no_start():
    training, objective = training_data(moves_and_pauses(7), seed=7)
    (record,) = training.records
    log = record.model.log
    alone = replace(log, channels={"current": log["current"]})

    assert starts_from_balances([PLANT], [Record(replace(record.model, log=alone), {})], objective.nominal) == []
