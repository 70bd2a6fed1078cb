"""Every trap is false: an exact run shows it, by an evaluator that shares nothing with the prover."""

from collections import Counter

import pytest
from oracles.exact_runs import refutes, theorem
from selection import quick_among
from verify.trap import Trap
from verify.traps import POLYNOMIAL, TRAPS, WITNESSED

from dl2c.parse import tree
from dl2c.resolve.symbols import nodes


@pytest.mark.parametrize("trap", quick_among(WITNESSED, WITNESSED[::3]), ids=lambda trap: trap.name)
def test_a_run_refutes(trap: Trap) -> None:
    assert refutes(theorem(trap.text), trap.state, trap.decisions), trap.why


@pytest.mark.parametrize("trap", quick_among(TRAPS, TRAPS[::3]), ids=lambda trap: trap.name)
def test_decisions_are_needed(trap: Trap) -> None:
    """A run with one decision too few, or too many, is none: scripts are followed to their ends."""
    formula = theorem(trap.text)
    if not trap.argument and trap.decisions:
        assert not refutes(formula, trap.state, trap.decisions[:-1])
    if not trap.argument:
        assert not refutes(formula, trap.state, [*trap.decisions, "one more"])


def test_there_are_enough_and_each_has_its_name() -> None:
    names = Counter(trap.name for trap in TRAPS)
    assert len(TRAPS) >= 250
    assert max(names.values()) == 1
    assert all(trap.why for trap in TRAPS)


def test_polynomial_traps_are_boxes_over_polynomials() -> None:
    for trap in POLYNOMIAL:
        found = list(nodes(theorem(trap.text)))
        divided = [n for n in found if isinstance(n, tree.Divide | tree.Dual)]
        called = [n for n in found if isinstance(n, tree.FuncOf) and n.args and n.name != "old"]
        assert not divided and not called, trap.name
        assert not trap.argument and not trap.undefined, trap.name
