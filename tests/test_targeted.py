"""`initial_distribution="z3"`: states nearest to random targets, as far as Z3 finds them."""

import pytest

from dl2c import make, make_vec
from dl2c.options import UnknownOption
from dl2c.smt.target import nearest
from tests.ir_builder import model

SQUARE = """ArchiveEntry "square"
ProgramVariables
  // @var: bound=[0:4]
  Real x;
  // @var: bound=[0:4]
  Real y;
End.
Problem
  x + y >= 6 -> [{x' = 1 & true}] x >= 0
End.
End.
"""


def test_the_nearest_state_is_on_the_boundary():
    m = model("x + y >= 6", {"x": "0:4", "y": "0:4"})
    found = nearest(m, {"x": 2.0, "y": 2.0}, {"x": 4.0, "y": 4.0}, 20.0)
    assert found.status == "sat"
    assert found.state == {"x": 3.0, "y": 3.0}


def test_what_is_impossible_is_said():
    assert nearest(model("x > 5", {"x": "0:4"}), {"x": 1.0}, {"x": 4.0}, 20.0).status == "unsat"


def test_resets_say_how_they_went():
    env = make(SQUARE, initial_distribution="z3")
    for seed in range(3):
        _, info = env.reset(seed=seed)
        assert info["initial_state_target"] in ("nearest", "invalid", "unknown")
        assert env.state["x"] + env.state["y"] >= 6
        state = env.state
        assert env.reset(seed=seed)[1] == info
        assert env.state == state


def test_vectors_refuse_it():
    with pytest.raises(UnknownOption, match="single"):
        make_vec(SQUARE, 2, initial_distribution="z3")
