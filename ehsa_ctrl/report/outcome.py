"""What a verdict of a diagnosis means for its models and hypotheses, in words; for pages and figures alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

#: Outcome of a hypothesis -> its text in a table.
OUTCOMES = {
    "named": "✓ named", "equivalent": "△ not distinguishable", "excluded": "✗ excluded",
    "redundant": "more than needed", "tried": "✗ does not explain it", "possible": "△ possible",
}  # fmt: skip


def after_model(verdict: str) -> str | None:
    """The model shown as "after": with causes where some are named, else refitted, none without a gap."""
    if verdict == "no_gap":
        return None
    return "with_effects" if verdict in ("effect", "ambiguous") else "refit"


def after_words(verdict: str, causes: int) -> str:
    """What the model shown as "after" is."""
    if after_model(verdict) == "with_effects":
        return f"with the cause{'s' if causes > 1 else ''} found"
    return "with nominal parameters refitted"


def models_shown(verdict: str, models: Iterable[str]) -> list[str]:
    """The models whose gaps mean something: without named causes there is no model that has them."""
    omitted = {"no_gap": ("refit", "with_effects", "upper_bound"), "effect": (), "ambiguous": ()}
    return [model for model in models if model not in omitted.get(verdict, ("with_effects",))]


def outcome(verdict: str, causes: Mapping[str, Sequence[str]], members: Sequence[str]) -> str:
    """What became of a hypothesis, one of OUTCOMES.

    Where no cause is named none was excluded in favour of another: hypotheses were tried, or are possible.

    Parameters
    ----------
    causes: name of each cause -> ids that the log cannot distinguish from it.
    members: names of the hypothesis' effects.
    """
    if verdict == "outside_catalogue":
        return "tried"
    alike = {name: {name, *others} for name, others in causes.items()}
    if verdict == "underdetermined":
        known = set().union(*alike.values()) if alike else set()
        return "possible" if members and all(m in known or _id(m) in known for m in members) else "tried"
    gone, come = set(causes) - set(members), set(members) - set(causes)
    if not gone:
        return "redundant" if come else "named"
    # One cause replaced by an equivalent one, perhaps with more beside it: that is not excluded either.
    if len(gone) == 1 and any(_id(name) in alike[next(iter(gone))] for name in come):
        return "equivalent" if len(come) == 1 else "redundant"
    return "excluded"


def _id(member: str) -> str:
    return member.partition(" (")[0]
