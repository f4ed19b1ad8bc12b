"""A constant force acts on the rod: gravity, a hanging load."""

from ._candidate import Candidate, Free, Rig, from_symbols, starts_of
from ._effect import Effect


def candidates(effect: Effect, rig: Rig) -> list[Candidate]:
    """Behind the load cell, or on the rod itself, which passes the cell by as if it had a bias of its own."""
    found = from_symbols(effect, rig)
    if found and "force" in rig.channels:
        free = (*found[0].free, Free("bias.force", 0.0, 20.0))
        found.append(Candidate(free, starts_of(free, 0.0)))
    return found


effect = Effect(
    name="constant_force",
    place="force",
    summary="constant force on the rod",
    fingerprint="constant force error; the rod drifts one way",
    symbols={"F_0": 50.0},
    candidates=candidates,
    from_balances=True,
    source="paper, (5)",
)
