"""Certificates where the environment computes what the policy observes: accepted, and refused where changed.

What is changed gets the digest of the changed questions, so that the boxes have to be found wrong.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from policy_proof.questions import question
from policy_proof.test_certificates import CHANGES, rewritten
from policy_proof.test_leading_statements import BEFORE, BOX, a_term

from dl2c.commands.policy import Asked, checked_certificate, questions_of
from dl2c.ir.evaluate import evaluate
from dl2c.ir.logic import conjunction, conjuncts, symbols
from dl2c.ir.model import Add, Compare, Div, Mul, Number, Or, Pow, Sub, Symbol, Term
from dl2c.policy.files import write_policy
from dl2c.policy.network import Interface, Layer, Network, NetworkPolicy
from dl2c.policy_proof import fixed_point
from dl2c.policy_proof.certificate import CertificateError, certificate, check
from dl2c.policy_proof.computed import dimension
from dl2c.policy_proof.fixed_point import ONE, ROUNDINGS, Rounding, down, programmed, up
from dl2c.policy_proof.question import Arithmetic, Question
from dl2c.policy_proof.search import Limits, search
from dl2c.policy_proof.tree import BY_BOUNDS, NO_STATE
from dl2c.source import NOWHERE

Trees = Sequence[Sequence[bytes]]

TERM = "(y - x) / 3"


def given(
    folder: Path, limit: float, test: str, term: str = TERM, arithmetic: str = "double", curved: bool = False
) -> tuple[str, Asked]:
    """A policy that takes the first alternative, which has this test, where what it observes is below a
    limit. With `curved` it has a layer of tanh.
    """
    model = str(folder / "before.kyx")
    Path(model).write_text(BEFORE.replace("{term}", term).replace("{test}", test))
    layers = (Layer(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]]), np.array([limit, 0.0]), "identity"),)
    if curved:
        layers = (
            Layer(np.array([[0.0, 0.0, -0.25]]), np.array([0.25 * limit]), "tanh"),
            Layer(np.array([[4.0], [0.0]]), np.zeros(2), "identity"),
        )
    observed = (("x", -5.0, 5.0), ("y", -5.0, 5.0), ("seen", -20.0, 20.0))
    interface = Interface(observed, "float32", "choice", (2,))
    file = write_policy(NetworkPolicy("before", interface, Network((), layers), False, {}), folder)
    return model, Asked(file, arithmetic, seconds=20)


def asked(*args: Any, **options: Any) -> tuple[Question, ...]:
    model, about = given(*args, **options)
    return questions_of(model, about, {})[1]


def proofs(questions: Sequence[Question]) -> Trees:
    found = [search(q, Limits(20, 2)) for q in questions]
    assert all(f.answer == "proved" for f in found)
    return [f.tree for f in found]


def written(folder: Path, questions: Sequence[Question], trees: Trees) -> Path:
    path = folder / "proof.json"
    path.write_text(certificate(questions, trees))
    return path


def refused(folder: Path, questions: Sequence[Question], trees: Trees) -> bool:
    path = written(folder, questions, trees)
    try:
        check(path, questions)
    except CertificateError as problem:
        assert "not proved" in str(problem)
        return True
    return False


TERMS = {
    "seen < 2": TERM,
    "seen < 2.0": "(x + y)^3 / 100 - abs(y) * 0.3",
    "seen < 2.00": "max(x * y, 0.1) / 7",
}


@pytest.mark.parametrize("test", TERMS)
@pytest.mark.parametrize("arithmetic", ["double", "float32", "real"])
@pytest.mark.parametrize("curved", [False, True])
def test_proofs_pass(tmp_path: Path, test: str, arithmetic: str, curved: bool) -> None:
    questions = asked(tmp_path, 1.5, test, TERMS[test], arithmetic, curved)
    assert len(questions) == 3 and all(q.computed for q in questions)
    assert not refused(tmp_path, questions, proofs(questions))


def test_a_certificate_that_is_written_is_checked(tmp_path: Path) -> None:
    from dl2c.commands.policy import report_on

    model, about = given(tmp_path, 1.5, "seen < 2")
    path = tmp_path / "proof.json"
    assert report_on(model, replace(about, certificate=path), {}).answer == "proved"
    assert checked_certificate(model, about, {}, path).leaves > 3


@pytest.mark.parametrize("change", CHANGES, ids=lambda c: c.__name__)
def test_other_trees_are_refused(tmp_path: Path, change: Callable[[bytearray, list[int]], None]) -> None:
    questions = asked(tmp_path, 1.5, "seen < 2 | y >= 4.5", "(x + y)^2 / 9")[:1]
    trees = proofs(questions)
    path = written(tmp_path, questions, trees)
    assert len(trees[0]) > 3
    path.write_text(rewritten(path, change))
    with pytest.raises(CertificateError):
        check(path, questions)


@pytest.mark.parametrize("seed", range(20))
def test_a_guard_that_fails_by_little_is_refused(tmp_path: Path, seed: int) -> None:
    """Where the policy takes the alternative that the guard forbids in some states. Nothing else than the
    relation between the value and its term can show it.
    """
    rng = np.random.default_rng(seed)
    limit = float(np.float32(rng.uniform(-1, 1)))
    trees = proofs(asked(tmp_path, limit, f"seen < {limit + 0.25}", curved=seed % 2 == 1))
    little = 2.0 ** -int(rng.integers(3, 21))
    test = f"seen < {Fraction(limit - little).limit_denominator(2**60)}"
    changed = asked(tmp_path, limit, test, curved=seed % 2 == 1)
    assert refused(tmp_path, changed, trees)


@pytest.mark.parametrize("seed", range(10))
def test_swapped_weights_and_other_terms_are_refused(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    limit = float(np.float32(rng.uniform(0, 1)))
    test = f"seen < {limit + 0.25}"
    questions = asked(tmp_path, limit, test)
    trees = proofs(questions)
    layer = questions[0].layers[0]
    swapped = replace(layer, weight=layer.weight[[1, 0]], bias=layer.bias[[1, 0]])
    others = [replace(q, layers=(swapped,)) for q in questions]
    assert refused(tmp_path, others, trees)
    term = "(y - x) / 3 - 0.5"
    others = [
        replace(a, computed=b.computed, hypothesis=b.hypothesis, box=b.box)
        for a, b in zip(questions, asked(tmp_path, limit, test, term), strict=True)
    ]
    assert refused(tmp_path, others, trees)


def test_what_the_question_says_of_computed_values_is_not_believed(tmp_path: Path) -> None:
    """A question that says of them what is not so, in its box and its hypothesis, proves nothing."""
    questions = asked(tmp_path, 1.5, "seen < 1")
    lying: list[Question] = []
    for q in questions:
        ((symbol, term),) = q.computed
        kept = [c for c in conjuncts(q.hypothesis) if symbol not in symbols(c)]
        wrong = Compare("=", symbol, Add(term, Number(Fraction(1))))
        box = tuple(
            (Fraction(3), Fraction(4)) if s == symbol else b for s, b in zip(q.dimensions, q.box, strict=True)
        )
        lying.append(replace(q, hypothesis=conjunction([*kept, wrong]), box=box))
    trees = proofs(lying)
    assert refused(tmp_path, lying, trees)


def test_what_the_tree_says_of_computed_values_is_not_believed(tmp_path: Path) -> None:
    """A tree that is split along such a dimension; of neither half it may say that it has no states."""
    questions = asked(tmp_path, 1.5, "seen < 2")[1:2]
    ((symbol, _),) = questions[0].computed
    along = bytes([questions[0].dimensions.index(symbol)])
    assert not refused(tmp_path, questions, [[along, bytes([BY_BOUNDS] * 2)]])
    assert refused(tmp_path, questions, [[along, bytes([BY_BOUNDS, NO_STATE])]])
    assert refused(tmp_path, questions, [[along, bytes([NO_STATE, BY_BOUNDS])]])


# Leaves by Z3 -------------------------------------------------------------------------------------

X0, X1 = Symbol("x0", "variable"), Symbol("x1", "variable")
SQUARE = ((Fraction(-1), Fraction(1)),) * 2


def touching(computed: bool, stricter: float = 0.0) -> Question:
    """Near (1, 1) only the hypothesis x0^2 <= x1 implies the conclusion, which is as strict at 0. The policy
    asks for tanh(x0 / 2), or tanh(x0^3 / 2) where that is `computed`.
    """
    most = Number(Fraction(float(np.tanh(0.5))) - Fraction(1, 10**6))
    wanted = Compare("<=", Add(Pow(X0, 2), Number(Fraction(stricter))), X1)
    conclusion = Or((Compare("<", Symbol("y", "input"), most), wanted))
    network = (Layer(np.array([[0.5, 0.0]]), np.zeros(1), "tanh"),)
    inside = Compare("<=", Pow(X0, 2), X1)
    made = question(network, SQUARE, conclusion, inside)
    if not computed:
        return made
    box = dict(zip((X0, X1), SQUARE, strict=True))
    cube = dimension("seen", Mul(X0, Pow(X0, 2)), box, "double", NOWHERE)
    return replace(
        made,
        dimensions=(*made.dimensions, cube.symbol),
        box=(*made.box, cube.range),
        hypothesis=conjunction([inside, cube.close]),
        observed=(replace(made.observed[0], value=cube.symbol), made.observed[1]),
        computed=((cube.symbol, cube.term),),
    )


@pytest.mark.parametrize("computed", [False, True])
def test_leaves_by_solver(tmp_path: Path, computed: bool) -> None:
    made = touching(computed)
    found = search(made, Limits(20, 2))
    assert found.answer == "proved" and found.by_solver > 0
    assert check(written(tmp_path, [made], [found.tree]), [made]).by_solver == found.by_solver
    for stricter in (1e-3, 1e-7, 2.0**-40):
        assert refused(tmp_path, [touching(computed, stricter)], [found.tree])


# Values as a program computes them ------------------------------------------------------------------

NUMBERS: list[tuple[Arithmetic, Any]] = [("double", float), ("float32", np.float32)]


def outside(term: Term, seed: int, divided: float = 1.0) -> int:
    """How often a value, exact or computed, is not where it is said to be, on boxes of several widths."""
    rng, count = np.random.default_rng(seed), 0
    for arithmetic, number in NUMBERS:
        for share in (1.0, 0.01, 0.0):
            point = {s: float(rng.uniform(float(a), float(b))) for s, (a, b) in BOX.items()}
            reach = {s: share * float(b - a) / 2 for s, (a, b) in BOX.items()}
            corners = {s: (point[s] - reach[s], point[s] + reach[s]) for s in point}
            box = {s: (down(Fraction(a)), up(Fraction(b))) for s, (a, b) in corners.items()}
            found = programmed(term, box, ROUNDINGS[arithmetic])
            if found is None:
                continue
            (low, high), error = found
            for _ in range(20):
                at = {
                    s: float(np.clip(rng.choice([a, b, rng.uniform(a, b)]), a, b))
                    for s, (a, b) in corners.items()
                }
                exact = Fraction(evaluate(term, {s: Fraction(v) for s, v in at.items()}, exact=True))
                held = Fraction(float(evaluate(term, {s: number(v) for s, v in at.items()})))
                count += not low <= exact * ONE <= high
                count += not abs(held - exact) * ONE <= error / Fraction(divided)
    return count


@pytest.mark.parametrize("seed", range(60))
def test_computed_values_are_near_their_terms(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert outside(a_term(rng, int(rng.integers(1, 5))), seed) == 0


def test_roundings_that_are_left_out_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """An eighth of the errors, and none."""
    x, y = BOX
    cube = Pow(Sub(Mul(x, y), Number(Fraction(1, 3))), 3)
    assert outside(cube, 0) == outside(Div(x, y), 0) == 0
    assert outside(cube, 0, 8.0) > 3
    monkeypatch.setattr(fixed_point.Rounding, "error", lambda *_: 0)
    assert outside(Div(x, y), 0) > 50


def test_a_value_that_may_be_missing_or_too_large_is_not_known() -> None:
    x = Symbol("x", "variable")
    box, double = {x: (-ONE, ONE)}, ROUNDINGS["double"]
    assert programmed(Div(x, x), box, double) is None
    assert programmed(Pow(Mul(x, Number(Fraction(10**80))), 4), box, double) is None
    assert programmed(Pow(x, 0), box, double) is None
    assert programmed(Pow(x, 4), box, Rounding(0, 0, 2 * ONE)) == ((0, ONE), 0)
