"""Initial states are uniform on the set that the precondition leaves, in whatever way they are drawn.

References draw by other means: by rejection from parameters of the curve or surface, with its length or
area worked out by hand. The drawn states and the reference's are counted in the same cells.
"""

import math
from functools import cache

import numpy as np
import pytest
from generators.ir_builder import PAPER, model
from sampling.test_sampling import planned, rejected

from dl2c.sampling.arrays import completed, values
from dl2c.sampling.draw import draw_many
from dl2c.sampling.support import support_of
from dl2c.smt.precondition import decide

SEEDS = 20
CELLS = 1024


def p_value(first, second):
    """That two samples, counted by cell, have one law (chi^2 by Wilson and Hilferty)."""
    share = math.sqrt(first.sum() / second.sum())
    both = first + second
    used = both >= 10
    statistic = float(np.sum((first / share - second * share)[used] ** 2 / both[used]))
    k = int(used.sum()) - 1
    z = ((statistic / k) ** (1 / 3) - (1 - 2 / (9 * k))) / math.sqrt(2 / (9 * k))
    return math.erfc(z / math.sqrt(2)) / 2


def counts(points, cuts):
    cells = np.zeros(len(points), int)
    for axis, limits in enumerate(cuts):
        cells = cells * (len(limits) + 1) + np.searchsorted(limits, points[:, axis])
    return np.bincount(cells, minlength=math.prod(len(c) + 1 for c in cuts))


def cuts_of(reference, axes, cells):
    """Quantiles of the reference, the same number along each axis, about `cells` in all."""
    pieces = max(2, round(cells ** (1 / axes)))
    return [np.quantile(reference[:, a], np.arange(1, pieces) / pieces) for a in range(axes)]


def circle_and_products(rng, count):
    """dx, dy on the unit circle; r, w, v with r*w = v, by area."""
    found = []
    while sum(map(len, found)) < count:
        n = 2**18
        angle = rng.uniform(0, 2 * math.pi, n)
        r, w = rng.uniform(-3, 3, n), rng.uniform(-2, 2, n)
        v = r * w
        kept = rng.random(n) * math.sqrt(1 + 9 + 4) <= np.sqrt(1 + r * r + w * w)
        kept &= (v >= 0) & (v <= 2) & (np.abs(r) >= 0.25)
        found.append(np.stack([np.cos(angle), np.sin(angle), r, w, v], 1)[kept])
    return np.concatenate(found)[:count]


def sphere(rng, count):
    found = []
    while sum(map(len, found)) < count:
        z, angle = rng.uniform(-1, 1, 2**18), rng.uniform(0, 2 * math.pi, 2**18)
        radius = np.sqrt(1 - z * z)
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], 1)
        found.append(points[points[:, 0] + points[:, 2] >= -0.5])
    return np.concatenate(found)[:count]


def cone(rng, count):
    """x^2 + y^2 = r^2 with centre: (x - c)^2 + y^2 = r^2 in four names, by volume."""
    found = []
    while sum(map(len, found)) < count:
        n = 2**18
        c, size, angle = rng.uniform(-1, 1, n), rng.uniform(0, 2, n), rng.uniform(0, 2 * math.pi, n)
        x, y, r = c + size * np.cos(angle), size * np.sin(angle), size * rng.choice([-1, 1], n)
        # tangent vectors by c, size and angle
        u = np.stack([np.ones(n), np.zeros(n), np.zeros(n), np.ones(n)], 1)
        s = np.stack([np.cos(angle), np.sin(angle), np.sign(r), np.zeros(n)], 1)
        a = np.stack([-size * np.sin(angle), size * np.cos(angle), np.zeros(n), np.zeros(n)], 1)
        gram = np.array([[np.sum(p * q, 1) for q in (u, s, a)] for p in (u, s, a)])
        area = np.sqrt(np.abs(np.linalg.det(np.moveaxis(gram, 2, 0))))
        kept = (rng.random(n) * 2 * math.sqrt(4) <= area) & (np.abs(x) <= 2) & (np.abs(y) <= 2)
        found.append(np.stack([x, y, r, c], 1)[kept])
    return np.concatenate(found)[:count]


def lines(rng, count):
    """x = 1 for y in [-1, 3], x = y for x in [-1, 2], by length."""
    first = rng.random(count) * (4 + 3 * math.sqrt(2)) < 4
    y = rng.uniform(-1, 3, count)
    x = rng.uniform(-1, 2, count)
    return np.stack([np.where(first, 1.0, x), np.where(first, y, x)], 1)


def components(rng, count):
    """Three boxes, two of which touch, with holes."""
    found = []
    while sum(map(len, found)) < count:
        x, y, z = rng.uniform(0, 10, (3, 2**19))
        kept = ((x < 1) & (y > x)) | ((x > 5) & (x < 7) & (y * z < 4)) | ((x > 9) & (z > 8))
        found.append(np.stack([x, y, z], 1)[kept])
    return np.concatenate(found)[:count]


def rotations(rng, count):
    """Velocities d = om * (x - c) of points that turn around c, by volume; few are slow enough."""
    found = []
    while sum(map(len, found)) < count:
        n = 2**19
        om, x, y, c = rng.uniform(-10, 10, n), *rng.uniform(-1, 1, (3, n))
        inside = (np.abs(om * (x - c)) <= 0.1) & (np.abs(om * (y - c)) <= 0.1)
        om, x, y, c = om[inside], x[inside], y[inside], c[inside]
        # slopes of d and e by om, x, y, c, beside which the drawn names have slope 1
        slopes = np.array([[x - c, om, 0 * om, -om], [y - c, 0 * om, om, -om]])
        gram = np.moveaxis(np.einsum("ikn,jkn->ijn", slopes, slopes), 2, 0) + np.eye(2)
        kept = rng.random(len(om)) * 201 <= np.sqrt(np.linalg.det(gram))
        found.append(np.stack([om, x, y, c, om * (x - c)], 1)[kept])
    return np.concatenate(found)[:count]


CASES = {
    "waypoint": (PAPER, ("ep", "b", "A", "GDelta", "Vmax", "T", "xr", "xg"), rejected, 5),
    "static_safety": (
        model(
            "dx*dx + dy*dy == 1 and r*w == v and v >= 0 and v <= 2 and abs(r) >= 0.25",
            {"dx": "-1:1", "dy": "-1:1", "r": "-3:3", "w": "-2:2", "v": "-5:5"},
        ),
        ("dx", "dy", "r", "w", "v"),
        circle_and_products,
        5,
    ),
    "sphere": (
        model("x*x + y*y + z*z == 1 and x + z >= -0.5", dict.fromkeys("xyz", "-2:2")),
        ("x", "y", "z"),
        sphere,
        3,
    ),
    "cone": (
        model("(x - c)*(x - c) + y*y == r*r", {"x": "-2:2", "y": "-2:2", "r": "-2:2", "c": "-1:1"}),
        ("x", "y", "r", "c"),
        cone,
        4,
    ),
    "lines": (model("x == 1 or x == y", {"x": "-1:2", "y": "-1:3"}), ("x", "y"), lines, 2),
    "rotations": (
        model(
            "d == om*(x - c) and e == om*(y - c)",
            {"d": "-0.1:0.1", "e": "-0.1:0.1", "x": "-1:1", "y": "-1:1", "c": "-1:1", "om": "-10:10"},
        ),
        ("om", "x", "y", "c", "d"),
        rotations,
        5,
    ),
    "disjunctive": (
        model(
            "x < 1 and y > x or x > 5 and x < 7 and y*z < 4 or x > 9 and z > 8",
            dict.fromkeys("xyz", "0:10"),
        ),
        ("x", "y", "z"),
        components,
        3,
    ),
}


@cache
def plan_of(name):
    return planned(CASES[name][0])


def compared(name, seed, count, cells):
    _, names, reference, axes = CASES[name]
    expected = reference(np.random.default_rng([seed, 1]), count)
    drawn = draw_many(plan_of(name), np.random.default_rng([seed, 2]), count)
    sample = np.stack([drawn[n] for n in names], 1)
    cuts = cuts_of(expected, axes, cells)
    return p_value(counts(expected, cuts), counts(sample, cuts))


@pytest.mark.parametrize("name", CASES)
def test_states_are_uniform(name):
    assert compared(name, 0, 20_000, CELLS // 4) > 0.001


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in CASES if n != "rotations"])  # whose reference is slow
def test_states_are_uniform_for_many_seeds(name):
    assert min(compared(name, seed, 200_000, CELLS) for seed in range(SEEDS)) > 0.01 / SEEDS / len(CASES)


def chain(rng, count):
    """A thin band of x around y, and z between x and 3 y."""
    found = []
    while sum(map(len, found)) < count:
        y, band, z = rng.uniform(0, 1, 2**18), rng.uniform(-1e-5, 1e-5, 2**18), rng.uniform(0, 3, 2**18)
        x = y + band
        kept = (x >= 0) & (x <= 1) & (x <= z) & (z <= 3 * y)
        found.append(np.stack([y, band * 1e5, z], 1)[kept])
    return np.concatenate(found)[:count]


def test_names_between_limits_keep_the_law():
    m = model(
        "x <= y + 0.00001 and x >= y - 0.00001 and x <= z and z <= 3*y", {"x": "0:1", "y": "0:1", "z": "0:3"}
    )
    plan = planned(m)
    assert any(c.between for c in plan.charts)
    drawn = draw_many(plan, np.random.default_rng(2), 20_000)
    sample = np.stack([drawn["y"], (drawn["x"] - drawn["y"]) * 1e5, drawn["z"]], 1)
    expected = chain(np.random.default_rng(1), 20_000)
    cuts = cuts_of(expected, 3, CELLS // 4)
    assert p_value(counts(expected, cuts), counts(sample, cuts)) > 0.001


def test_limits_come_from_products():
    """A name in a bounded product is drawn where the product can be in its bounds."""
    plan = plan_of("rotations")
    assert plan.charts[0].between
    assert plan.estimated_acceptance > 0.1


def test_the_density_is_that_of_the_jacobian():
    """Of six equalities that have three names in common, by central differences."""
    points = {"d": "x", "e": "y", "f": "z"}
    text = " and ".join(f"{d}1 == -(om*({x}2 - c2)) and {d}2 == om*({x}1 - c1)" for d, x in points.items())
    names = [f"{n}{k}" for pair in points.items() for n in pair for k in (1, 2)]
    m = model(text, dict.fromkeys(names, "-10:10"), dict.fromkeys(["om", "c1", "c2"], "-10:10"))
    (chart,) = support_of(m, decide(m)).blocks[0]
    free = [s.name for s in chart.free]
    definitions = [(s.name, t) for s, t in chart.definitions]
    rng = np.random.default_rng(0)
    for _ in range(5):
        at = rng.uniform(-3, 3, len(free))
        moved = np.array(
            [at, *(at + 1e-5 * e for e in np.eye(len(free))), *(at - 1e-5 * e for e in np.eye(len(free)))]
        )
        columns = completed(dict(zip(free, moved.T, strict=True)), definitions, len(moved))
        rows = np.array([columns[n] for n, _ in definitions])
        slopes = (rows[:, 1 : len(free) + 1] - rows[:, len(free) + 1 :]) / 2e-5
        squared = values(chart.measure.squared, columns, len(moved))[0] * chart.measure.scale**2
        assert squared == pytest.approx(np.linalg.det(np.eye(len(free)) + slopes.T @ slopes), rel=1e-6)
