"""Effects beyond (12), one per file; those without equations share two files. Adding a file adds the effect everywhere.

Users add their own in `effects/` beside their `plants/`, as Python or as a TOML file with an expression
(`_law_file.py`), or in a package with an entry point `ehsa_ctrl.effects`.
"""

import sys
from collections.abc import Iterable

from ...core.registry import Registry
from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber
from ._effect import PLACES, Effect, EffectParameter, EffectState, LawSwitch, MeasuredReplay
from ._law_file import ADDENDS, LawFile, LawLog, effect_of, law_candidate, law_text, read_law

EFFECTS: Registry[Effect] = Registry(sys.modules[__name__], "effect", Effect, "effects", read=read_law)


def with_extended(names: Iterable[str]) -> tuple[str, ...]:
    """Names of effects, each behind the effect that it extends; unknown names stay."""
    extended = {name: EFFECTS[name].extends if name in EFFECTS else "" for name in names}
    found = (one for name, other in extended.items() for one in (other, name))
    return tuple(dict.fromkeys(one for one in found if one in extended or (one and EFFECTS[one].wired)))


def all_parameters(name: str) -> tuple[EffectParameter, ...]:
    """Parameters of an effect, then of those that extend it."""
    extensions = (effect for effect in EFFECTS.values() if effect.extends == name)
    return tuple(parameter for one in (EFFECTS[name], *extensions) for parameter in one.parameters)


__all__ = [
    "ADDENDS",
    "EFFECTS",
    "PLACES",
    "CandidateEffect",
    "DiagnosisContext",
    "Effect",
    "EffectParameter",
    "EffectState",
    "FreeNumber",
    "LawFile",
    "LawLog",
    "LawSwitch",
    "MeasuredReplay",
    "all_parameters",
    "effect_of",
    "law_candidate",
    "law_text",
    "read_law",
    "with_extended",
]
