"""Zeros of curves and first exits: certain, the same in C and Python, exact in rationals."""

import shutil
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from random import Random

import pytest
import sturm
from hypothesis import example, given, settings
from hypothesis import strategies as st
from native_roots import FORMULAS, MARGINS, NativeRoots, compile_roots, holds

from dl2c.ir.roots import Crossing, Curve, Exit, crossings, curve_at, curve_of, first_exit, sign_after
from dl2c.ir.roots_exact import simplest
from dl2c.ir.roots_float import AT_ONCE
from dl2c.native.toolchain import find_compiler

CERTAIN = Fraction(1, 2**40)
"""Where a curve exceeds this part of its largest coefficient, its sign is certain."""


@pytest.fixture(scope="session")
def native(tmp_path_factory: pytest.TempPathFactory) -> NativeRoots:
    return NativeRoots(compile_roots(tmp_path_factory.mktemp("roots"), find_compiler().command))


def zeros(curve: Curve, start: int | None = None) -> list[tuple[float | Fraction, int]]:
    return [(c.at, c.after) for c in crossings([curve], [sign_after(curve) if start is None else start])]


def floats(curve: Sequence[Fraction]) -> list[float]:
    return [float(b) for b in curve]


def rationals(curve: Sequence[float]) -> list[Fraction]:
    return [Fraction(b) for b in curve]


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


def random_curve(random: Random) -> list[float]:
    degree = random.choice((0, 1, 2, 2, 3, 4, 6, 9, 12, 24))
    match random.randrange(5):
        case 0:
            return [float(random.randint(-3, 3)) for _ in range(degree + 1)]
        case 1:
            return [random.uniform(-1, 1) for _ in range(degree + 1)]
        case 2:
            return [random.uniform(-1, 1) * 10 ** random.uniform(-300, 300) for _ in range(degree + 1)]
        case _:
            scale = 10.0 ** random.choice((0, 0, 0, -300, -100, 280))
            c = floats(sturm.from_roots(random_roots(random, degree)))
            return [float(b) for b in curve_of([x * scale for x in c], 1.0)]


def random_start(random: Random, curve: Curve) -> int:
    return random.choice((-1, 0, 1)) if random.random() < 0.2 else sign_after(curve)


# C and Python


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_roots_compile_without_warnings(compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    library = NativeRoots(compile_roots(tmp_path, (compiler,)))
    assert library.crossings([[1.0, -1.0]], [1]) == [Crossing(0.5, 0, -1)]


def test_c_and_python_find_the_same_bits(native: NativeRoots) -> None:
    random = Random(1)
    found = 0
    for _ in range(3000):
        curves = [random_curve(random) for _ in range(random.randint(1, 3))]
        start = [random_start(random, c) for c in curves]
        expected = crossings(curves, start)
        assert native.crossings(curves, start) == expected, (curves, start)
        assert [native.sign_after(c) for c in curves] == [sign_after(c) for c in curves]
        found += len(expected)
    assert found > 5000


def test_c_and_python_make_and_evaluate_the_same_curves(native: NativeRoots) -> None:
    random = Random(2)
    for _ in range(1000):
        c = [random.uniform(-9, 9) for _ in range(random.randint(1, 25))]
        length, s = random.uniform(0, 30), random.random()
        curve = curve_of(c, length)
        assert native.curve_of(c, length) == curve
        assert native.curve_at(floats(curve), s) == curve_at(curve, s)


def test_crossings_that_do_not_fit_are_refused(native: NativeRoots) -> None:
    curve = [1.0, -1.0, -1.0, 1.0]
    assert native.crossings([curve], [1], 2) == crossings([curve], [1])
    assert native.crossings([curve], [1], 1) is None
    assert native.crossings([[1.0, 2.0]], [1], 0) == []


# Curves


@given(st.lists(st.fractions(-9, 9, max_denominator=20), min_size=1, max_size=9), st.fractions(0, 5))
def test_a_curve_is_the_polynomial_it_is_made_of(c: list[Fraction], length: Fraction) -> None:
    curve = curve_of(c, length)
    for s in (Fraction(0), Fraction(1, 3), Fraction(1)):
        assert curve_at(curve, s) == sturm.value(c, s * length) == sturm.at(rationals(curve), s)


# What is certain in doubles


def assert_certain(curve: Sequence[float], places: Sequence[Fraction]) -> None:
    """The claims of roots.h, checked with exact values."""
    top, start = max(abs(Fraction(b)) for b in curve), sign_after(curve)
    found = zeros(curve)
    assert all(a[0] < b[0] for a, b in pairwise(found)), "zeros come in order, each once"
    assert all(0 < at <= 1 and abs(sturm.at(curve, Fraction(at))) <= CERTAIN * top for at, _ in found)
    for s in places:
        value = sturm.at(curve, s)
        if abs(value) > CERTAIN * top:
            assert sturm.sign(value) == ([start] + [after for at, after in found if at <= s])[-1], float(s)


@pytest.mark.parametrize("seed", range(4))
def test_signs_are_certain_wherever_rounding_does_not_decide(seed: int) -> None:
    random = Random(seed)
    for _ in range(150):
        curve = random_curve(random)
        if len(curve) > 13 or sign_after(curve) == 0:
            continue
        places = [Fraction(random.random()) for _ in range(8)] + [Fraction(1)]
        for at, _ in zeros(curve):
            gap = Fraction(10) ** -random.randint(1, 15)
            places += [s for s in (Fraction(at) * (1 - gap), Fraction(at) * (1 + gap)) if 0 < s <= 1]
        assert_certain(curve, places)


roots_apart = st.lists(st.integers(0, 60), min_size=1, max_size=6, unique=True)


@given(roots_apart, st.integers(-300, 300), st.booleans())
def test_simple_zeros_are_found_where_they_are(places: list[int], exponent: int, negative: bool) -> None:
    roots = sorted(Fraction(k, 40) for k in places)
    scale = Fraction(10) ** exponent * (-1 if negative else 1)
    inside = [float(r) for r in roots if 0 < r <= 1]
    curve = sturm.bernstein(sturm.from_roots(roots, scale))
    if exponent > 298 or sign_after(floats(curve)) != sign_after(curve):
        return
    if 1 in roots:
        curve[-1] = Fraction(0)
    found = [float(at) for at, _ in zeros(floats(curve))]
    assert found == pytest.approx(inside, abs=1e-9)
    assert [s for _, s in zeros(floats(curve))] == [s for _, s in zeros(curve)]


@given(st.integers(1, 39), st.integers(2, 5), st.sampled_from([Fraction(-1, 2), Fraction(3, 2)]))
def test_a_multiple_zero_is_one_crossing_that_turns_the_sign_if_odd(
    k: int, order: int, other: Fraction
) -> None:
    root = Fraction(k, 40)
    curve = sturm.bernstein(sturm.from_roots([root] * order + [other]))
    assert len(zeros(curve)) == 1
    found = zeros(floats(curve))
    assert all(float(at) == pytest.approx(root, abs=1e-2 if order > 3 else 1e-4) for at, _ in found)
    if order % 2:
        assert found[-1][1] == zeros(curve)[0][1] != sign_after(curve)
    else:
        assert all(after == sign_after(curve) for _, after in found[-1:])


@given(st.integers(1, 39), st.integers(3, 9), st.integers(0, 3))
def test_clustered_zeros_keep_the_sign_beyond_them(k: int, digits: int, extra: int) -> None:
    roots = [Fraction(k, 40), Fraction(k, 40) + Fraction(1, 10**digits)] + [Fraction(5, 4)] * extra
    curve = floats(sturm.bernstein(sturm.from_roots(roots)))
    found = zeros(curve)
    assert all(abs(float(at) - k / 40) < 1.5 * 10.0**-digits + 1e-6 for at, _ in found)
    assert all(after == sign_after(curve) for _, after in found[-1:])
    assert digits > 6 or len(found) == 2


@given(st.integers(0, 2**32), st.integers(-1000, 1000))
def test_zeros_do_not_depend_on_the_scale(seed: int, exponent: int) -> None:
    random = Random(seed)
    curve = [random.uniform(-1, 1) * random.choice((0.0, 1.0, 1.0)) for _ in range(random.randint(1, 9))]
    assert zeros([b * 2.0**exponent for b in curve]) == zeros(curve)


@pytest.mark.parametrize(
    ("curve", "expected"),
    [
        ([1.0], []),
        ([0.0, 0.0, 0.0], []),
        ([1.0, 0.0, 1.0], []),
        ([1.0, -1.0, 1.0], [(0.5, 1)]),
        ([0.25, -0.75, 2.25], [(0.25, 1)]),
        ([1.0, -1.0], [(0.5, -1)]),
        ([1.0, 0.0], [(1.0, -1)]),
        ([1.0, 0.0, 0.0], [(1.0, 1)]),
        ([-1.0, 0.0, 0.0, 0.0], [(1.0, 1)]),
        ([0.0, 1.0], []),
        ([0.0, 0.0, -1.0], []),
        ([0.0, 1.0, 0.0], [(1.0, -1)]),
        ([0.0, 1.0, -2.0], [(0.5, -1)]),
        ([1.0, -3.0], [(0.25, -1)]),
        ([3.0, -5.0, 3.0], [(0.25, -1), (0.75, 1)]),
        ([1e-18, 1.0, 1.0], []),
        ([1e-18, -1.0], [(1e-18, -1)]),
        ([1e-300, 1.0, -1e-300], [(1.0, -1)]),
    ],
)
def test_zeros_at_special_places(curve: list[float], expected: list[tuple[float, int]]) -> None:
    found = zeros(curve)
    assert [at for at, _ in found] == pytest.approx([at for at, _ in expected], rel=1e-15)
    assert [after for _, after in found] == [after for _, after in expected]


def test_what_contradicts_the_start_is_noise_or_crosses_at_once() -> None:
    assert zeros([0.0, -1e-17, 1.0], 1) == []
    assert zeros([-1e-9, 1.0, 2.0], 1) == []
    assert zeros([-1e-9, 1.0, -1.0], 1) == zeros([0.0, 1.0, -1.0], 1)
    assert zeros([0.0, -1.0, -1.0], 1) == zeros([-1.0], 1) == [(AT_ONCE, -1)]
    assert zeros([-0.5, 1.0], 1) == [(AT_ONCE, -1), (pytest.approx(1 / 3), 1)]
    assert zeros([Fraction(-1), Fraction(2)], 1) == [(AT_ONCE, -1), (Fraction(1, 3), 1)]
    assert zeros([1.0, -1.0], 0) == zeros([Fraction(1), Fraction(-1)], 0) == []


def test_a_curve_that_begins_close_to_zero_does_not_touch_it() -> None:
    for tiny in (1e-16, 1e-18, 1e-30, 1e-200):
        assert zeros([tiny, 1.0, -1.0, 20.0, -30.0])[0][0] > 0.1


# Rationals


def assert_exact(curve: Sequence[Fraction]) -> None:
    """One crossing for every zero that a Sturm sequence counts, with the signs beside it."""
    chain = sturm.sturm(sturm.monomial(curve))
    found = [(Fraction(at), after) for at, after in zeros(curve)]
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


@given(formulas, margin_roots)
@settings(max_examples=300)
def test_the_first_exit_is_where_the_formula_first_fails(formula: int, margins: list[list[Fraction]]) -> None:
    curves = [sturm.bernstein(sturm.from_roots(m)) for m in margins]
    at0, start = [sturm.sign(c[0]) for c in curves], [sign_after(c) for c in curves]
    found = first_exit(crossings(curves, start), at0, start, lambda s: holds(formula, s), exact=True)
    assert found == sampled_exit(formula, margins)


@given(formulas, margin_roots)
@settings(max_examples=300)
def test_c_and_python_leave_at_the_same_place(
    native: NativeRoots, formula: int, margins: list[list[Fraction]]
) -> None:
    exact = [sturm.bernstein(sturm.from_roots(m)) for m in margins]
    curves = [floats(c) for c in exact]
    at0, start = [sturm.sign(c[0]) for c in exact], [sign_after(c) for c in exact]
    crossed = crossings(curves, start)
    leave = first_exit(crossed, at0, start, lambda s: holds(formula, s))
    assert native.first_exit(formula, crossed, at0, start) == leave


@given(st.sampled_from([0, 4]), st.lists(roots_apart, min_size=MARGINS, max_size=MARGINS))
def test_doubles_leave_a_closed_domain_where_rationals_do(formula: int, places: list[list[int]]) -> None:
    margins = [[Fraction(3 * k + m, 130) for k in row] for m, row in enumerate(places)]
    exact = [sturm.bernstein(sturm.from_roots(m)) for m in margins]
    at0, start = [sturm.sign(c[0]) for c in exact], [sign_after(c) for c in exact]
    found = first_exit(crossings([floats(c) for c in exact], start), at0, start, lambda s: holds(formula, s))
    expected = sampled_exit(formula, margins)
    assert (found.found, found.holds) == (expected.found, expected.holds)
    assert float(found.at) == pytest.approx(float(expected.at), abs=1e-9)


def test_a_graze_ends_an_open_condition_but_not_a_closed_one() -> None:
    crossed = crossings([[1.0, -1.0, 1.0]], [1])
    closed = first_exit(crossed, [1], [1], lambda s: s[0] >= 0)
    opened = first_exit(crossed, [1], [1], lambda s: s[0] > 0)
    assert (closed.found, closed.at, closed.sign_at) == (False, 1.0, (1,))
    assert (opened.found, opened.holds, opened.at, opened.sign_at) == (True, False, 0.5, (0,))


def test_a_crossing_at_one_counts_only_if_the_formula_fails_there() -> None:
    crossed = crossings([[1.0, 0.0]], [1])
    closed = first_exit(crossed, [1], [1], lambda s: s[0] >= 0)
    opened = first_exit(crossed, [1], [1], lambda s: s[0] > 0)
    assert closed == Exit(False, True, 1.0, (0,), (-1,))
    assert opened == Exit(True, False, 1.0, (0,), (-1,))


def test_print_how_long_a_curve_takes(native: NativeRoots, capsys: pytest.CaptureFixture[str]) -> None:
    random = Random(3)
    rows: list[str] = []
    for degree in (2, 3, 6, 12):
        same = [[random.uniform(0.1, 1) for _ in range(degree + 1)] for _ in range(200)]
        one = [[b if i <= degree // 2 else -b for i, b in enumerate(c)] for c in same]
        mixed = [[random.uniform(-1, 1) for _ in range(degree + 1)] for _ in range(200)]
        times = [native.nanoseconds(c, [sign_after(x) for x in c], 50) for c in (same, one, mixed)]
        rows.append(f"degree {degree:2}: no zero {times[0]:.0f} ns, one {times[1]:.0f}, mixed {times[2]:.0f}")
    with capsys.disabled():
        print("", *rows, sep="\n")
