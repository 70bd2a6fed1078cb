"""Exact states where equations hold, such as `x^2 + y^2 = 1` among what is assumed: no box has one as its
middle, so in some a policy is judged before the search. Some are drawn; others are solutions of Z3, in which
what the policy might ask for is not admissible.
"""

from collections.abc import Callable, Iterator, Sequence, Set
from fractions import Fraction
from itertools import chain, takewhile
from random import Random

from dl2c.ir.evaluate import truth, value_of
from dl2c.ir.logic import difference, symbols
from dl2c.ir.model import Compare, Symbol, Term
from dl2c.policy_proof.exact import State, Violation, violation
from dl2c.policy_proof.leaves import within
from dl2c.policy_proof.question import Question, Range
from dl2c.quantifiers.quadratic import root_of
from dl2c.smt.query import Impossible, Oracle

SIMPLE, MORE = 60, 60
"""How many states are judged: with simple numbers in equations, which doubles are, then with other ones."""

TRIES = 20
"""For each state."""

GRID = 1024
"""Parts of the limits of a name."""

HYPOTENUSE = 65
"""Many sums of squares of its multiples are squares."""

EACH_SECONDS, ALL_SECONDS = 1.0, 3.0
"""For solutions of Z3."""

COMPLETED, NEAR = 40, Fraction(1, 8)
"""States for each solution, and how far away its numbers may be where they are not rational: a share of the
limits.
"""

DIGITS = 1000
"""Of irrational values: the largest denominator of what they are replaced by."""


def violation_on_equations(question: Question, late: Callable[[], bool] = lambda: False) -> Violation | None:
    """A violation among states in which the equations of the hypothesis hold, as long as it is not `late`;
    None without equations.
    """
    equations = [equation for equation in question.equations if symbols(equation)]
    if not equations:
        return None
    rng = Random(0)
    drawn = (
        _drawn(question, equations, rng, count, denominator)
        for count, denominator in ((SIMPLE, 1), (MORE, HYPOTENUSE))
    )
    states = chain(*drawn, _near_solutions(question, equations, rng))
    found = (violation(question, state) for state in takewhile(lambda _: not late(), states))
    return next((v for v in found if v is not None), None)


def _drawn(
    question: Question, equations: Sequence[Compare], rng: Random, count: int, denominator: int
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


def _near_solutions(question: Question, equations: Sequence[Compare], rng: Random) -> Iterator[State]:
    """States near solutions, with any values of names on which these do not depend. Where the numbers of a
    solution are not rational, others nearby solve the equations.
    """
    limits = dict(zip(question.dimensions, question.box, strict=True))
    bound = sorted(symbols(*equations), key=str)
    for solution, used in _solutions(question):
        exact = all(truth(equation, solution, exact=True) for equation in equations)
        for _ in range(COMPLETED):
            state = {s: v if s in used else _on_grid(rng, limits[s]) for s, v in solution.items()}
            if not exact:
                state |= {s: state[s] + _step(rng, limits[s]) for s in bound}
            if exact or all(_solved(e, state, limits, rng, HYPOTENUSE) for e in equations):
                yield state


def _solutions(question: Question) -> Iterator[tuple[State, Set[Symbol]]]:
    """States in which a case about alternatives would end badly, whether or not the policy takes these, and
    the names on which that depends.
    """
    oracle = Oracle(EACH_SECONDS, ALL_SECONDS)
    assumed = [question.hypothesis, *within(question, question.box)]
    requests = {r.symbol for r in question.requests}
    for conclusion in dict.fromkeys(c.conclusion for c in question.cases):
        if (used := symbols(conclusion)) & requests:
            continue
        answer = oracle.exists(assumed, [Impossible((), conclusion)], [s.name for s in question.dimensions])
        if answer.verdict == "yes":
            solution = {s: _exact(answer.witness[s.name]) for s in question.dimensions}
            yield solution, used | symbols(question.hypothesis)


def _exact(value: Fraction | str) -> Fraction:
    return value if isinstance(value, Fraction) else Fraction(value.rstrip("?")).limit_denominator(DIGITS)


def _on_grid(rng: Random, ends: Range) -> Fraction:
    low, high = ends
    return low + (high - low) * Fraction(rng.randrange(GRID + 1), GRID)


def _step(rng: Random, ends: Range) -> Fraction:
    """To somewhere near."""
    return (ends[1] - ends[0]) * NEAR * Fraction(rng.randrange(-GRID, GRID + 1), GRID)


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
    square = root_of({(): b * b - 4 * a * c})
    return [] if square is None else [(-b + sign * square[()]) / (2 * a) for sign in (-1, 1)]
