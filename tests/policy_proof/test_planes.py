"""Leaves of searches and planes of states: they are covered exactly, refuted points are those that exact
judgement refutes, and the progress of a search is what it decided.
"""

import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy_proof.questions import layers, question
from policy_proof.test_leading_statements import CARELESS, report
from selection import few_and_many

from dl2c.ir.model import TRUE, Add, Compare, Formula, Number, Symbol
from dl2c.policy.network import PolicyError
from dl2c.policy_proof import plane as planes
from dl2c.policy_proof.exact import violation
from dl2c.policy_proof.plane import Plane, axes_named, free_names, plane_of, shown
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Before, Found, Limits, search
from dl2c.policy_proof.tables import box_of
from dl2c.policy_proof.tree import BY_BOUNDS, LEFT_OPEN, NO_STATE, check_levels, leaves, splits

X = tuple(Symbol(f"x{k}", "variable") for k in range(3))


def below(limit: float) -> Compare:
    return Compare("<", Symbol("y", "input"), Number(Fraction(limit)))


def asked(seed: int, limit: float, dimensions: int = 3, hypothesis: Formula = TRUE) -> Question:
    """That a random network is below a limit on a box whose ends are no round numbers."""
    rng = np.random.default_rng(seed)
    network = layers(rng, [dimensions, 8, 8, 1], "relu", 2.0)
    ends = [sorted(Fraction(int(v), 7) for v in rng.choice(20, 2, replace=False)) for _ in range(dimensions)]
    return question(network, tuple((low, high) for low, high in ends), below(limit), hypothesis)


def height(made: Question) -> float:
    """The largest output on many points."""
    low, high = box_of(made).T
    values = np.random.default_rng(0).uniform(low, high, (20_000, len(low)))
    for layer in made.layers:
        values = values @ layer.weight.T + layer.bias
        values = np.maximum(values, 0) if layer.activation == "relu" else values
    return float(values.max())


def searched(
    seed: int, above: float, dimensions: int = 3, hypothesis: Formula = TRUE
) -> tuple[Question, Found]:
    """A search about a limit that is so far above the largest output."""
    made = asked(seed, height(asked(seed, 0.0, dimensions)) + above, dimensions, hypothesis)
    return made, search(made, Limits(30, 2))


def corner_of(seed: int) -> Formula:
    """All states but those in a corner."""
    (_, x), (_, y), _ = asked(seed, 0.0).box
    return Compare("<=", Add(X[0], X[1]), Number(x + y - Fraction(1, 3)))


@pytest.fixture(scope="module")
def proved() -> tuple[Question, Found]:
    made, found = searched(0, 0.05, hypothesis=corner_of(0))
    assert found.answer == "proved" and len(found.tree) > 6
    return made, found


@pytest.fixture(scope="module")
def refuted() -> tuple[Question, Found]:
    made, found = searched(2, -0.05)
    assert found.answer == "refuted" and len(found.tree) > 2
    return made, found


def exact_area(boxes: np.ndarray) -> Fraction:
    """Of boxes (n, axes, 2), without rounding."""
    sides = [[Fraction(high) - Fraction(low) for low, high in box] for box in boxes.tolist()]
    return sum((math.prod(box, start=Fraction(1)) for box in sides), Fraction(0))


def every_leaf(made: Question, tree: Any, through: Any = None) -> tuple[np.ndarray, np.ndarray]:
    found = list(leaves(made, tree, through))
    return np.concatenate([b for b, _ in found]), np.concatenate([c for _, c in found])


@pytest.mark.parametrize("levels", [0, 1, 3, 6, None])
def test_leaves_are_the_whole_box(proved: tuple[Question, Found], levels: int | None) -> None:
    made, found = proved
    boxes, codes = every_leaf(made, found.tree[:levels])
    assert exact_area(boxes) == exact_area(box_of(made)[None])
    assert (LEFT_OPEN in codes) == (levels is not None)


@pytest.mark.parametrize("seed", range(20))
def test_a_plane_is_covered_exactly(proved: tuple[Question, Found], seed: int) -> None:
    """By the leaves that the state is in, also where it lies on the faces of boxes."""
    made, found = proved
    rng, box = np.random.default_rng(seed), box_of(made)
    middles = box[:, 0] + (box[:, 1] - box[:, 0]) * rng.integers(0, 9, 3) / 8
    state = np.where(rng.random(3) < 0.5, middles, rng.uniform(*box.T))
    state = np.where(rng.random(3) < 0.2, box[np.arange(3), rng.integers(0, 2, 3)], state)
    for axes in ((0, 1), (2, 0), (1,)):
        others = {k: float(state[k]) for k in range(3) if k not in axes}
        boxes, codes = every_leaf(made, found.tree, others)
        assert exact_area(boxes[:, list(axes)]) == exact_area(box[list(axes)][None])
        all_boxes, all_codes = every_leaf(made, found.tree)
        meets = np.all(
            [
                (b[:, 0] <= v) & ((v < b[:, 1]) | (b[:, 1] == box[k, 1]))
                for k, v in others.items()
                for b in [all_boxes[:, k]]
            ],
            axis=0,
        )
        rows = sorted(zip(all_boxes[meets].tolist(), all_codes[meets].tolist(), strict=True))
        assert rows == sorted(zip(boxes.tolist(), codes.tolist(), strict=True))


@pytest.mark.parametrize("levels", few_and_many(12, 16))
def test_all_leaves_of_a_complete_tree(levels: int) -> None:
    """As a search could leave it; the large one has more than a hundred thousand."""
    made = asked(3, 0.0, 2)
    tree = [bytes([k % 2]) * 2**k for k in range(levels + 1)]
    tree.append(bytes([BY_BOUNDS, NO_STATE]) * 2**levels)
    check_levels(made, tree)
    drawn = plane_of(made, Found("unknown", 0, 0, 0.0, 0.0, tree=tuple(tree)), ("x1", "x0"))
    assert len(drawn.leaves) == 2 ** (levels + 1)
    assert exact_area(drawn.leaves) == exact_area(box_of(made)[None])


def test_boxes_that_were_open_are_open_in_a_refuted_search(refuted: tuple[Question, Found]) -> None:
    made, found = refuted
    boxes, codes = every_leaf(made, found.tree)
    widths = np.diff(box_of(made), axis=1)[:, 0]
    shares = np.prod((boxes[:, :, 1] - boxes[:, :, 0]) / widths, axis=1)
    assert np.isclose(shares[codes != LEFT_OPEN].sum(), found.share) and LEFT_OPEN in codes
    assert found.violation is not None
    state = [float(found.violation.state[s.name]) for s in made.dimensions]
    around = np.all([(boxes[:, k, 0] <= v) & (v <= boxes[:, k, 1]) for k, v in enumerate(state)], axis=0)
    assert LEFT_OPEN in codes[around]


def inside(low: Fraction, high: Fraction) -> tuple[float, float]:
    """Limits rounded inwards."""
    near = float(low), float(high)
    first = near[0] if Fraction(near[0]) >= low else math.nextafter(near[0], math.inf)
    return first, near[1] if Fraction(near[1]) <= high else math.nextafter(near[1], -math.inf)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("names", [("x0", "x1"), ("x2", "x0")])
def test_refuted_points_are_refuted(seed: int, names: tuple[str, str], monkeypatch: Any) -> None:
    """Exactly those of the grid at which the exact judgement has a violation."""
    monkeypatch.setattr(planes, "POINTS", 23)
    made, found = searched(seed, -0.4, hypothesis=corner_of(seed) if seed % 2 else TRUE)
    agrees(made, found, names)


@pytest.mark.parametrize("name", CARELESS)
def test_what_is_computed_follows_the_points(name: str, tmp_path: Path, monkeypatch: Any) -> None:
    """It has another value at each of them."""
    monkeypatch.setattr(planes, "POINTS", 23)
    weights, bias, term, test, _ = CARELESS[name]
    found, _ = report(tmp_path, weights, bias, term, test)
    k = [f.answer for f in found.found].index("refuted")
    made = found.questions[k]
    assert made.computed and len(free_names(made)) == len(made.dimensions) - 1
    agrees(made, found.found[k], tuple(free_names(made)[:2]))


def agrees(made: Question, found: Found, names: tuple[str, ...]) -> None:
    """Points of the plane with the exact judgement, 23 on each axis."""
    drawn = plane_of(made, found, names)
    assert found.answer == "refuted" and drawn.violation is not None
    elsewhere = {s.name: 0.0 for s, _ in made.computed}
    bounds = {s.name: inside(*ends) for s, ends in zip(made.dimensions, made.box, strict=True)}
    wanted: set[tuple[float, float]] = set()
    for x in np.linspace(*bounds[names[0]], 23):
        for y in np.linspace(*bounds[names[1]], 23):
            state = elsewhere | drawn.values | {names[0]: float(x), names[1]: float(y)}
            if violation(made, {s: Fraction(state[s.name]) for s in made.dimensions}) is not None:
                wanted.add((float(x), float(y)))
    assert {(x, y) for x, y in drawn.refuted.tolist()} == wanted and wanted
    point = elsewhere | drawn.values | dict(zip(names, drawn.violation, strict=True))
    assert violation(made, {s: Fraction(point[s.name]) for s in made.dimensions}) is not None


def test_nothing_is_refuted_where_all_is_proved(proved: tuple[Question, Found]) -> None:
    made, found = proved
    drawn = plane_of(made, found)
    assert not len(drawn.refuted) and drawn.violation is None
    assert {*drawn.decided.tolist()} <= {BY_BOUNDS, NO_STATE}


def test_axes_are_those_that_were_split_most_often(proved: tuple[Question, Found]) -> None:
    made, found = proved
    counts = splits(made, found.tree)
    drawn = plane_of(made, found)
    assert [counts[int(n[1:])] for n in drawn.names] == sorted(counts, reverse=True)[:2]
    assert {*drawn.names, *drawn.values} == {"x0", "x1", "x2"}


def test_one_dimension_has_a_plane() -> None:
    made, found = searched(4, -0.2, 1)
    drawn: Plane = plane_of(made, found)
    assert drawn.names == ("x0",) and drawn.limits.tolist()[1] == [0.0, 1.0] and not drawn.values
    assert exact_area(drawn.leaves) == exact_area(box_of(made)[None])
    assert len(drawn.refuted) and (drawn.refuted[:, 1] == 0.5).all()


# Progress ------------------------------------------------------------------------------------------


def is_progress(found: Found) -> None:
    """It grows, and ends where the search does."""
    rows = np.array([(p.seconds, p.boxes, p.decided) for p in found.progress])
    assert (np.diff(rows, axis=0) >= 0).all() and (rows >= 0).all()
    last = found.progress[-1]
    assert (last.decided, last.boxes) == (found.share, found.boxes)
    assert (last.open == 0) == (found.answer == "proved")
    boxes = np.cumsum([len(level) for level in found.tree])
    assert [p.boxes for p in found.progress[: len(boxes) - 1]] == boxes[:-1].tolist()


def test_progress_ends_with_what_is_decided(
    proved: tuple[Question, Found], refuted: tuple[Question, Found]
) -> None:
    is_progress(proved[1])
    is_progress(refuted[1])
    unknown = search(proved[0], Limits(0.0))
    is_progress(unknown)
    assert unknown.answer == "unknown" and [p.open for p in unknown.progress] == [1]


def test_a_search_that_goes_on_continues_its_progress(proved: tuple[Question, Found]) -> None:
    made, found = proved
    before = Before(found.tree[:4], (1.0, 2.0, 2.0, 50.0))
    again = search(made, Limits(30, 2), before)
    is_progress(again)
    assert again.progress == found.progress, "all but seconds"
    assert [p.seconds for p in again.progress[:4]] == [1.0, 2.0, 2.0, 50.0]
    assert again.progress[4].seconds >= 50.0 and again.seconds < 40.0
    once_more = search(made, Limits(0.0), Before(again.tree, tuple(p.seconds for p in again.progress)))
    assert once_more.answer == "proved" and once_more.progress == again.progress


# Which question ------------------------------------------------------------------------------------


def other(made: Question, name: str) -> Question:
    """A question about another last name."""
    symbol = Symbol(name, "input")
    observed = (*made.observed[:-1], replace(made.observed[-1], name=name, value=symbol))
    return replace(made, dimensions=(*made.dimensions[:-1], symbol), observed=observed)


def test_the_question_that_is_drawn(proved: tuple[Question, Found], refuted: tuple[Question, Found]) -> None:
    one, two = proved[0], other(proved[0], "w")
    small, large = replace(proved[1], boxes=3), replace(proved[1], boxes=4)
    assert shown([one, two], [small, large], ())[0] is two
    assert shown([one, two], [large, small], ())[0] is one
    assert shown([one, two], [large, replace(small, answer="refuted")], ())[0] is two
    assert shown([one, two], [small, large], ("x2", "x0"))[0] is one
    question_shown, found = shown([one, two], [refuted[1]], ("w", "x0"))
    assert question_shown is two and found.boxes == 0 and "not searched" in found.reason
    drawn = plane_of(question_shown, found, ("w", "x0"))
    assert drawn.decided.tolist() == [LEFT_OPEN] and exact_area(drawn.leaves) > 0


def test_names_of_planes(proved: tuple[Question, Found]) -> None:
    one, two = proved[0], other(proved[0], "w")
    assert axes_named([one, two], "") == () and axes_named([one, two], " w , x0 ") == ("w", "x0")
    with pytest.raises(PolicyError, match="no alternative of the environment has both"):
        axes_named([one, two], "w,x2")
    computed = replace(one, computed=((X[2], X[0]),))
    assert free_names(computed) == ["x0", "x1"]
    with pytest.raises(PolicyError, match="not a dimension of the states; these are x0, x1"):
        axes_named([computed], "x0,x2")
