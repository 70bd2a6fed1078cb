"""Exact states where equations hold, such as `x^2 + y^2 = 1` among what is assumed: no box has one as its
middle, so some are drawn in which a policy is judged before the search.
"""

from collections.abc import Iterator
from fractions import Fraction
from math import isqrt
from random import Random

from dl2c.ir.evaluate import value_of
from dl2c.ir.logic import conjuncts, difference, symbols
from dl2c.ir.model import Compare, Symbol, Term
from dl2c.policy_proof.exact import State, Violation, violation
from dl2c.policy_proof.question import Question, Range

SIMPLE, MORE = 60, 60
"""How many states are judged: with simple numbers in equations, which doubles are, then with other ones."""

TRIES = 20
"""For each state."""

GRID = 1024
"""Parts of the limits of a name."""

HYPOTENUSE = 65
"""Many sums of squares of its multiples are squares."""


def violation_on_equations(question: Question) -> Violation | None:
    """A violation among drawn states in which the equations of the hypothesis hold; None without any."""
    equations = _equations(question)
    if not equations:
        return None
    rng = Random(0)
    for count, denominator in ((SIMPLE, 1), (MORE, HYPOTENUSE)):
        for state in _drawn(question, equations, rng, count, denominator):
            if (found := violation(question, state)) is not None:
                return found
    return None


def _equations(question: Question) -> list[Compare]:
    """Those about dimensions that are not computed."""
    computed = {symbol for symbol, _ in question.computed}
    found = (c for c in conjuncts(question.hypothesis) if isinstance(c, Compare) and c.op == "=")
    return [c for c in found if symbols(c) and not symbols(c) & computed]


def _drawn(
    question: Question, equations: list[Compare], rng: Random, count: int, denominator: int
) -> Iterator[State]:
    """At most so many states; numbers in equations but for one are multiples of a fraction."""
    limits = dict(zip(question.dimensions, question.box, strict=True))
    found = 0
    for _ in range(count * TRIES):
        state = {s: _on_grid(rng, ends) for s, ends in limits.items()}
        if all(_solved(equation, state, limits, rng, denominator) for equation in equations):
            yield state
            found += 1
        if found == count:
            return


def _on_grid(rng: Random, ends: Range) -> Fraction:
    low, high = ends
    return low + (high - low) * Fraction(rng.randrange(GRID + 1), GRID)


def _solved(
    equation: Compare,
    state: dict[Symbol, Fraction],
    limits: dict[Symbol, Range],
    rng: Random,
    denominator: int,
) -> bool:
    """Give the names of an equation values with which it holds; whether there are such within the limits."""
    names = sorted(symbols(equation), key=str)
    rng.shuffle(names)
    unknown, *others = names
    for s in others:
        low, high = limits[s]
        state[s] = min(max(Fraction(round(state[s] * denominator), denominator), low), high)
    roots = _roots(difference(equation), state, unknown)
    inside = [r for r in roots if limits[unknown][0] <= r <= limits[unknown][1]]
    if inside:
        state[unknown] = rng.choice(inside)
    return bool(inside)


def _roots(term: Term, state: State, unknown: Symbol) -> list[Fraction]:
    """Rational values of a name at which a term is 0, where it is linear or quadratic in it."""
    values = [value_of(term, {**state, unknown: Fraction(x)}, exact=True) for x in (-1, 0, 1, 2)]
    if any(value is None for value in values):
        return []
    before, c, after, far = (Fraction(v) for v in values if v is not None)
    a, b = (before + after) / 2 - c, (after - before) / 2
    if 4 * a + 2 * b + c != far:
        return []
    if not a:
        return [-c / b] if b else []
    root = _root(b * b - 4 * a * c)
    return [] if root is None else [(-b - root) / (2 * a), (-b + root) / (2 * a)]


def _root(square: Fraction) -> Fraction | None:
    """The square root, where it is rational."""
    if square < 0:
        return None
    above, below = isqrt(square.numerator), isqrt(square.denominator)
    root = Fraction(above, below)
    return root if root * root == square else None
