"""What Z3 says about preconditions: witnesses hold, contradictions come in the user's words."""

import subprocess
import sys
from dataclasses import replace
from fractions import Fraction

import pytest
from generators.ir_builder import PAPER, model
from oracles.ir import SYMBOLS, formulas, holds
from selection import few_and_many_examples

from dl2c.diagnostics import render
from dl2c.ir.model import Symbol
from dl2c.smt.precondition import Satisfiable, Unknown, Unsatisfiable, decide, diagnose


def words(decision):
    assert isinstance(decision, Unsatisfiable)
    return [p.text for p in decision.core]


def witness_of(decision):
    assert isinstance(decision, Satisfiable)
    return decision.witness


def test_witness_satisfies_the_papers_precondition():
    witness = witness_of(decide(PAPER))
    assert set(witness) == set(PAPER.sampled)
    point = {Symbol(v.name, "variable"): witness[v.name] for v in PAPER.variables}
    point |= {Symbol(c.name, "constant"): witness[c.name] for c in PAPER.constants}
    assert holds(PAPER.precondition, point)
    for item in (*PAPER.variables, *PAPER.constants):
        assert item.bound.low <= witness[item.name] <= item.bound.high


@few_and_many_examples(20, 80, formulas)
def test_decisions_are_true(f):
    match decide(replace(model("True", {s.name: "-20:20" for s in SYMBOLS}), precondition=f), 2.0):
        case Satisfiable(witness):
            if not any(isinstance(v, str) for v in witness.values()):
                assert holds(f, {s: witness[s.name] for s in SYMBOLS})
        case Unsatisfiable(core):
            grid = [Fraction(k, 2) for k in range(-4, 5)]
            points = ({SYMBOLS[0]: a, SYMBOLS[1]: b, SYMBOLS[2]: c} for a in grid for b in grid for c in grid)
            assert not any(holds(f, p) for p in points)
            assert core
        case Unknown():
            pass


@pytest.mark.parametrize(
    ("text", "core"),
    [
        ("1/x > 5 and x == 0", ["1/x > 5", "x == 0"]),
        ("x > 5 and y > 0 and x < 3", ["x > 5", "x < 3"]),
        ("y > 0 and x > 10", ["x > 10", "bound of x: [0:10]"]),
        ("c < 1 and x > 2", ["c < 1", "value of c: 1.5"]),
        ("x > 2 and (x < 1 or y > 0.25)", ["x < 1 or y > 0.25", "x > 2", "bound of y: [-inf:0.25]"]),
        ("sqrt(x - 20) >= 0", ["sqrt(x - 20) >= 0", "bound of x: [0:10]"]),
        ("x*x + y*y < 0", ["x*x + y*y < 0"]),
        ("1/(x - x) != 1", ["1/(x - x) != 1"]),
    ],
)
def test_core_is_minimal_and_in_the_users_words(text, core):
    decision = decide(
        model(
            text, {"x": "0:10", "y": ":0.25"} if "0.25" in text else {"x": "0:10", "y": ":"}, {}, {"c": "1.5"}
        )
    )
    assert sorted(words(decision)) == sorted(core)


def test_empty_bounds_are_a_contradiction():
    assert words(decide(model("True", {"x": "2:1"}))) == ["bound of x: [2:1]"]


def test_core_message_shows_every_place():
    message = render(diagnose(decide(model("y > 0 and x > 10", {"x": "0:10", "y": ":"}))))
    assert "no initial state satisfies the precondition" in message
    assert "model.kyx:1:11" in message
    assert "x > 10 (model.kyx:1:11)" in message
    assert "bound of x: [0:10] (declarations.kyx:1:1)" in message


def test_transcendental_functions_are_undecided_and_named():
    decision = decide(model("x > 0 and exp(x) > 2", {"x": "0:1"}))
    assert isinstance(decision, Unknown)
    diagnostic = diagnose(decision)
    assert diagnostic.code == "undecided-precondition"
    assert "`exp` in `exp(x) > 2`" in diagnostic.label
    assert diagnostic.span.text == "exp(x) > 2"


def test_contradiction_beside_transcendental_functions_is_found():
    assert words(decide(model("exp(x) > 2 and x > 1", {"x": "0:1"}))) == ["x > 1", "bound of x: [0:1]"]


def test_irrational_witness_is_a_decimal():
    assert witness_of(decide(model("x*x == 2 and x > 0", {"x": ":"})))["x"].startswith("1.41421356")


def test_same_model_same_decision():
    assert decide(PAPER) == decide(PAPER)


INTERRUPTED = """
import os, signal, threading
from dl2c.configuration import resolve_options
from dl2c.pipeline import compilation
from dl2c.smt.query import Oracle
from dl2c.source import Source

text = "x^5*y^3 + y^5*z^3 + z^5*w^3 + w^5*x^3 = 7 & x*y*z*w = 2 & x^3 + y^3*z - w^5 = 1 & x*x*z + y*y*w < 1"
model = f'Theorem "hard" ProgramVariables Real x, y, z, w; End. Problem {text} -> [x := x;] x > 0 End. End.'
hard = compilation(Source("hard.kyx", model), resolve_options({})).unbounded.precondition
signal.signal(signal.SIGINT, signal.default_int_handler)
threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    print(Oracle(each=20.0).exists([hard]))
except KeyboardInterrupt:
    print("interrupted")
"""


def test_ctrl_c_while_z3_works_is_no_answer() -> None:
    """Z3 takes the signal itself, and says that it does not know."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False)
    assert done.stdout == "interrupted\n", done.stderr
