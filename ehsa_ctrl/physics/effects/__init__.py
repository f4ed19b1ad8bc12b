"""Effects beyond (12), one per file; those without equations share two files. Adding a file adds the effect everywhere.

Users add their own in `effects/` beside their `plants/`, as Python or as a TOML file with an expression
(`_law_file.py`), or in a package with an entry point `ehsa_ctrl.effects`.
"""

import sys

from ...core.registry import Registry
from ._candidate import CandidateEffect, DiagnosisContext, FreeNumber
from ._effect import PLACES, Effect, EffectParameter, EffectState, LawSwitch, MeasuredReplay
from ._law_file import ADDENDS, LawFile, LawLog, effect_of, law_candidate, law_text, read_law

EFFECTS: Registry[Effect] = Registry(sys.modules[__name__], "effect", Effect, "effects", read=read_law)

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
    "effect_of",
    "law_candidate",
    "law_text",
    "read_law",
]
