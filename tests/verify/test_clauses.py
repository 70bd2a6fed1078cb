"""A formula in clauses says the same."""

from hypothesis import given
from hypothesis import strategies as st

from dl2c.ir.logic import conjunction, disjunction
from dl2c.ir.model import And, Compare, Formula, Number, Or, Symbol, Truth
from dl2c.verify.arithmetic.cases import clauses
from dl2c.verify.states import evaluated

NAMES = [Symbol(name, "variable") for name in "abcdef"]
ATOMS = st.sampled_from([Compare(">", s, Number(0)) for s in NAMES])  # type: ignore[arg-type]
FORMULAS = st.recursive(
    ATOMS,
    lambda parts: (
        st.builds(conjunction, st.lists(parts, min_size=1, max_size=3))
        | st.builds(disjunction, st.lists(parts, min_size=1, max_size=3))
    ),
    max_leaves=12,
)


@given(FORMULAS, st.lists(st.booleans(), min_size=6, max_size=6), st.integers(1, 12))
def test_they_say_the_same(formula: Formula, values: list[bool], most: int) -> None:
    found = clauses(formula, most)
    assert len(found) <= most
    if found:
        state = {s: Number(int(v)) for s, v in zip(NAMES, values, strict=True)}  # type: ignore[arg-type]
        assert evaluated(conjunction(found), state) == evaluated(formula, state)
        inner = [part for c in found if isinstance(c, Or) for part in c.children]
        assert all(not isinstance(part, And) or not clauses(part, most) for part in inner)
        assert isinstance(evaluated(formula, state), Truth)
