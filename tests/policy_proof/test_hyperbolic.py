"""Enclosures of tanh in the checker's numbers hold and are as narrow as can be; one unit less is found."""

from collections.abc import Callable, Iterator
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from dl2c.policy_proof.fixed_point import ONE, ROUNDINGS, SCALE, down, up
from dl2c.policy_proof.hyperbolic import SATURATED, lines_around, tanh_at
from dl2c.policy_proof.tables import ARITHMETIC


def exact(z: int) -> Fraction:
    """tanh(z) in units, closer than 2^-200 of a unit."""
    with mpmath.workprec(SCALE + 400):
        value = mpmath.tanh(mpmath.ldexp(mpmath.mpf(z), -SCALE))
        sign, digits, exponent, _ = mpmath.ldexp(value, SCALE)._mpf_
    return (-1) ** sign * Fraction(int(digits)) * Fraction(2) ** int(exponent)


CLOSE = Fraction(1, 2**200)
"""What the reference may be wrong by."""


def hard() -> Iterator[int]:
    """Around 0, where 1 - tanh falls below a unit, where arguments are halved once more, and far away."""
    last = 33 * ONE + ONE // 4
    marks = [0, down(Fraction(5e-324)), up(Fraction(5e-324)), up(Fraction(2.0**-1022)), SATURATED, last]
    marks += [1 << k for k in range(SCALE + 8)] + [(1 << k) // 3 for k in range(2, SCALE + 8)]
    marks += [SATURATED * 2, ONE << 20, ONE << 1000, 1 << 5000]
    for mark in marks:
        yield from (sign * (mark + d) for d in (-2, -1, 0, 1, 2) for sign in (-1, 1))


def many(seed: int, count: int) -> Iterator[int]:
    """Of every size between a unit and 64."""
    rng = np.random.default_rng(seed)
    for size in rng.uniform(-SCALE, 6, count):
        yield int(rng.choice([-1, 1])) * int(2 ** (size + 60) * rng.uniform(1, 2)) << SCALE - 60


def wrong_at(tanh: Callable[[int], tuple[int, int]], points: Iterator[int]) -> int:
    """At how many points the enclosure does not hold."""
    count = 0
    for z in points:
        (low, high), value = tanh(z), exact(z)
        count += not low <= value + CLOSE or not value - CLOSE <= high
    return count


def test_it_encloses() -> None:
    assert wrong_at(tanh_at, hard()) == 0
    assert wrong_at(tanh_at, many(0, 3000)) == 0


def test_it_is_a_unit_wide() -> None:
    """Two where the value is almost a whole number of units, as it is for small ones."""
    widths = [high - low for low, high in map(tanh_at, hard())]
    assert max(widths) <= 2
    widths = [high - low for low, high in map(tanh_at, many(1, 500))]
    assert max(widths) <= 2 and widths.count(1) > 0.7 * len(widths)


@pytest.mark.parametrize("narrower", [(1, 0), (0, -1)])
def test_one_unit_less_is_found(narrower: tuple[int, int]) -> None:
    def planted(z: int) -> tuple[int, int]:
        low, high = tanh_at(z)
        return low + narrower[0], high + narrower[1]

    assert wrong_at(planted, many(2, 300)) > 100
    assert wrong_at(planted, hard()) > 100


def below_and_above(lines: tuple[int, int, int], low: int, high: int, shares: list[float]) -> bool:
    """Whether lines are below and above tanh at both ends and at some points between."""
    slope, under, over = lines
    points = [low + (int(share * 2**53) * (high - low) >> 53) for share in shares]
    for z in (low, high, *points):
        value, line = exact(z), Fraction(slope * z, ONE)
        if not line + under <= value + CLOSE or not value - CLOSE <= line + over:
            return False
    return True


def intervals(seed: int, count: int) -> Iterator[tuple[int, int]]:
    rng = np.random.default_rng(seed)
    for z in many(seed, count):
        yield z, z + (int(2.0 ** rng.uniform(0, 66)) << max(0, int(rng.integers(0, 36))))
    yield from ((-z, z) for z in (0, 1, 7, ONE, SATURATED - 1, SATURATED, ONE << 1000))
    yield from ((z, z) for z in (0, -1, ONE // 7, -SATURATED, SATURATED))


def test_lines_are_below_and_above() -> None:
    rng = np.random.default_rng(5)
    for low, high in intervals(3, 400):
        assert below_and_above(lines_around(low, high), low, high, rng.uniform(0, 1, 8).tolist())


PLANTED = {"below": (0, 2, 0), "above": (0, 0, -2), "slope": (2**60, 0, 0)}
"""Two units, since an offset is rounded twice."""


@pytest.mark.parametrize("name", PLANTED)
def test_narrower_lines_are_found(name: str) -> None:
    rng, wrong = np.random.default_rng(5), 0
    for low, high in intervals(4, 200):
        slope, under, over = map(sum, zip(lines_around(low, high), PLANTED[name], strict=True))
        wrong += not below_and_above((slope, under, over), low, high, rng.uniform(0, 1, 8).tolist())
    assert wrong > 50


def test_roundings_are_those_that_are_stated() -> None:
    for name, (unit, smallest, largest, library) in ARITHMETIC.items():
        stated = ROUNDINGS[name]
        assert unit == (2.0**-stated.bits if stated.bits else 0.0)
        assert Fraction(stated.library, ONE) == Fraction(library)
        assert name == "real" or Fraction(stated.largest, ONE) == Fraction(largest)
        for size, count in ((0, 1), (1, 1), (ONE, 9), (12345 * ONE, 300), (ONE << 900, 2)):
            least = 2 * count * (Fraction(unit) * Fraction(size, ONE) + Fraction(smallest))
            assert Fraction(stated.error(size, count), ONE) >= least
