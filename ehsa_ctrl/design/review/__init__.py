"""A design looked through before it runs: what a reviewer would ask, with the answer, the doubt and a remedy.

The tests that MPC tools make of a design (is the loop stable, does it reach its target, are its numbers fit for a
solver), and those that friction adds: what the rod does where it stands.
"""

from ._review import Review, review
from .finding import Finding, Known, Verdict

__all__ = ["Finding", "Known", "Review", "Verdict", "review"]
