"""What sums of squares imply: true in every state that satisfies the facts, and enough for proofs."""

from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dl2c.ir.logic import negation
from dl2c.ir.model import TRUE, Formula, Number, Symbol, Truth
from dl2c.ir.printer import print_formula
from dl2c.lower.terms import lower_formula
from dl2c.parse.parser import parse_formula
from dl2c.verify.arithmetic.squares import implied, with_known
from dl2c.verify.states import evaluated

NAMES = ("x", "y", "r")
SCOPE = {name: Symbol(name, "variable") for name in NAMES}

WHOLE = st.integers(-3, 3)


def formula(text: str) -> Formula:
    return lower_formula(parse_formula(text), SCOPE)


@pytest.mark.parametrize(
    ("facts", "wanted"),
    [
        ("x^2 + y^2 <= 0", ["x = 0", "y = 0"]),
        ("0 >= 2*(x - y)^4 + r*r", ["x - y = 0", "r = 0"]),
        ("x^2 + y^2 = 1", ["x <= 1", "x >= -1", "y <= 1", "y >= -1"]),
        ("x^2 < 4/9", ["x <= 2/3", "x >= -(2/3)"]),
        ("r >= 0 & x^2 + 4*y^2 <= r^2", ["x <= r", "x >= -r", "y <= r", "y >= -r"]),
        ("x^2 + y^2 <= r^2", []),  # r may be negative
        ("x^2 - y^2 = 0", []),
        ("x^2 + y^3 <= 0", []),
        ("1/4*x^2 <= 1", []),  # x may be 2
        ("x^4 + y^2 <= 1", ["y <= 1", "y >= -1"]),
        ("x^2 + y^2 >= 1", []),
    ],
)
def test_implied(facts: str, wanted: list[str]) -> None:
    assert [print_formula(f) for f in implied([formula(facts)])] == [
        print_formula(formula(w)) for w in wanted
    ]


@given(data=st.data())
def test_implied_facts_are_true_wherever_the_facts_are(data: st.DataObject) -> None:
    """States are on a small grid, where equalities of squares hold often."""
    square = st.sampled_from(["x^2", "y^2", "(x - y)^2", "x*x", "(x + r)^4", "2*y^2", "1/2*x^2", "y^3", "x"])
    left = " + ".join(data.draw(st.lists(square, min_size=1, max_size=3)))
    right = data.draw(st.sampled_from(["0", "1", "4", "2", "9/4", "r^2", "r*r", "r"]))
    op = data.draw(st.sampled_from(["<=", "<", "=", ">=", ">"]))
    atom = f"{left} {op} {right}" if data.draw(st.booleans()) else f"{right} {op} {left}"
    facts = [formula(atom), *data.draw(st.sampled_from([[], [formula("r >= 0")], [formula("0 < r")]]))]
    values = {SCOPE[n]: data.draw(WHOLE.map(lambda k: Fraction(k, 2)), label=n) for n in NAMES}
    numbers = {s: Number(v) for s, v in values.items()}
    assume(all(evaluated(f, numbers) == TRUE for f in facts))
    assert all(evaluated(f, numbers) == TRUE for f in implied(facts))


@given(x=WHOLE, y=WHOLE, r=WHOLE)
def test_known_values_change_no_state(x: int, y: int, r: int) -> None:
    facts = [formula("x = 2"), formula("x*y >= 1 | y = r"), formula("r = 0"), formula("x = 2")]
    goal = formula("x + y > r & r = 0")
    numbers = {SCOPE[n]: Number(Fraction(v)) for n, v in zip(NAMES, (x, y, r), strict=True)}
    given_facts, wanted = with_known(facts, goal)

    def counterexample(known: list[Formula], claim: Formula) -> bool:
        return all(evaluated(f, numbers) == TRUE for f in (*known, negation(claim)))

    assert counterexample(given_facts, wanted) == counterexample(facts, goal)
    assert Truth(False) not in given_facts
