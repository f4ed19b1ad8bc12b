"""Force control against workpieces of 10 kN/m to 10 MN/m: one design for all, and one for each.

    python benchmarks/force_stiffness.py

The rod approaches a workpiece 20 mm away, presses and lets go, on the nonlinear plant. The force is 4 kN, or what
compresses the workpiece by TRAVEL; its rate is that of controllers/force_press.toml, or what moves the rod at SPEED.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import ehsa_ctrl as e
from ehsa_ctrl.core.files import read_toml

#: Stiffnesses [N/m]; largest force [N] and its rate [N/s]; largest compression [m] and speed [m/s].
STIFFNESSES = (1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7)
FORCE, RATE, TRAVEL, SPEED = 4e3, 1e4, 0.03, 0.05
#: First target, and the force from which on the force is controlled, as shares of the force.
TOUCH, CONTACT = 0.25, 0.1
GAP, HOLD = 0.02, 2.5
#: A design for one stiffness has margins up to so many times it, and down to the same part of it.
NEAR = 3.0


def controller(stiffness: float, force: float, rate: float, *, own: bool) -> e.SampledController:
    """force_press with the rate and contact of the task; own: designed for the stiffness."""
    content: dict[str, Any] = read_toml(e.controllers["force_press"])
    content["force"]["rate"] = f"{rate:.6g} N/s"
    content["position"]["contact"] = f"{CONTACT * force:.6g} N"
    if own:
        span = {"stiffness": stiffness, "softest": stiffness / NEAR, "stiffest": stiffness * NEAR}
        content["environment"] = {name: f"{value:.6g} N/m" for name, value in span.items()}
    return e.load_controller(content, e.load_plant("ehsa", model="linear"))


def scenario(stiffness: float, force: float, rate: float) -> dict[str, Any]:
    """Approach, touch, press, let go."""
    release = 2.0 + force / rate + HOLD
    into = GAP + 2.0 * TOUCH * force / stiffness
    return {
        "schema": 1, "title": "Press", "why": "Force against stiffness.", "plant": "ehsa", "controller": "force_press",
        "duration": f"{release + force / rate + 1.5:.6g} s",
        "load": {"stiffness": f"{stiffness:.6g} N/m", "gap": f"{1e3 * GAP:.6g} mm"},
        "reference": {
            "kind": "moves", "times": ["0.2 s", "1 s", f"{release + 0.2:.6g} s"],
            "positions": [f"{1e3 * GAP - 1:.6g} mm", f"{1e3 * into:.6g} mm", "0 mm"],
            "durations": ["0.8 s", "1 s", "0.8 s"],
            "force": {
                "times": ["0.2 s", "2 s", f"{release:.6g} s"],
                "forces": [f"{TOUCH * force:.6g} N", f"{force:.6g} N", "0 N"], "rate": f"{rate:.6g} N/s",
            },
        },
    }  # fmt: skip


def main() -> None:
    print("stiffness   force   design    overshoot  settling  error held  impact  lost  current RMS  phase margin")
    for stiffness in STIFFNESSES:
        force = min(FORCE, TRAVEL * stiffness)
        rate = min(RATE, SPEED * stiffness)
        for own in (False, True):
            made = controller(stiffness, force, rate, own=own)
            found = e.run(scenario(stiffness, force, rate), controller=made)
            m = {name: pair[1] for name, pair in found.metrics.items()}
            margin = made.law.margins.worst["phase_margin"].value
            settled = m.get("ForceSettlingTime", np.nan)
            settling = f"{settled:.2f} s" if np.isfinite(settled) else "-"
            print(
                f"{1e-3 * stiffness:6g} kN/m {force:5.0f} N  {'its own' if own else 'shipped'}  "
                f"{100 * m['ForceOvershoot']:8.1f} % {settling:>9} {m['ForceSteadyStateError']:8.0f} N "
                f"{m['ContactImpact']:6.0f} N {m['LostContacts']:4.0f} {m['CurrentRMS']:10.2f} A "
                f"{margin:9.0f} deg",
                flush=True,
            )


if __name__ == "__main__":
    main()
