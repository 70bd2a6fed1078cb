"""Signs of polynomials along a motion: exact, quick for domains with many conditions, and never over time."""

import time
from collections.abc import Sequence
from fractions import Fraction

import pytest
from flint import fmpq, fmpq_poly
from hypothesis import given
from hypothesis import strategies as st
from oracles.exact_time import points, product
from slowness import slowness

from dl2c.parse import tree
from dl2c.parse.parser import parse_program
from dl2c.verify.arithmetic.exact import Run
from dl2c.verify.arithmetic.prover import OutOfTime
from dl2c.verify.arithmetic.roots import sign_vectors

small = st.integers(-4, 4).map(Fraction)
linear = st.tuples(small, st.sampled_from([Fraction(1), Fraction(-2), Fraction(3)]))
quadratic = st.tuples(small, small, st.sampled_from([Fraction(1), Fraction(-1), Fraction(2)]))
factors = st.lists(linear | quadratic, max_size=3)


def multiplied(parts: Sequence[Sequence[Fraction]]) -> list[Fraction]:
    found = [Fraction(1)]
    for part in parts:
        found = list(product(found, part))
    return found


def polynomial(coefficients: Sequence[Fraction]) -> fmpq_poly:
    return fmpq_poly([fmpq(c.numerator, c.denominator) for c in coefficients])


@given(st.lists(factors, max_size=4), st.sampled_from([Fraction(1), Fraction(5, 2), Fraction(4)]))
def test_every_combination_of_signs_is_met(parts: list[list[tuple[Fraction, ...]]], until: Fraction) -> None:
    margins = [multiplied(p) for p in parts]
    expected = {tuple(point(m) for m in margins) for point in points(margins, Fraction(0), until)}
    assert {tuple(signs) for signs in sign_vectors([polynomial(m) for m in margins], until)} == expected


def motion(conditions: int) -> tree.Program:
    """One whose domain has so many different quadratic conditions."""
    parts = (f"(x-{k}/7)*(x-{k}/11) <= {k}/13" for k in range(1, conditions + 1))
    return parse_program("{x'=1 & " + " & ".join(f"({p} | x >= -1)" for p in parts) + "}")


def run() -> Run:
    return Run({"x": Fraction(0)}, [(("duration", 0), Fraction(50))])


def test_many_conditions_are_checked_quickly() -> None:
    begun = time.process_time()
    run().follow(motion(150))
    assert time.process_time() - begun < 10 * slowness()


def test_a_check_ends_when_its_time_is_over() -> None:
    ended = run()
    asked = 0

    def in_time() -> None:
        nonlocal asked
        asked += 1
        if asked > 3:
            raise OutOfTime

    ended.in_time = in_time
    with pytest.raises(OutOfTime):
        ended.follow(motion(5))
