"""Laws of the initial-state sampler: every sample is valid, the law is uniform, refusals say why.

The auditor evaluates with fractions and shares no code with the sampler.
"""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from generators.ir_builder import PAPER, formula, model, term
from hypothesis import assume, example
from hypothesis import strategies as st
from oracles.initial_states import audited, audited_witness, definitions_of
from oracles.ir import SYMBOLS, exact, formulas, holds, terms
from selection import few_and_many, few_and_many_examples, quick_among

from dl2c.diagnostics import render
from dl2c.interval.arithmetic import Interval
from dl2c.ir.evaluate import evaluate as interp_value
from dl2c.ir.evaluate import truth as interp_truth
from dl2c.ir.model import Compare, Div, Neg, Number, Symbol
from dl2c.sampling.acceptance import NoErrorBound, acceptance, error_bound
from dl2c.sampling.arrays import holds as holds_on_arrays
from dl2c.sampling.draw import draw, draw_many
from dl2c.sampling.plan import NoSampler, plan_sampling
from dl2c.sampling.tables import SamplingPlan


def planned(m, **options):
    plan = plan_sampling(m, **options)
    assert isinstance(plan, SamplingPlan), render(plan.diagnostic)
    return plan


def refused(m):
    plan = plan_sampling(m)
    assert isinstance(plan, NoSampler)
    return plan.diagnostic


def symbols_of(m):
    """The symbol of every sampled name, with its bound."""
    return {
        **{Symbol(v.name, "variable"): v.bound for v in m.variables},
        **{Symbol(c.name, "constant"): c.bound for c in m.constants if c.value is None},
    }


def audit(m, plan, columns):
    """Every state satisfies the precondition; where equalities define names by rounded values, a real
    solution does whose defined names are within the stated error (tests/oracles/initial_states.py)."""
    fixed = {Symbol(c.name, "constant"): c.value for c in m.constants if c.value is not None}
    by_name = {s.name: s for s in symbols_of(m)}
    bounds = {s: (b.low, b.high) for s, b in symbols_of(m).items()}
    for row in zip(*(columns[n].tolist() for n in plan.names), strict=True):
        state = fixed | {by_name[n]: Fraction(v) for n, v in zip(plan.names, row, strict=True)}
        if plan.certificate == "exact":
            assert audited(m.precondition, bounds, state) == "yes"
            continue
        charts = [[(by_name[n], t) for n, t in d] for d in definitions_of(plan)]
        found = [audited_witness(m.precondition, bounds, state, c, plan.error_bound) for c in charts]
        assert "yes" in found, found


# Validity ---------------------------------------------------------------------

MODELS = [
    PAPER,
    model("x + y < 1 and x*y > 0.1", {"x": "0:1", "y": "0:1"}),
    model("x == 2*y + 0.1 and x > 0.3", {"x": "0:1", "y": "-5:5"}),
    model("v*v == 2*b*(m - x) and v > 1", {"v": "0:5", "x": "-100:100", "m": "0:50"}, {"b": "0.5:4"}),
    model("x == y + 1 and y == 2*z and z > 0.1", {"x": ":", "y": ":", "z": "0:1"}),
    model("x > 5 or x < 1 and y > x", {"x": "0:10", "y": "0:10"}),
    model("v**2/(2*B) < d and B > 0", {"v": "0:10", "d": "0:100"}, {"B": "0:5"}),
    model("1/x > 5", {"x": "-1:1"}),
    model("abs(x - y) <= 0.5 and min(x, y) >= 0.25 and max(x, y) < 0.9", {"x": "0:1", "y": "0:1"}),
    model("x == c and y >= x", {"x": ":", "y": "0:3"}, {}, {"c": "0.3"}),
    model("x != y and x >= y - 0.000001 and x <= y", {"x": "0:0.1", "y": "0:0.1"}),
    model("x > c", {"x": "0:1"}, {"c": "0.1:0.1"}),
    model("x == y + 0.1 and y == 0.2 and z >= x and x >= 0.3", {"x": ":0.3", "y": ":", "z": "0:1"}),
    model("mode == 1 and (mode == 0 and x > 1 or mode == 1 and x < 0.5)", {"x": "0:2", "mode": "0:3"}),
    model("True", {"x": "0.1:0.3"}),
    model("x == 3", {"x": "0:10"}),
    model("x*x + y*y == 1", {"x": "-1:1", "y": "-1:1"}),
    model("x*x + y*y == z*z and z > 0.1", {"x": "-1:1", "y": "-1:1", "z": "-2:2"}),
    model("x == 1 or x == y", {"x": "-1:1", "y": "-1:3"}),
    model("x*y == 0.1 and z > 0", {"x": "-1:1", "y": "-1:3", "z": "-1:1"}),
    model("x*y == 0 and z > 0", {"x": "-1:1", "y": "-1:3", "z": "-1:1"}),
    model("x == y/z and x > 0.5", {"x": "-1:1", "y": "-1:3", "z": "-1:1"}),
    model("max(1/x, y) > 2", {"x": "-1:1", "y": "-1:3"}),
    model("x == max(y, z) or x == abs(y)", {"x": "-1:1", "y": "-1:1", "z": "-1:1"}),
    model("x >= y and x <= y", {"x": "0:1", "y": "0:1"}),
    model("x*x - 3*x*y + y*y == z and z*x + y*y <= 1", {"x": "-1:1", "y": "-1:1", "z": "-1:1"}),
    model("u*u + v*v == 1 and r*w == z and x == u*r", dict.fromkeys("uvrwxz", "-2:2")),
]


def test_unequal_sides_in_one_case_split_the_states_of_two():
    """x = 0 with y > 0, and x = -y: a sampler per case, of which the first one says x != x + y."""
    m = model("-x == min(x, y) and x != x + y", {"x": "-2:2", "y": "-2:2"})
    drawn = draw_many(planned(m), np.random.default_rng(5), 4000)
    audit(m, planned(m), drawn)
    assert np.mean(drawn["x"] == 0) == pytest.approx(1 / (1 + math.sqrt(2)), abs=0.03)


@pytest.mark.parametrize("count", few_and_many(500, 3000))
@pytest.mark.parametrize("m", quick_among(MODELS, MODELS[1::3]), ids=lambda m: m.source[:30])
def test_every_sample_satisfies_the_precondition_exactly(count, m):
    plan = planned(m)
    audit(m, plan, draw_many(plan, np.random.default_rng(1), count))


@few_and_many_examples(15, 60, formulas)
def test_samples_of_random_preconditions_are_valid(f):
    m = replace(model("True", {s.name: "-2:3" for s in SYMBOLS}), precondition=f)
    plan = plan_sampling(m, boxes=8, time_limit_s=2.0)
    assume(isinstance(plan, SamplingPlan) and plan.estimated_acceptance > 1e-3)
    audit(m, plan, draw_many(plan, np.random.default_rng(2), 100))


def test_square_roots_keep_the_precondition():
    m = model("x == sqrt(y - 0.3) and x < 0.7", {"x": "0:1", "y": "0:1"})
    plan = planned(m)
    audit(m, plan, draw_many(plan, np.random.default_rng(3), 3000))


def test_acceptance_proves_atoms_at_their_boundary():
    """z close to x*y - x, which cancels: doubles alone accept what is false, the test never does."""
    x, y, z = SYMBOLS
    atom = formula("x*y - x > z")
    box = {x: Interval(0.0, 4.0), y: Interval(0.0, 4.0), z: Interval(-1.0, 1.0)}
    test = acceptance(atom, (), {}, box).formula
    rng, unsound = np.random.default_rng(4), 0
    for _ in range(4000):
        a, b = float(rng.uniform(1, 4)), float(rng.uniform(1, 1.1))
        c = a * b - a + int(rng.integers(-6, 7)) * math.ulp(a * b) / 8
        point = {s: Fraction(v) for s, v in zip(SYMBOLS, (a, b, c), strict=True)}
        columns = {n: np.array([v]) for n, v in zip("xyz", (a, b, c), strict=True)}
        unsound += bool(holds_on_arrays(atom, columns, 1)[0]) and not holds(atom, point)
        assert not holds_on_arrays(test, columns, 1)[0] or holds(atom, point)
    assert unsound > 50


@few_and_many_examples(75, 300, formulas, st.lists(st.floats(-2, 3), min_size=3, max_size=3))
@example(Compare("=", SYMBOLS[0], Neg(Div(SYMBOLS[0], SYMBOLS[0]))), [1.0, 0.0, 0.0])
def test_acceptance_in_doubles_implies_truth(f, numbers):
    box = {s: Interval(-2.0, 3.0) for s in SYMBOLS}
    try:
        test = acceptance(f, (), {}, box).formula
    except (NoErrorBound, AssertionError):
        return
    columns = {n: np.array([v]) for n, v in zip("xyz", numbers, strict=True)}
    if holds_on_arrays(test, columns, 1)[0]:
        assert holds(f, {s: Fraction(v) for s, v in zip(SYMBOLS, numbers, strict=True)})


@few_and_many_examples(100, 400, terms, st.lists(st.floats(-2, 3), min_size=3, max_size=3))
def test_error_bound_covers_the_rounding(t, numbers):
    box = {s: Interval(-2.0, 3.0) for s in SYMBOLS}
    try:
        bound = error_bound(t, box, dict.fromkeys(SYMBOLS, 0.0))
    except ArithmeticError:
        return
    real = exact(t, {s: Fraction(v) for s, v in zip(SYMBOLS, numbers, strict=True)})
    computed = float_value(t, dict(zip("xyz", numbers, strict=True)))
    assert real is not None
    assert abs(Fraction(computed) - real) <= Fraction(bound)


def float_value(t, point):
    """The term in doubles, through the interpreter."""
    return interp_value(t, {Symbol(n, "variable"): v for n, v in point.items()})


@few_and_many_examples(50, 200, formulas, st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
def test_arrays_agree_with_the_interpreter(f, numbers):
    columns = {n: np.array([v]) for n, v in zip("xyz", numbers, strict=True)}
    point = dict(zip(SYMBOLS, numbers, strict=True))
    assert bool(holds_on_arrays(f, columns, 1)[0]) == interp_truth(f, point)


# The law ----------------------------------------------------------------------


def rejected(rng, count):
    """The paper's initial states by plain rejection from the bounds."""
    found = []
    while sum(len(f) for f in found) < count:
        n = 2**19
        ep, b, a = rng.uniform(0.1, 0.5, n), rng.uniform(0.5, 5, n), rng.uniform(1, 10, n)
        g, vmax, time = rng.uniform(1, 10, n), rng.uniform(5, 30, n), rng.uniform(0, 1000, n)
        xr, xg = rng.uniform(0, 100, n), rng.uniform(0, 100, n)
        ok = (vmax >= 2 * a * ep) & (g > vmax * ep + vmax**2 / (2 * b)) & (xr < xg - g)
        ok &= time > ep + ((xg - xr) - g) / (a * ep) + ep + vmax / b
        found.append(np.stack([ep, b, a, g, vmax, time, xr, xg], axis=1)[ok])
    return np.concatenate(found)[:count]


def chi_squared_p(first, second):
    """p-value that two samples of equal size, as counts per cell, have one law (Wilson-Hilferty)."""
    both = first + second
    used = both >= 10
    statistic = float(np.sum((first - second)[used] ** 2 / both[used]))
    k = int(used.sum()) - 1
    z = ((statistic / k) ** (1 / 3) - (1 - 2 / (9 * k))) / math.sqrt(2 / (9 * k))
    return math.erfc(z / math.sqrt(2)) / 2


def test_law_is_that_of_plain_rejection():
    count, names = 30_000, ("ep", "b", "A", "GDelta", "Vmax", "T", "xr", "xg")
    reference = rejected(np.random.default_rng(5), count)
    drawn = draw_many(planned(PAPER), np.random.default_rng(6), count)
    sample = np.stack([drawn[n] for n in names], axis=1)
    for group in ((0, 1, 3, 4), (2, 5, 6, 7), (0, 2, 4, 6)):
        cells = [np.zeros(count, int), np.zeros(count, int)]
        for axis in group:
            cuts = np.quantile(reference[:, axis], [0.2, 0.4, 0.6, 0.8])
            for k, points in enumerate((reference, sample)):
                cells[k] = 5 * cells[k] + np.searchsorted(cuts, points[:, axis])
        counts = [np.bincount(c, minlength=625) for c in cells]
        assert chi_squared_p(*counts) > 0.01


def test_paving_raises_the_papers_acceptance():
    assert planned(PAPER, boxes=1).estimated_acceptance == pytest.approx(0.06, rel=0.2)
    plan = planned(PAPER, boxes=64)
    assert plan.estimated_acceptance > 0.28
    assert len(plan.blocks[-1].boxes) == 64
    assert math.fsum(b.weight for b in plan.blocks[-1].boxes) == pytest.approx(1)


def test_boxes_do_not_overlap():
    boxes = planned(PAPER, boxes=32).blocks[-1].boxes
    for k, a in enumerate(boxes):
        for b in boxes[:k]:
            gaps = zip(a.low, a.high, b.low, b.high, strict=True)
            assert any(ah <= bl or bh <= al for al, ah, bl, bh in gaps)


def test_plan_is_a_function_of_the_model():
    assert planned(PAPER, boxes=16) == planned(PAPER, boxes=16)


def test_draw_gives_every_name_a_double():
    state = draw(planned(PAPER, boxes=4), np.random.default_rng(7))
    assert tuple(state) == PAPER.sampled
    assert all(type(v) is float for v in state.values())


# Equalities -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "definitions", "certificate"),
    [
        ("x == 2", {"x": "2"}, "exact"),
        ("0.1 == x", {"x": "0.1"}, "witness"),
        ("x == y", {"x": "y"}, "exact"),
        ("x - y == 3", {"x": "3 + y"}, "exact"),
        ("2*x + y == 1", None, "exact"),
        ("3*x + y == 1", None, "exact"),
        ("3*x + 3*y == z", None, "exact"),
        ("3*x + 3*y == 7*z", None, "witness"),
        ("x == y + 0.1", None, "witness"),
        ("x == 0.75*y - z/4 + 3", None, "exact"),
        ("x == y and y == 0.5*z", {"x": "y", "y": "0.5*z"}, "exact"),
        ("x == y and y == x and x == z", None, "exact"),
        ("y*x == z and y > 0.5", None, "witness"),
        ("x == c", {"x": "1.5"}, "exact"),
        ("x == 1 and (x == 1 or y > 2)", {"x": "1"}, "exact"),
    ],
)
def test_equalities_become_definitions(text, definitions, certificate):
    m = model(text, {"x": "-5:5", "y": "-5:5", "z": "-5:5"}, {}, {"c": "1.5"})
    plan = planned(m)
    assert plan.certificate == certificate
    (found,) = definitions_of(plan)
    seen = {n for c in plan.charts for n in c.free}
    assert seen | {n for n, _ in found} == set(plan.names)
    for name, definition in found:
        assert {s for s in "xyz" if Symbol(s, "variable") in leaves_of(definition)} <= seen
        seen.add(name)
    if definitions is not None:
        assert dict(found) == {n: term(t) for n, t in definitions.items()}
    audit(m, plan, draw_many(plan, np.random.default_rng(8), 500))


def leaves_of(t):
    if isinstance(t, (Symbol, Number)):
        return {t}
    parts = [getattr(t, slot) for slot in t.__slots__]
    flat = [p for part in parts for p in (part if isinstance(part, tuple) else (part,))]
    return set().union(*(leaves_of(p) for p in flat if not isinstance(p, (int, str))))


def test_names_that_cannot_be_zero_are_cancelled():
    """The tangent of a circle around (cx, cy) has length 1 wherever the radius is not 0."""
    m = model(
        "dx == (cy - y)/r and dy == (x - cx)/r and (x - cx)*(x - cx) + (y - cy)*(y - cy) == r*r and r > 0",
        dict.fromkeys(["dx", "dy", "x", "y", "cx", "cy"], "-10:10") | {"r": "0:10"},
    )
    plan = planned(m)
    assert plan.estimated_acceptance > 0.1
    audit(m, plan, draw_many(plan, np.random.default_rng(10), 1000))


def test_bounds_of_defined_names_are_checked():
    plan = planned(model("x == 2*y", {"x": "0:1", "y": "-5:5"}))
    columns = draw_many(plan, np.random.default_rng(9), 2000)
    assert columns["x"].min() >= 0 and columns["x"].max() <= 1


@pytest.mark.parametrize(
    ("text", "point"),
    [
        ("x**2 + y**2 == 0", (0, 0)),
        ("(x - 1)**2 + 2*(y + 3)**2 == 0 and z > 1/2", (1, -3)),
        ("0 == 0 - x*x - 3*(y - x)**4", (0, 0)),
        ("x**2/3 == 0 - (y - 2)**2", (0, 2)),
        ("x**2 + y**2 + 5 == 2*x + 4*y", (1, 2)),
        ("2*x*y == 2*x**2 + y**2 - 4*x + 4", (2, 2)),
    ],
)
def test_where_a_sum_of_squares_is_zero_is_a_point(text, point):
    m = model(text, {"x": "-9:9", "y": "-9:9", "z": "0:1"})
    plan = planned(m)
    columns = draw_many(plan, np.random.default_rng(10), 20)
    assert plan.certificate == "exact"
    assert [set(columns[n].tolist()) for n in "xy"] == [{float(v)} for v in point]
    assert len(set(columns["z"].tolist())) == 20
    audit(m, plan, columns)


# Refusals ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("x**13 + y**13 + z**13 + x*y*z == 1", "x**13 + y**13"),
        ("sin(x) > 0.5", "sin(x) > 0.5"),
        ("y == sqrt(x)*z and x > z", "infinitely steep"),
    ],
)
def test_refusal_names_the_subformula(text, named):
    diagnostic = refused(model(text, {"x": "-1:1", "y": "-1:3", "z": "-1:1"}))
    assert diagnostic.code == "unsampled-precondition"
    assert named in diagnostic.span.text or named in diagnostic.label


def test_unbounded_names_are_listed_with_advice():
    diagnostic = refused(model("x > y and c > 0", {"x": ":", "y": "0:1", "z": ":"}, {"c": "0:"}))
    assert diagnostic.code == "unbounded-variable"
    assert "`x`, `z`, `c`" in diagnostic.title
    assert diagnostic.span.place == "declarations.kyx:1:1"
    assert "bound=[lo:hi]" in diagnostic.help


def test_limits_may_come_from_the_precondition():
    plan = planned(model("x > y and x*x <= 4", {"x": ":", "y": "0:"}))
    assert plan.boxes[0].low[0] >= 0 and plan.boxes[0].high[0] <= 2


def test_contradictions_are_refused_in_the_users_words():
    diagnostic = refused(model("x > 5 and x < 3", {"x": "0:10"}))
    assert diagnostic.code == "unsatisfiable-precondition"
    assert [n.split(" (")[0] for n in diagnostic.notes] == ["x > 5", "x < 3"]


def test_sets_too_thin_to_hit_are_refused():
    diagnostic = refused(model("(x - y)*(x - y) <= 0", {"x": "0:1", "y": "0:1"}))
    assert diagnostic.code == "unsampled-precondition"
    assert "too rare" in diagnostic.label
