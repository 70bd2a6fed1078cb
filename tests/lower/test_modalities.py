"""Programs inside conditions, against Z3 on the axioms written out, and what of them is refused."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

import pytest
import z3
from generators.kyx_builder import codes, lowered, model_text
from selection import quick_among

import dl2c
from dl2c.diagnostics import CompileError
from dl2c.ir.evaluate import truth
from dl2c.ir.model import Formula, Symbol
from dl2c.ir.printer import print_formula

Values = dict[str, Any]


@dataclass(frozen=True)
class Step:
    """A statement as dL, and in Z3 how values are `changed`, after a time; what `passes` it as a test, what
    holds along it as a `flow`, and which name is left to `chance`.
    """

    text: str
    changed: Callable[[Values, Any], Values] = lambda s, t: s
    passes: Callable[[Values], Any] | None = None
    flow: Callable[[Values], Any] | None = None
    chance: str = ""


STEPS = (
    Step("x := 2*x - v;", lambda s, t: {**s, "x": 2 * s["x"] - s["v"]}),
    Step("v := -v;", lambda s, t: {**s, "v": -s["v"]}),
    Step("y := x;", lambda s, t: {**s, "y": s["x"]}),
    Step("?v >= 0;", passes=lambda s: s["v"] >= 0),
    Step("?x != y;", passes=lambda s: s["x"] != s["y"]),
    Step("y := *;", chance="y"),
    Step("{x' = v}", lambda s, t: {**s, "x": s["x"] + s["v"] * t}, flow=lambda s: z3.BoolVal(True)),
    Step("{x' = 1, v' = 0 & x <= 3}", lambda s, t: {**s, "x": s["x"] + t}, flow=lambda s: s["x"] <= 3),
    Step(
        "{x' = v, v' = -2 & v >= 0}",
        lambda s, t: {**s, "x": s["x"] + s["v"] * t - t * t, "v": s["v"] - 2 * t},
        flow=lambda s: s["v"] >= 0,
    ),
    Step(
        "{v' = y, x' = v & x >= -2 & v < 4}",
        lambda s, t: {**s, "x": s["x"] + s["v"] * t + s["y"] * t * t / 2, "v": s["v"] + s["y"] * t},
        flow=lambda s: z3.And(s["x"] >= -2, s["v"] < 4),
    ),
)
POSTS: tuple[tuple[str, Callable[[Values], Any]], ...] = (
    ("x <= 3", lambda s: s["x"] <= 3),
    ("x + v > y", lambda s: s["x"] + s["v"] > s["y"]),
    ("!(x = 1) | v < 0", lambda s: z3.Or(s["x"] != 1, s["v"] < 0)),
)


def meant(
    steps: list[Step], post: Callable[[Values], Any], at: Values, everything: bool, depth: int = 0
) -> Any:
    """[a]P or <a>P, the axioms written out."""
    if not steps:
        return post(at)
    step, rest = steps[0], steps[1:]

    def after(values: Values) -> Any:
        return meant(rest, post, values, everything, depth + 1)

    def where(condition: Any, then: Any) -> Any:
        return z3.Implies(condition, then) if everything else z3.And(condition, then)

    quantifier = z3.ForAll if everything else z3.Exists
    if step.passes is not None:
        return where(step.passes(at), after(at))
    if step.chance:
        value = z3.Real(f"value{depth}")
        return quantifier([value], after({**at, step.chance: value}))
    if step.flow is None:
        return after(step.changed(at, None))
    time, earlier = z3.Real(f"time{depth}"), z3.Real(f"earlier{depth}")
    inside = z3.Implies(z3.And(earlier >= 0, earlier <= time), step.flow(step.changed(at, earlier)))
    reached = z3.And(time >= 0, z3.ForAll([earlier], inside))
    return quantifier([time], where(reached, after(step.changed(at, time))))


def decided(formula: Any) -> bool | None:
    solver = z3.Tactic("nlqsat").solver()
    solver.set("timeout", 2000)
    solver.add(formula)
    return {"sat": True, "unsat": False}.get(str(solver.check()))


def condition(text: str) -> Formula:
    """The normal form of a condition on the state."""
    formula = lowered(f"true -> [x := 1;] (({text}) & true)", "", "Real x; Real v; Real y;").postcondition
    assert formula is not None
    return formula


def holds(formula: Formula, state: dict[str, Fraction]) -> bool:
    return truth(formula, {Symbol(n, "variable"): v for n, v in state.items()}, True)


@pytest.mark.parametrize("seed", quick_among(range(8), (0, 1)))
def test_a_program_in_a_condition_says_what_the_axioms_say(seed: int) -> None:
    rng, compared = Random(seed), 0
    for _ in range(25):
        flows = [s for s in STEPS if s.flow is not None]
        others = [s for s in STEPS if s.flow is None]
        steps = [*rng.choices(others, k=rng.randint(0, 2)), rng.choice(flows)]
        steps += rng.choices(others if rng.random() < 0.7 else STEPS, k=rng.randint(0, 1))
        (post, meaning), everything = rng.choice(POSTS), rng.random() < 0.5
        program = " ".join(s.text for s in steps)
        text = f"[{program}]({post})" if everything else f"<{program}>({post})"
        negated = rng.random() < 0.3
        try:
            formula = condition(f"!{text}" if negated else text)
        except CompileError as refused:
            assert codes(refused) == ["modality-in-state"]
            continue
        for _ in range(6):
            state = {n: Fraction(rng.randint(-6, 6), 2) for n in "xvy"}
            at = {n: z3.RealVal(str(v)) for n, v in state.items()}
            wanted = decided(meant(steps, meaning, at, everything))
            if wanted is not None:
                compared += 1
                assert holds(formula, state) == (wanted != negated), (text, state, print_formula(formula))
    assert compared > 75, "of 150"


BRAKES = "[{x' = v, v' = -b & v >= 0}] x <= m"
FASTER = "t := 0; v := v + 1; {x' = v, t' = 1 & t <= 1}"
CAR = model_text(
    f"b > 0 & {BRAKES} -> [{{ t := 0; {{?[{FASTER}]({BRAKES}); {FASTER} ++ v := 0;}} }}*] x <= m",
    "/* @const: bound=[1:2] */ Real b;\n/* @const: bound=[5:9] */ Real m;",
    "/* @var: bound=[0:4] */ Real x;\n/* @var: bound=[0:2] */ Real v;\nReal t;",
)


def test_preconditions_and_tests_may_hold_programs() -> None:
    """Initial states can stop in time, and the mask closes what leads to states that cannot."""
    env: Any = dl2c.make(CAR)
    closed = 0
    for seed in range(40):
        _, info = env.reset(seed=seed)
        for _ in range(30):
            x, v, b, m = (env.state[name] for name in "xvbm")
            assert x + v * v / (2 * b) <= m + 1e-9
            room = m - (x + (v + 1) + (v + 1) ** 2 / (2 * b))
            if abs(room) > 1e-9:
                assert info["action_mask"].tolist() == [int(room > 0), 1]
            closed += room < 0
            _, _, terminated, _, info = env.step(int(room < 0))
            assert not terminated and not info["blocked"]
    assert closed > 40


@pytest.mark.parametrize(
    ("text", "label"),
    [
        ("[{x := x + 1;}*] x > 0", "it has a loop"),
        ("[{x := 1; ++ x := 2;}^@] x > 0", "it is a game"),
        ("[{x' = -x}] x > 0", "its motion is not a polynomial of time"),
        ("<{x' = v, v' = y, y' = 1}> x > 0", "its times or values cannot be eliminated"),
        (f"[{'{x := 1; ++ x := 2;}' * 40}] x > 0", "it has too many runs"),
        (f"[{'x := x*v + x;' * 60}] x > 0", "the value of `x` is too long"),
        (f"<{'y := *; ?y > x; x := x*y;' * 30}> x > 0", "its times or values cannot be eliminated"),
    ],
)
def test_other_programs_are_refused(text: str, label: str) -> None:
    with pytest.raises(CompileError) as refused:
        condition(text)
    (found,) = refused.value.diagnostics
    assert (found.code, found.label) == ("modality-in-state", label)
    assert found.span.text.strip("()") == text.strip("()")


def test_a_predicate_with_a_program_has_no_distance() -> None:
    with pytest.raises(CompileError) as refused:
        lowered(
            "true -> [{x := 1;}*] p(x)",
            "/* @safety: reward={p(x)} */ Bool p(Real x) <-> [{x' = 1}] x > 0;",
        )
    assert codes(refused.value) == ["no-distance"]
