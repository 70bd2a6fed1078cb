"""Tests of a single `x := *` of degree above 2: its values, masks and what stays refused."""

from fractions import Fraction
from itertools import pairwise
from math import nextafter
from pathlib import Path
from random import Random

import numpy as np
import pytest
from differential import pair_of
from generators.kyx_builder import codes, paths_of
from selection import few_and_many, quick_among

from dl2c.diagnostics import CompileError
from dl2c.paths.zeros import zeros

VARIABLES = "/* @var: bound=[-3:3] */ Real v;\n/* @var: bound=[-9:9] */ Real x;"


def polynomial(rng: Random, degree: int) -> list[Fraction]:
    """Some with multiple roots."""
    if rng.random() < 0.4:
        c = [Fraction(rng.choice((-1, 1)))]
        for _ in range(degree):
            root = Fraction(rng.randint(-8, 8), 4)
            c = [a - root * b for a, b in zip([Fraction(0), *c], [*c, Fraction(0)], strict=True)]
        return c
    return [Fraction(rng.randint(-12, 12), 4) for _ in range(degree)] + [Fraction(rng.choice((-2, -1, 1, 3)))]


def at(c: list[Fraction], u: float) -> Fraction:
    value = Fraction(0)
    for a in reversed(c):
        value = value * Fraction(u) + a
    return value


@pytest.mark.parametrize("count", few_and_many(4, 12))
@pytest.mark.parametrize("degree", quick_among((3, 4, 5, 8, 12), (3, 4, 5, 8)))
def test_every_zero_is_found(count: int, degree: int) -> None:
    """Between two neighbours of the zeros and turning points the sign is one, in doubles and rationals."""
    rng = Random(degree)
    for _ in range(count):
        c = polynomial(rng, degree)
        for exact in (False, True):
            found = zeros(c, Fraction(-3) if exact else -3.0, Fraction(3) if exact else 3.0, True, exact)
            places = sorted({-3.0, 3.0, *(float(z) for z in found if -3 < z < 3)})
            for a, b in pairwise(places):
                inside = [a + (b - a) * k / 16 for k in range(1, 16)]
                wide = [u for u in inside if min(u - a, b - u) > 1e-2]
                signs = {at(c, u) > 0 for u in wide if at(c, u) != 0}
                assert len(signs) <= 1, (c, places)
        real = [r.real for r in np.roots([float(a) for a in reversed(c)]) if abs(r.imag) < 1e-12]
        for r in real:
            if -2.99 < r < 2.99:
                assert min(abs(float(z) - r) for z in found) < 1e-2


@pytest.mark.parametrize("count", few_and_many(15, 60))
@pytest.mark.parametrize(
    ("test", "margin"),
    [
        ("v^3 - 3*v <= x", lambda v, x: x - (v**3 - 3 * v)),
        ("v^4 - 5*v^2 + x > 0", lambda v, x: v**4 - 5 * v**2 + x),
        ("v*v*v*v*v >= x - v", lambda v, x: v**5 - x + v),
        ("x*v^6 < 2 - v^3", lambda v, x: 2 - v**3 - x * v**6),
    ],
)
def test_the_nearest_value_that_passes_is_taken(
    count: int, test: str, margin: object, tmp_path: Path
) -> None:
    pair = pair_of(f"v := *; ?{test};", tmp_path, VARIABLES)
    rng = Random(7)
    for _ in range(count):
        state = {"v": rng.uniform(-3, 3), "x": rng.uniform(-9, 9)}
        wanted = rng.uniform(-3.2, 3.2)
        start = margin(wanted, state["x"])  # pyright: ignore[reportCallIssue]
        step = pair.step_from(state, {}, {}, {"assign_v": wanted})
        if step.blocked or step.reason:
            continue
        v = float(step.state["v"])
        exact = margin(Fraction(v), Fraction(state["x"]))  # pyright: ignore[reportCallIssue]
        assert exact > -1e-12 and -3 <= v <= 3
        if -3 <= wanted <= 3 and start > 0:
            assert v == wanted
        distance = abs(v - wanted)
        for k in range(2000):
            u = -3 + 6 * k / 2000
            if abs(u - wanted) < distance - 1e-9:
                assert margin(u, state["x"]) <= 1e-12  # pyright: ignore[reportCallIssue]
    assert pair.seen["steps"] == count


def test_equalities_take_their_zeros_and_masks_know_whether_there_is_one(tmp_path: Path) -> None:
    pair = pair_of(
        "{v := *; ?v^3 = x; ++ v := *; ?v^4 + 1 = x; ++ v := *; ?(v - 1)^4 <= 0;}", tmp_path, VARIABLES
    )
    for x in (-8.0, -1.0, 0.0, 0.5, 1.0, 2.0, 8.9):
        pair.batch.set_state(0, [0.0, x], [])
        assert pair.batch.mask[0].tolist() == [1, int(x >= 1), 1]
        for choice, want in ((0, np.cbrt(x)), (1, max(0.0, x - 1) ** 0.25), (2, 1.0)):
            inputs = dict.fromkeys(("assign_v", "assign_v_1", "assign_v_2"), 3.0)
            step = pair.step_from({"v": 0.0, "x": x}, {}, {"choice_0": choice}, inputs)
            assert step.blocked == (choice == 1 and x < 1)
            if not step.blocked:
                assert float(step.state["v"]) == pytest.approx(want, abs=1e-9)


def test_doubles_and_rationals_agree_and_ends_count() -> None:
    c = [Fraction(-27), Fraction(0), Fraction(0), Fraction(1)]
    assert zeros(c, -3.0, 3.0, False, False) == [3.0]
    (above,) = zeros(c, -3.0, nextafter(3.0, 4.0) + 1, False, False)
    assert above == 3.0
    (near,) = zeros(c, Fraction(-4), Fraction(5), False, True)
    assert abs(near - 3) < Fraction(1, 10**18)
    assert zeros([Fraction(1), *[Fraction(0)] * 3, Fraction(1)], -3.0, 3.0, False, False) == []
    assert zeros([Fraction(1), *[Fraction(0)] * 3, Fraction(1)], -3.0, 3.0, True, False) != []


@pytest.mark.parametrize("test", ["v^13 <= x", "sin(v) <= x", "v^3*w <= x"])
def test_higher_degrees_and_joint_ones_are_refused(test: str) -> None:
    program = f"w := *; ?0 <= w & w <= 1; v := *; ?-1 <= v & v <= 1; ?{test};"
    with pytest.raises(CompileError) as refused:
        paths_of(f"true -> [{{{program}}}*] true", "", "Real v; Real w; Real x;")
    assert codes(refused.value) == ["unresolved-test"]
