"""Terms and statements of a specialised program: what is left of a law's Python when its settings are known.

A term is an operation on other terms, a constant, or the content of a place; statements assign terms to places.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

REAL, INT, BOOL = "real", "int", "bool"


@dataclass(frozen=True)
class Place:
    """Where a number is kept.

    store: "reference", "measured", "memory", or the name of a local variable. index: in a vector; -1 for a local
    variable. moving: whether `index` is the first of a part of the memory that is addressed at run time.
    """

    store: str
    index: int = -1
    moving: bool = False

    @property
    def local(self) -> bool:
        return self.index < 0


@dataclass(frozen=True)
class ProgramTerm:
    """An operation.

    operation: "constant" (value), "read" (place; with an index as only argument in a moving part), + - * / % negative
    absolute smaller larger choice sqrt exp sin; whole (a number as an index); == != < <= > >= and or not valid (whether
    the reading of `place` is there); table (one of `entries`, row by row of `shape`; an index from 0 on per argument).
    type: REAL, INT or BOOL.
    """

    operation: str
    arguments: tuple[ProgramTerm, ...] = ()
    type: str = REAL
    value: float = 0.0
    place: Place | None = None
    entries: tuple[float, ...] = ()
    shape: tuple[int, ...] = ()

    def inner(self) -> Iterator[ProgramTerm]:
        """This term and all terms in it."""
        yield self
        for argument in self.arguments:
            yield from argument.inner()


def table_index(indices: list[str], shape: tuple[int, ...]) -> str:
    """Code of an entry's place in a table, in Python and C, from those of its indices."""
    code = indices[0]
    for index, count in zip(indices[1:], shape[1:], strict=True):
        code = f"({code}) * {count} + {index}"
    return code


def constant(value: float | bool) -> ProgramTerm:
    """A known number; whole numbers of Python are indices."""
    word = BOOL if isinstance(value, bool) else INT if isinstance(value, int) else REAL
    return ProgramTerm("constant", type=word, value=value)


def read(place: Place, word: str = REAL) -> ProgramTerm:
    return ProgramTerm("read", type=word, place=place)


@dataclass
class Assignment:
    """place = term. index: of the entry, for a moving part."""

    place: Place
    term: ProgramTerm
    index: ProgramTerm | None = None


@dataclass
class Branch:
    """if test: yes, else: no."""

    test: ProgramTerm
    yes: list[Statement] = field(default_factory=list)
    no: list[Statement] = field(default_factory=list)


@dataclass(frozen=True)
class Remark:
    """A comment."""

    text: str


Statement = Assignment | Branch | Remark


@dataclass(frozen=True)
class SpecialisedProgram:
    """One sample of a controller: its statements and the term of its current."""

    statements: list[Statement]
    current: ProgramTerm

    def assignments(self) -> Iterator[Assignment]:
        """All assignments, in order."""
        return assignments(self.statements)

    def terms(self) -> Iterator[ProgramTerm]:
        """All terms, with those inside others."""
        for term in _outer_terms(self.statements):
            yield from term.inner()
        yield from self.current.inner()

    def moving_parts(self, size: int) -> dict[int, int]:
        """First index -> end of the parts of a memory of this size that are addressed at run time."""
        places = [one.place for one in self.assignments()] + [term.place for term in self.terms()]
        starts = sorted({place.index for place in places if place is not None and place.moving})
        return dict(zip(starts, [*starts[1:], size], strict=True)) if starts else {}


def assignments(statements: list[Statement]) -> Iterator[Assignment]:
    for statement in statements:
        if isinstance(statement, Assignment):
            yield statement
        elif isinstance(statement, Branch):
            yield from assignments(statement.yes)
            yield from assignments(statement.no)


def _outer_terms(statements: list[Statement]) -> Iterator[ProgramTerm]:
    for statement in statements:
        if isinstance(statement, Assignment):
            yield statement.term
            if statement.index is not None:
                yield statement.index
        elif isinstance(statement, Branch):
            yield statement.test
            yield from _outer_terms(statement.yes)
            yield from _outer_terms(statement.no)


def without_unread(program: SpecialisedProgram) -> SpecialisedProgram:
    """The program without local variables that nothing reads and branches that do nothing."""
    while True:
        used = {term.place for term in program.terms() if term.place is not None}
        kept = _kept(program.statements, used)
        if kept == program.statements:
            return program
        program = SpecialisedProgram(kept, program.current)


def _kept(statements: list[Statement], used: set[Place]) -> list[Statement]:
    found: list[Statement] = []
    for one in statements:
        if isinstance(one, Assignment) and one.place.local and one.place not in used:
            continue
        if isinstance(one, Branch):
            branch = Branch(one.test, _kept(one.yes, used), _kept(one.no, used))
            if any(not isinstance(each, Remark) for each in (*branch.yes, *branch.no)):
                found.append(branch)
            continue
        found.append(one)
    return found
