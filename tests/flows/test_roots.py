"""Zeros of curves in rationals: every one is found once; and first exits."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from random import Random

from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracles import sturm
from selection import few_and_many_examples

from dl2c.flows.events import Crossing, Events, Exit
from dl2c.flows.events import first_exit as exit_of_events
from dl2c.flows.roots import Curve, crossings, curve_of, sign_after
from dl2c.flows.roots_exact import simplest

Atom = tuple[int, str]
"""A margin and what it must be: `>=`, `>`, `=` or `!=` zero."""

FORMULAS: tuple[tuple[tuple[Atom, ...], ...], ...] = (
    (((0, ">="),),),
    (((0, ">"),),),
    (((0, "!="),),),
    (((0, "="),),),
    (((0, ">="), (1, ">=")),),
    (((0, ">="), (1, ">"), (2, "!=")),),
    (((0, ">="),), ((1, ">="),)),
    (((0, ">"),), ((1, ">"), (2, ">="))),
    (((0, ">="), (1, "!=")), ((2, ">"),), ((0, "="), (1, ">"))),
)
"""Disjunctions of conjunctions of atoms over three margins."""

MARGINS = 3

MEANING: dict[str, Callable[[int], bool]] = {
    ">=": lambda s: s >= 0,
    ">": lambda s: s > 0,
    "=": lambda s: s == 0,
    "!=": lambda s: s != 0,
}


def holds(formula: int, sign: Sequence[int]) -> bool:
    return any(all(MEANING[op](sign[m]) for m, op in row) for row in FORMULAS[formula])


def first_exit(
    crossed: Sequence[Crossing], at0: Sequence[int], start: Sequence[int], condition: Callable[..., bool]
) -> Exit:
    return exit_of_events(Events(list(at0), list(start), list(crossed)), condition, exact=True)


def zeros(curve: Curve) -> list[tuple[Fraction, int]]:
    return [(Fraction(c.at), c.after) for c in crossings([curve], [sign_after(curve)])]


SPECIAL = [Fraction(k, 8) for k in range(9)] + [Fraction(1, 3), Fraction(7, 5), Fraction(-1, 2)]
GAPS = [Fraction(0), Fraction(0), *(Fraction(1, 10**k) for k in (3, 5, 7, 9))]


def random_roots(random: Random, degree: int) -> list[Fraction]:
    """Simple, multiple and clustered ones, at 0, at 1, at dyadic places and outside."""
    roots: list[Fraction] = []
    for _ in range(degree):
        if roots and random.random() < 0.4:
            roots.append(roots[-1] + random.choice(GAPS))
        else:
            roots.append(random.choice([random.choice(SPECIAL), Fraction(random.uniform(-0.5, 1.5))]))
    return roots


@given(st.lists(st.fractions(-9, 9, max_denominator=20), min_size=1, max_size=9), st.fractions(0, 5))
def test_a_curve_is_the_polynomial_it_is_made_of(c: list[Fraction], length: Fraction) -> None:
    curve = curve_of(c, length)
    for s in (Fraction(0), Fraction(1, 3), Fraction(1)):
        assert sturm.value(c, s * length) == sturm.at(curve, s)


def assert_exact(curve: Sequence[Fraction]) -> None:
    """One crossing for every zero that a Sturm sequence counts, with the signs beside it."""
    chain = sturm.sturm(sturm.monomial(curve))
    found = zeros(curve)
    beyond = 1 + Fraction(1, 2**70)
    assert len(found) == sturm.count(chain, Fraction(1, 2**200), beyond)
    for (at, after), following in zip(found, [*(at for at, _ in found[1:]), beyond], strict=False):
        low, high = at * (1 - Fraction(1, 2**200)), at * (1 + Fraction(1, 2**79))
        assert high <= following
        assert sturm.count(chain, low, high) == 1
        assert sturm.sign(sturm.at(curve, (high + following) / 2)) == after


@given(st.integers(0, 2**32))
@settings(max_examples=60)
@example(0)
def test_in_rationals_every_zero_is_found_once(seed: int) -> None:
    random = Random(seed)
    roots = random_roots(random, random.randint(1, 7))
    assert_exact(sturm.bernstein(sturm.from_roots(roots)))
    assert_exact([Fraction(random.randint(-9, 9)) for _ in range(random.randint(2, 8))] + [Fraction(1)])


@given(st.lists(st.fractions(-1, 2, max_denominator=1000), min_size=1, max_size=7))
def test_rational_zeros_are_recognised(roots: list[Fraction]) -> None:
    found = zeros(sturm.bernstein(sturm.from_roots(roots)))
    assert [at for at, _ in found] == sorted({r for r in roots if 0 < r <= 1})


def test_the_same_irrational_zero_of_different_curves_is_one_place() -> None:
    root = sturm.from_roots([Fraction(0), Fraction(0)])
    root[0] = Fraction(-1, 2)
    other = [a - Fraction(5, 4) * b for a, b in zip([Fraction(0), *root], [*root, Fraction(0)], strict=True)]
    (first,), (second,) = zeros(sturm.bernstein(root)), zeros(sturm.bernstein(other))
    assert first[0] == second[0]


@given(st.fractions(0, 5), st.fractions(0, 1))
def test_the_simplest_rational_is_inside_and_has_the_smallest_denominator(
    low: Fraction, gap: Fraction
) -> None:
    found = simplest(low, low + gap)
    assert low <= found <= low + gap
    for q in range(1, min(found.denominator, 50)):
        assert -(-low * q // 1) > (low + gap) * q


# First exits


def sampled_exit(formula: int, margins: Sequence[Sequence[Fraction]]) -> Exit:
    """By the definition, for margins given by their rational roots: signs at all of them and between."""

    def signs(s: Fraction) -> tuple[int, ...]:
        return tuple(sturm.sign(sturm.value(sturm.from_roots(m), s)) for m in margins)

    places = sorted({Fraction(0), *(r for m in margins for r in m if 0 < r < 1), Fraction(1)})
    for low, high in pairwise(places):
        between = signs((low + high) / 2)
        if not holds(formula, signs(low)):
            return Exit(True, False, low, signs(low), between)
        if not holds(formula, between):
            return Exit(True, True, low, signs(low), between)
    beyond = signs(1 + Fraction(1, 10**9))
    return Exit(
        not holds(formula, signs(Fraction(1))),
        holds(formula, signs(Fraction(1))),
        Fraction(1),
        signs(Fraction(1)),
        beyond,
    )


grid = st.integers(-4, 24).map(lambda k: Fraction(k, 20))
margin_roots = st.lists(st.lists(grid, max_size=4), min_size=MARGINS, max_size=MARGINS)
formulas = st.integers(0, len(FORMULAS) - 1)


@few_and_many_examples(75, 300, formulas, margin_roots)
def test_the_first_exit_is_where_the_formula_first_fails(formula: int, margins: list[list[Fraction]]) -> None:
    curves = [sturm.bernstein(sturm.from_roots(m)) for m in margins]
    at0, start = [sturm.sign(c[0]) for c in curves], [sign_after(c) for c in curves]
    found = first_exit(crossings(curves, start), at0, start, lambda s: holds(formula, s))
    assert found == sampled_exit(formula, margins)


def test_a_graze_ends_an_open_condition_but_not_a_closed_one() -> None:
    crossed = crossings([[Fraction(1), Fraction(-1), Fraction(1)]], [1])
    closed = first_exit(crossed, [1], [1], lambda s: s[0] >= 0)
    opened = first_exit(crossed, [1], [1], lambda s: s[0] > 0)
    assert (closed.found, closed.at, closed.sign_at) == (False, 1, (1,))
    assert (opened.found, opened.holds, opened.at, opened.sign_at) == (True, False, Fraction(1, 2), (0,))


def test_a_crossing_at_one_counts_only_if_the_formula_fails_there() -> None:
    crossed = crossings([[Fraction(1), Fraction(0)]], [1])
    closed = first_exit(crossed, [1], [1], lambda s: s[0] >= 0)
    opened = first_exit(crossed, [1], [1], lambda s: s[0] > 0)
    assert closed == Exit(False, True, Fraction(1), (0,), (-1,))
    assert opened == Exit(True, False, Fraction(1), (0,), (-1,))
