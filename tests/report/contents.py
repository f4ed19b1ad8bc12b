"""The JSON of each kind of result, as commands leave it."""

from ehsa_ctrl.diagnosis.batch import LogBatch, Row
from ehsa_ctrl.fleet.result import Drift, Fleet, FleetParameter, FleetRig, FurtherChange, LogLine, RigDiagnosis

from .diagnoses import diagnosis

PROVENANCE = {"python": "3.11", "ehsa_ctrl": "0.1.0"}
AWKWARD = "rig <script>alert(1)</script>"
LOOP = {
    "controller": AWKWARD, "crossover": 35.0, "phase_margin": 60.0, "gain_margin": 5.8, "delay_margin": 0.03, "Ms": 1.4,
    "Mt": 1.1, "disk_margin": None, "stable": True, "current_noise": 0.09,
}  # fmt: skip


def fleet():
    """Three rigs: one that changed twice, one unlike the others, one that is neither."""
    day = "2026-01-05T00:00:00+00:00"
    line = LogLine(f"{AWKWARD}/a.csv", f"../{AWKWARD}/a.csv", day, "name", (3.0, 0.9))
    found = RigDiagnosis(line.file, "effect", (("internal_leakage",),), 0.98, 0.2, 0.01, "diagnoses/rig")
    later = FurtherChange(
        "torque_constant", (), "2026-01-19T00:00:00+00:00", day, day, line.file,
        {"K_T": {"change": -0.1, "sd": 0.01, "unit": "N m/A"}}, 1e-5,
    )  # fmt: skip
    rigs = (
        FleetRig(AWKWARD, (line, line), True, "step", "internal_leakage", ("orifice_leakage",), "diagnosis",
                 "internal_leakage", day, day, day, line.file,
                 {"K_L": {"change": 3e-12, "sd": 1e-13, "unit": "m3/(Pa s)"}}, (later,), 1e-6, 3e-6, diagnosis=found,
                 series={"K_T": [(0.01, 0.02), (float("nan"), float("inf"))]}),
        FleetRig("rig 2", (line,), unlike="torque_constant", unlike_p=1e-4, unlike_q=1e-3),
        FleetRig("rig 3", (line,)),
    )  # fmt: skip
    parameters = (
        FleetParameter("K_T", "N m/A", 1.2, 1.21, 0.01, 0.04, 2.5),
        FleetParameter("V_10", "m3", 2e-3, 2e-3, 1e-4, None, 0.1),
    )
    drifts = (Drift(AWKWARD, "K_T", "N m/A", -1e-4, 1e-5, 1e-6, 1e-4, day),)
    return Fleet(
        "ehsa", 0.05, rigs, parameters, drifts, ("internal_leakage",), {"x.csv": "x.csv: is too short"}, ("a note",)
    )


def contents(gentle, harsh, fitting):
    """The JSON of each kind: of real results where these are at hand, else what the command's own test checks."""
    found = diagnosis("ambiguous")
    fitted = {**fitting.to_dict(), "model": "nonlinear", "plant": "ehsa", "settings": {}}
    rows = (
        Row.of("logs/a.csv", found),
        Row.of("logs/b.csv", diagnosis("no_gap")),
        Row("logs/c.csv", error="too short"),
    )
    return {
        "results.json": {"scenarios": [gentle.to_dict(), harsh.to_dict()]},
        "identification.json": fitted,
        "diagnosis.json": found.to_dict(),
        "summary.json": LogBatch("ehsa", 0.03, rows).to_dict(),
        "fleet.json": fleet().to_dict(),
        "comparison.json": {
            "plant": "ehsa", "log": f"{AWKWARD}.csv", "settings": {}, "from": 0.0, "to": 4.0, "provenance": PROVENANCE,
            "models": {"linear": {"fit_percent": {"speed": -36.6, "p1": 63.6}, "stopped": ""},
                       "nonlinear": {"fit_percent": {"speed": None, "p1": None}, "stopped": "left the range."}},
            "findings": [{"kind": "dead", "channel": "p1", "severity": "error", "sentence": "p1 is dead"}],
        },
        "frequency_response.json": {
            "drive": "current", "method": "spectral", "estimator": "H1", "sample_time": 0.004,
            "logs": [f"{AWKWARD}.csv"],
            "period": None, "averages": 15, "provenance": PROVENANCE,
            "subspace": {"order": 1, "singular_values": [1.0, 0.01], "fit_percent": {AWKWARD: 90.0}},
            "channels": {
                "speed": {"frequency": [1.0, 2.0], "real": [1.0, 0.5], "imaginary": [0.0, -0.5], "noise_sd": [0.1, 0.1],
                          "nonlinear_sd": [None, None], "coherence": [0.9, 0.8], "even": None, "odd": None,
                          "reliable": [True, True], "unit": "rad/s/A",
                          "models": {"linear": {"real": [1.0, 0.5], "imaginary": [0.0, -0.5], "distance": 0.02}}},
                AWKWARD: {"frequency": [1.0], "real": [1.0], "imaginary": [0.0], "noise_sd": [0.9],
                          "nonlinear_sd": [0.1], "coherence": [None], "even": 0.1, "odd": None, "reliable": [False],
                          "unit": "m/A", "models": {"linear": {"real": [1.0], "imaginary": [0.0], "distance": None}}},
            },
        },
        "analysis.json": {
            "plant": "ehsa", "model": "linear", "poles": [[0.0, 0.0], [-293.3, 327.8]],
            "natural_frequencies": [0.0, 439.9], "damping": [None, 0.667], "zeros": {"speed": [[-295.0, 327.0]]},
            "dc_gain": {"speed": 370.0}, "loops": [LOOP],
        },
        "design.json": {
            "plant": "ehsa", "kind": "pid", "settings": {}, "asked": {"Ms": "1.5"}, "controller": None,
            "law": "parallel PID", "loop": LOOP | {"stable": False}, "overshoot": 0.3, "settling_time": 0.2,
        },
        "montecarlo.json": {
            "campaigns": [{
                "scenario": "steps", "controller": "pid", "runs": 100, "passes": 96, "probability": 0.96,
                "confidence": 0.95, "interval": [0.9, 0.99], "seed": 3, "interrupted": True,
                "uncertain": ["K_T uniform from 1 to 1.4 N m/A"],
                "influences": [{"name": "K_T", "measure": "ks", "value": 0.7, "chance": 1e-9, "passing": 1.1,
                                "failing": 1.3, "decisive": True}],
                "failures": {"SteadyStateError": 4, "trip: stroke": 1},
                "margins": [{"metric": "SteadyStateError", "lower": None, "upper": 3e-4, "smallest": None, "low": 0.01,
                             "median": 0.4, "run": 7, "violated": 4}], "provenance": PROVENANCE,
            }],
        },
        "excitation.json": {
            "plant": "ehsa", "model": "nonlinear", "settings": {}, "input": "noise", "duration": 10.0, "seed": 0,
            "current": None, "next": ["ehsa-ctrl simulate ehsa"], "provenance": PROVENANCE,
            "parameters": {"M": {"believed": 16.5, "sd": 0.2, "relative_sd": 0.012, "relative_sd_at_worst": 0.02,
                                 "unit": "kg", "verdict": "well determined"},
                           "K_T": {"believed": 1.2, "sd": None, "relative_sd": None, "relative_sd_at_worst": None,
                                   "unit": "N m/A", "verdict": "not identifiable from this log"}},
            "limits": {"pump_speed": {"allowed": 471.0, "reached": 245.0, "worst": 344.0, "unit": "rad/s",
                                      "share": 0.5, "worst_share": 0.73}},
            "variations": {"draws": 8, "spread": 0.3},
            "candidates": [{"input": "noise", "score": 0.02, "not_determined": 0}],
        },
        "check.json": {
            "controller": AWKWARD, "plant": "ehsa", "settings": {}, "number": "int16_t", "tolerance": 0.4,
            "operations": {"flops": 31, "additions": 31}, "stack": None, "largest_error": None, "usable": False,
            "runs": {"test vector": {"samples": 750, "error": None, "iterations": None, "unsolved": 0},
                     AWKWARD: {"samples": 3, "error": 0.1, "iterations": 12, "unsolved": 1}},
            "signals": {"current": {"largest": 6.0, "error": None, "step": 1e-4, "headroom": 0.1},
                        AWKWARD: {"largest": 0.0, "error": 0.0, "step": 1e-4, "headroom": None},
                        "estimate_x": {"largest": 1.0, "error": 0.0, "step": 1e-4, "headroom": -0.5}},
        },
        "learning.json": {
            "scenario": AWKWARD, "controller": AWKWARD, "gain": 0.5, "lead": 3, "cutoff": 10.0, "contraction": 0.6,
            "contraction_at": 4.0, "words": AWKWARD, "provenance": PROVENANCE,
            "trials": [{"number": k, "rms": 6e-4 / (k + 1), "largest": 1e-3, "current": 0.5, "correction": k * 1e-4}
                       for k in range(2)],
        },
        "simulation.json": {
            "plant": AWKWARD, "model": "nonlinear", "settings": {"K_T": "1.1"}, "samples": 501, "sample_time": 0.004,
            "stopped": "", "limits_passed": ["pump speed reached 5000 rpm"], "pressure_level_drift": 2e5, "seed": 0,
            "log": "log.csv", "provenance": PROVENANCE,
        },
    }  # fmt: skip
