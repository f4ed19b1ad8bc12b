"""Pages of the catalogues: effects, friction laws, metrics."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from typing import Any

from words import cell, sentence

import ehsa_ctrl
from ehsa_ctrl.physics.effects import EFFECTS
from ehsa_ctrl.physics.effects._effect import PLACES
from ehsa_ctrl.physics.friction import LAWS, SYMBOLS
from ehsa_ctrl.scenario.metrics import METRICS

PACKAGE = Path(ehsa_ctrl.__file__).parent


def effects() -> str:
    """The catalogue of effects by place, with the equations of the code."""
    lines = [
        "# Effects",
        "",
        f"Behaviour of real rigs that (12) lacks: {len(EFFECTS)} effects, off by default. At its neutral value an "
        "effect changes no bit of a simulation. *In a plant* shows how to switch it on, *in a log* its signature.",
    ]
    for place in PLACES:
        here = {name: effect for name, effect in EFFECTS.items() if effect.place == place}
        lines += ["", f"## {place.capitalize()}"]
        for name, effect in here.items():
            lines += ["", f"### {name}", "", sentence(effect.summary)]
            detail = _equations(name)
            lines += ["", *detail] if detail else []
            lines += ["", f"*In a log:* {effect.fingerprint}.", "", f"*In a plant:* {_switched_on(effect)}"]
            lines += ["", f"*Source:* {effect.source}."] if effect.source else []
            if effect.parameters:
                lines += [
                    "",
                    "| parameter | unit | meaning | neutral | typical | bounds |",
                    "|---|---|---|---|---|---|",
                ]
                lines += [
                    f"| `{p.name}` | {p.unit} | {cell(p.meaning)} | {p.neutral:g} | {p.typical:g} ({p.source}) "
                    f"| {p.lower:g} to {p.upper:g} |"
                    for p in effect.parameters
                ]
    return "\n".join(lines) + "\n"


def _equations(name: str) -> list[str]:
    """Text of the effect's file beyond the first line, and the description of each equation."""
    effect, body = EFFECTS[name], ""
    for path in (PACKAGE / "physics" / "effects").glob("[!_]*.py"):
        module = importlib.import_module(f"ehsa_ctrl.physics.effects.{path.stem}")
        if getattr(module, "effect", None) is effect:
            body = inspect.cleandoc(module.__doc__ or "").partition("\n")[2].strip()
    lines = [body, ""] if body else []
    for signal, function in {**effect.changes, **effect.adds}.items():
        about = " ".join(inspect.cleandoc(function.__doc__ or "").split())
        lines.append(f"- `{signal}`: {about}")
    return lines


def _switched_on(effect: Any) -> str:
    if effect.wired:
        return f'`effects = ["{effect.name}"]` in `[linear]` or `[nonlinear]`' + (
            ", parameters among the others." if effect.parameters else "."
        )
    if effect.symbols:
        return "another value of " + ", ".join(f"`{symbol}`" for symbol in effect.symbols) + "."
    if effect.sensor is not None:
        return f"`{effect.sensor}` in `[sensors.CHANNEL]`."
    return f'`rod_friction = "{effect.rod_friction}"`.'


def friction() -> str:
    """The friction laws and their symbols."""
    lines = [
        "# Friction laws",
        "",
        "By name for shaft and rod: `shaft_friction` and `rod_friction` of a plant's model. "
        "[How to choose](../choose.md#which-friction-law).",
        "",
        "| law | | sticks | symbols |",
        "|---|---|---|---|",
    ]
    for law in LAWS.values():
        symbols = ", ".join(f"`{symbol}`" for symbol in law.symbols) or "none"
        lines.append(
            f"| [`{law.name}`](#{law.name}) | {cell(law.summary)} | {'yes' if law.sticks else 'no'} | {symbols} |"
        )
    lines += [
        "",
        "`A`, `B`, `C`, `tau` become `A_FM` ... `tau_FM` on the shaft and `A_FR` ... `tau_FR` on the rod; the others "
        "get `_FM` or `_FR` likewise.",
        "",
        "| symbol | meaning | unit on the shaft | unit on the rod |",
        "|---|---|---|---|",
    ]
    for symbol, part in SYMBOLS.items():
        lines.append(f"| `{symbol}` | {part.meaning} | {part.unit_at('N m', 'rad')} | {part.unit_at('N', 'm')} |")
    for law in LAWS.values():
        text = inspect.cleandoc(inspect.getmodule(law.effort).__doc__ or "")
        equations = [law.effort.__doc__ or "", *([law.state_rate.__doc__ or ""] if law.state_rate else [])]
        lines += ["", f"## {law.name}", "", text, ""]
        lines += [f"- {' '.join(inspect.cleandoc(equation).split())}" for equation in equations if equation]
    return "\n".join(lines) + "\n"


def metrics() -> str:
    """The metrics that a scenario can limit."""
    lines = [
        "# Metrics",
        "",
        "Metrics of a closed loop; a scenario's `[limits]` take each with `min`, `max` or both. A baseline allows a "
        "difference of the last column plus a share of the recorded value (`[baseline]`).",
        "",
        "| metric | shown in | meaning | least difference |",
        "|---|---|---|---|",
    ]
    for name, metric in METRICS.items():
        shown = "" if metric.display_unit == "1" else metric.display_unit
        lines.append(f"| `{name}` | {shown} | {cell(metric.meaning)} | {metric.format(metric.absolute_tolerance)} |")
    return "\n".join(lines) + "\n"
