"""Exact runs whose decisions are drawn at random: counterexamples that take many iterations of a loop.

Runs have habits, so that they get far: each prefers one alternative of every choice, and mostly gives
`x := *` the value of the same term. A run ends where what is claimed of the ends of the last loop is false.
"""

import math
import random
from contextlib import suppress
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from flint import fmpq_poly

from dl2c.parse import tree
from dl2c.resolve.shape import statements
from dl2c.resolve.symbols import nodes
from dl2c.verify.arithmetic.exact import (
    Blocked,
    Inexact,
    Run,
    Undefined,
    along,
    constant,
    solved,
    term_value,
    truth,
)
from dl2c.verify.states import EventKind, has_program

LONGEST = 200
"""Iterations of the last loop."""

INNER = 4
"""Iterations of other loops are fewer."""

TRIES = 8
"""Of an iteration, as long as a test is false."""

MAX_BITS = 2_000
"""Of a value: numbers with more take too long."""

HABIT = 0.7
"""How often the value of `x := *` is that of the usual term."""

GRID = 1000
"""The times of roots that are not rational are rounded down to multiples of one part of so many."""


@dataclass(frozen=True, slots=True)
class Claim:
    """The formula to be violated; the loops with which its programs end, and what it claims after them; and
    terms whose values are tried.
    """

    formula: tree.Formula
    ends: tuple[tuple[tree.Loop, tree.Formula], ...]
    terms: tuple[tree.Term, ...]

    def after(self, loop: tree.Loop) -> tree.Formula | None:
        """What is claimed after a loop; None if a program goes on there."""
        return next((formula for one, formula in self.ends if one is loop), None)


def claim_of(formula: tree.Formula) -> Claim | None:
    """What runs are to violate; None where no program of the formula ends with a loop."""
    ends: list[tuple[tree.Loop, tree.Formula]] = []
    for box in nodes(formula):
        if isinstance(box, tree.Box) and not has_program(box.child):
            last = statements(box.program)[-1]
            if isinstance(last, tree.Loop):
                ends.append((last, box.child))
    found: list[tree.Term] = [tree.Number(Fraction(0)), tree.Number(Fraction(1))]
    found += [n for n in nodes(formula) if isinstance(n, tree.Number | tree.Variable)]
    found += [tree.Neg(t) for t in found]
    return Claim(formula, tuple(ends), tuple(dict.fromkeys(found))) if ends else None


@dataclass(slots=True)
class RandomRun(Run):
    """A run of a claim's program with at most `most` iterations of the last loop."""

    claim: Claim | None = None
    chance: random.Random = field(default_factory=lambda: random.Random(0))
    most: int = LONGEST
    iterations: int = 0
    violated: tree.Formula | None = None
    """What is claimed after the loop that ended in violation of it."""

    drawn: list[tuple[EventKind, Fraction]] = field(default_factory=list[tuple[EventKind, Fraction]])
    """The kind and value of each decision."""

    habits: dict[tuple[int, str], tree.Term] = field(default_factory=dict[tuple[int, str], tree.Term])
    leaning: dict[int, float] = field(default_factory=dict[int, float])
    at: tree.Program | None = None

    def succeeds(self) -> bool:
        """Whether it violates the claim."""
        assert self.claim is not None
        with suppress(Inexact, Blocked, Undefined):
            return self.violates(self.claim.formula)
        return False

    def follow(self, program: tree.Program) -> None:
        if isinstance(program, tree.Loop):
            self._repeat(program)
        else:
            self.in_time()
            self.at = program
            Run.follow(self, program)
            if isinstance(program, tree.Assign | tree.ODESystem) and self._large():
                raise Inexact("numbers that take too long")

    def _repeat(self, loop: tree.Loop) -> None:
        assert self.claim is not None
        wanted = self.claim.after(loop)
        for _ in range(self.chance.randrange(INNER) if wanted is None else self.most):
            if not self._again(loop.child):
                break
            if wanted is not None:
                self.iterations += 1
                if truth(tree.Not(wanted), self.values):
                    self.violated = wanted
                    break
        self._note("again", "once more", Fraction(0))

    def _again(self, body: tree.Program) -> bool:
        """Execute a body, unless a test is false however decisions are drawn."""
        values, taken, drawn = dict(self.values), len(self.taken), len(self.drawn)
        for _ in range(TRIES):
            self._note("again", "once more", Fraction(1))
            try:
                self.follow(body)
            except Blocked:
                self.values = dict(values)
                del self.taken[taken:], self.drawn[drawn:]
            else:
                return True
        return False

    def _large(self) -> bool:
        return any(
            v.numerator.bit_length() + v.denominator.bit_length() > MAX_BITS for v in self.values.values()
        )

    def _note(self, kind: EventKind, name: str, value: Fraction) -> None:
        del self.drawn[len(self.taken) :]  # of the first part of a conjunction, which was not violated
        self.taken.append((name, value))
        self.drawn.append((kind, value))

    def _next(self, kind: EventKind, name: str) -> Fraction:
        match kind, self.at:
            case "choice", _:
                lean = self.leaning.setdefault(id(self.at), self.chance.choice((0.1, 0.5, 0.9)))
                value = Fraction(self.chance.random() < lean)
            case "duration", tree.ODESystem() as ode:
                value = self._duration(ode)
            case _:
                value = self._value(name)
        self._note(kind, name, value)
        return value

    def _value(self, name: str) -> Fraction:
        assert self.claim is not None
        term = self.habits.setdefault((id(self.at), name), self.chance.choice(self.claim.terms))
        if self.chance.random() > HABIT:
            term = self.chance.choice(self.claim.terms)
        return term_value(term, self.values)

    def _duration(self, ode: tree.ODESystem) -> Fraction:
        """Mostly the time until a condition of the domain changes, else a part of it, or none at all."""
        curves = {**constant(self.values), **solved(ode, self.values)}
        margins = [
            along(c.left, curves) - along(c.right, curves)
            for c in nodes(ode.domain)
            if isinstance(c, tree.Compare)
        ]
        ends = [t for margin in margins for t in positive_roots(margin)]
        longest = min(ends, default=self.chance.choice((Fraction(1, 8), Fraction(1), Fraction(8))))
        part = self.chance.random()
        return (
            longest
            if part < 0.7
            else Fraction(0)
            if part > 0.9
            else longest * self.chance.randrange(1, 8) / 8
        )


def positive_roots(margin: fmpq_poly) -> list[Fraction]:
    """The times after 0 at which a polynomial of time is 0, rounded down where they are not rational."""
    if margin.degree() < 1:
        return []
    if margin.degree() == 1:
        root = -margin[0] / margin[1]
        exact = Fraction(int(root.p), int(root.q))
        return [exact] if exact > 0 else []
    roots: Any = margin.complex_roots()  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
    near = (complex(root) for root, _ in roots)
    found = (Fraction(math.floor(z.real * GRID), GRID) for z in near if abs(z.imag) < 1e-9 and z.real < 1e9)
    return [t for t in found if t > 0]
