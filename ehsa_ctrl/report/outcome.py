"""Wording of models and hypotheses for each verdict of a diagnosis, shared by pages and figures."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

from ..diagnosis.diagnosis import NAMING

#: Outcome of a hypothesis -> its text in a table.
OUTCOMES = {
    "named": "✓ named", "equivalent": "△ not distinguishable", "excluded": "✗ excluded",
    "redundant": "more than needed", "tried": "✗ does not explain it", "possible": "△ possible",
}  # fmt: skip


def after_model(verdict: str, models: Container[str]) -> str | None:
    """The model shown as "after": with the law, else with the named causes, else the refit; None without a gap.

    models: those of the result.
    """
    if verdict == "no_gap":
        return None
    if "with_law" in models:
        return "with_law"
    return "with_effects" if verdict in NAMING else "refit"


def after_words(verdict: str, causes: int, models: Container[str]) -> str:
    """Description of the model shown as "after"."""
    words = {"with_effects": f"with the cause{'s' if causes > 1 else ''} found", "with_law": "with the law found"}
    return words.get(after_model(verdict, models) or "", "with nominal parameters refitted")


def outcome(verdict: str, causes: Mapping[str, Sequence[str]], members: Sequence[str]) -> str:
    """Outcome of a hypothesis, a key of OUTCOMES.

    If no cause is named, no hypothesis is excluded in favour of another: each is "tried" or "possible".

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
    missing, added = set(causes) - set(members), set(members) - set(causes)
    if not missing:
        return "redundant" if added else "named"
    # A hypothesis that replaces one cause by an equivalent effect is not excluded.
    if len(missing) == 1 and any(_id(name) in alike[next(iter(missing))] for name in added):
        return "equivalent" if len(added) == 1 else "redundant"
    return "excluded"


def _id(member: str) -> str:
    return member.partition(" (")[0]
