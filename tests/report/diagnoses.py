"""Diagnoses made by hand, one of each verdict: nothing is simulated."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

import ehsa_ctrl
from ehsa_ctrl.core.log import Log
from ehsa_ctrl.diagnosis.diagnosis import MODELS, Cause, CauseParameter, Diagnosis, RankedHypothesis
from ehsa_ctrl.diagnosis.gap_attribution import Location
from ehsa_ctrl.diagnosis.law.proposed import LawForm, ProposedLaw
from ehsa_ctrl.diagnosis.regimes import Regime
from ehsa_ctrl.diagnosis.unknown_inputs import UNITS
from ehsa_ctrl.physics.effects import LawFile

VERDICTS = ("no_gap", "effect", "pair", "ambiguous", "outside_catalogue", "law", "underdetermined")
#: A file's name that is no HTML.
AWKWARD = "log <script>alert(1).csv"
#: Samples, and the one from which a gap is five times as large.
SAMPLES, WORSE = 600, 360
TIME = 0.004 * np.arange(SAMPLES)
WAVES = {"current": 2.0, "speed": 100.0, "p1": 4e5, "p2": -4e5, "position": 5e-3}


def log():
    channels = {name: size * np.sin(3.0 * TIME) for name, size in WAVES.items()}
    channels["p1"] = channels["p1"] + 2e6
    channels["p2"] = channels["p2"] + 2e6
    return Log(TIME, channels, Path(AWKWARD))


def run_of(measured, size):
    """A run that is off by a share of each signal, more from WORSE on for half a second."""
    shape = size * np.sin(7.0 * TIME)
    shape[WORSE : WORSE + 125] *= 5.0
    return {name: values + abs(WAVES[name]) * shape for name, values in measured.channels.items() if name != "current"}


def location(place="flow"):
    bins = np.linspace(-200.0, 200.0, 9)
    others = [name for name in ("torque", "drive", "flow", "force", "sensor") if name != place]
    regimes = (
        Regime("flow_1", "the pressure difference", "Pa", 1e4 * bins, 1e-8 * bins, np.full(9, 3e-7), 0.93,
               "error of the flow into chamber 1 of 2e-06 m3/s along the pressure difference", 0.9,
               1 + np.arange(SAMPLES - 1) // 20 % 9),
        Regime("flow_1", "the shaft's speed", "rad/s", bins, 1e-8 * bins, np.full(9, 1e-6), 0.41,
               "error of the flow into chamber 1 of 1e-06 m3/s along the shaft's speed"),
        Regime("force", "the sign of the rod's speed", "", np.array([-1.0, 1.0]), np.array([-90.0, 90.0]),
               np.array([20.0, 20.0]), 0.7, "force error of 90 N with the sign of the rod's speed", -0.04),
        Regime("torque", "the size of the pressure difference, against the motion", "Pa", 1e4 * bins[4:],
               1e-4 * bins[4:], np.full(5, 0.2), 0.9, "torque error of 0.2 N m"),
    )  # fmt: skip
    return Location(
        shares=((place, 0.7), (others[0], 0.2), (others[1], 0.1), (others[2], 0.0), (others[3], 0.0)),
        time=TIME,
        unknown={name: np.where(TIME < 0.4, np.nan, np.sin(5.0 * TIME)) for name in UNITS},
        regimes=regimes,
        by_signal={name: {"gap": 0.2, place: 0.8} for name in ("speed", "p1", "p2", "rod_velocity")},
        explained=0.9,
        over_time=tuple((float(t), 0.3, 0.03) for t in range(3)),
        sensor="p1 with bias 4e+04",
        untold=("without force the load balance can't be evaluated",),
    )


def gaps(size):
    return {"speed": size, "p1": 1.5 * size, "p2": 1.4 * size, "rod_velocity": 0.0, "total": 1.2 * size}


LEAK = Cause(
    "internal_leakage",
    None,
    "flow",
    0.97,
    {"K_L": CauseParameter(4e-12, 3e-14, "m3/(Pa s)")},
    (),
    0.25,
    0.81,
    gaps(0.15),
)
FRICTION = Cause(
    "rod_viscous_friction", None, "force", 0.93, {"B_FR": CauseParameter(900.0, 40.0, "N s/m")},
    ("line_pressure_drop",), 0.25, 0.1, gaps(0.05),
    {"line_pressure_drop": "a laminar drop acts as viscous rod friction"},
)  # fmt: skip
BIAS = Cause(
    "sensor_bias", "p1", "sensor", 0.6, {"value": CauseParameter(5e4, 500.0, "Pa")}, ("sensor_scale",), 0.0, 0.5
)

PARAMETERS = {"c_1": {"value": 4e5, "unit": "N s3/m3", "neutral": 0.0, "sd": 2e4}}
CUBIC = ProposedLaw(
    "force", ("v",),
    (LawForm(LawFile.model_validate({
        "schema": 1, "status": "proposed", "summary": "cubic drag", "adds_to": "force", "expression": "c_1 * v**3",
        "parameters": PARAMETERS}), 0.8, 0.9),),
    {"v": (-0.1, 0.1)}, "m/s", 0.1 * np.sin(3.0 * TIME[1:]), 400.0 * np.sin(3.0 * TIME[1:]) ** 3,
    400.0 * np.sin(3.0 * TIME[1:]) ** 3, explained=0.9,
)  # fmt: skip


@cache
def diagnosis(verdict):
    """A diagnosis of one of VERDICTS."""
    measured = log()
    plant = ehsa_ctrl.load_plant("ehsa")
    causes = {
        "effect": (LEAK,),
        "pair": (LEAK, replace(FRICTION, ambiguous_with=())),
        "ambiguous": (FRICTION,),
        "underdetermined": (BIAS,),
        "law": (LEAK,),
    }.get(verdict, ())
    names = tuple(cause.name for cause in causes)
    candidates = (
        RankedHypothesis(names or ("entrained_air",), 0.0, 0.013),
        RankedHypothesis((*names, "unequal_areas"), 4.0, 0.012),
        RankedHypothesis(("line_pressure_drop",) if verdict == "ambiguous" else ("sensor_scale (p1)",), 12.3, 0.014),
        RankedHypothesis(("motor_friction", "position_dependent_friction", "rod_viscous_friction",
                  "sensor_scale (position)"), 2.2e5, 0.4),
        RankedHypothesis((), 5.5e5, float("inf")),
    )  # fmt: skip
    full = Diagnosis(
        plant=plant.set(K_T=1.1),
        log=measured,
        threshold=0.03,
        verdict={"pair": "effect", "law": "partly"}.get(verdict, verdict),
        where=(("flow", 0.8), ("force", 0.2), ("torque", 0.0)),
        effects=causes,
        gap={model: gaps(size) for model, size in zip(MODELS, (0.2, 0.12, 0.012, 0.01), strict=True)},
        whole=gaps(0.2),
        held_out=f"the last third of {AWKWARD}, from 1.6 s on",
        held_spans=((1.6, 2.4),),
        noise_sd={"speed": 0.5, "p1": 1.5e4, "position": 2e-5},
        values={},
        simulated={
            "nominal": run_of(measured, 0.2), "refit": run_of(measured, 0.1), "with_effects": run_of(measured, 0.01)
        },
        candidates=candidates,
        location=location(),
        next_experiment="Drive it slowly <against> a spring." if verdict == "underdetermined" else None,
        findings=("p1 stands <b>still</b> for 3 s",),
        seconds=12.3,
        runs=456,
        provenance={"numpy": np.__version__},
    )  # fmt: skip
    if verdict == "law":
        simulated = {**full.simulated, "with_law": run_of(measured, 0.002)}
        return replace(full, law=CUBIC, gap={**full.gap, "with_law": gaps(0.003)}, simulated=simulated)
    if verdict != "no_gap":
        return full
    small = {"nominal": run_of(measured, 0.001)}
    return replace(
        full, where=(), gap=dict.fromkeys(MODELS, gaps(0.01)), whole=gaps(0.01), simulated=small, candidates=(),
        location=None,
    )  # fmt: skip
