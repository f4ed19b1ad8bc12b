"""Effects beyond (12), one a file. Adding a file adds the effect to plants, lists, engine and tests."""

import sys

from ...core.registry import members
from ._candidate import Free
from ._effect import PLACES, Effect, EffectParameter, EffectState

EFFECTS: dict[str, Effect] = members(sys.modules[__name__], "effect")

__all__ = ["EFFECTS", "PLACES", "Effect", "EffectParameter", "EffectState", "Free"]
