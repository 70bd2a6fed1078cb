"""Loops inside a step and programs before the loop: what they do, by hand.

Every step is taken by interpreter and compiled code, which must agree.
"""

from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

import pytest
from differential import pair_of
from generators.kyx_builder import codes, lowered, model_text, paths_of

from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.env.single import Dl2cEnv
from dl2c.ir.model import Repeat, While
from dl2c.ir.printer import print_block
from dl2c.native.errors import ResetFailed
from dl2c.pipeline import check_model
from dl2c.source import Source

# While loops ------------------------------------------------------------------

COUNTDOWN = "{?x > 1; x := x - 1;}*; ?!(x > 1);"


def test_a_loop_with_complementary_tests_is_a_while_loop() -> None:
    for written in (COUNTDOWN, "{?x > 1; x := x - 1;}* ?x <= 1;", "{{?1 < x; x := x - 1;}*} ?1 >= x;"):
        (loop,) = lowered(f"true -> [{{{written}}}*] x > 0").body
        assert isinstance(loop, While)
        assert list(print_block(loop.body)) == ["x := x - 1;"]


@pytest.mark.parametrize(
    "written",
    [
        "{?x > 1; x := x - 1;}*; ?x < 1;",
        "{?x > 1; x := x - 1;}*; v := 1; ?x <= 1;",
        "{x := x - 1; ?x > 1;}*; ?x <= 1;",
    ],
)
def test_other_loops_are_decisions(written: str) -> None:
    assert isinstance(lowered(f"true -> [{{{written}}}*] x > 0").body[0], Repeat)


def test_a_while_loop_runs_until_its_test_fails(tmp_path: Path) -> None:
    pair = pair_of(f"v := 0; {COUNTDOWN} v := v + x;", tmp_path)
    for x, left in ((3.5, 0.5), (4.0, 1.0), (1.0, 1.0), (-2.0, -2.0)):
        step = pair.step_from({"x": x, "v": 9.0}, {}, {}, {})
        assert (step.state, step.reason) == ({"x": left, "v": left}, "")


def test_time_may_pass_in_a_while_loop(tmp_path: Path) -> None:
    """Flows of a tenth of a second each, the last one cut by its domain."""
    pair = pair_of("{?x > 0; {x' = -1 & x >= 0} v := v + 1;}*; ?!(x > 0);", tmp_path)
    step = pair.step_from({"x": 0.25, "v": 0.0}, {}, {}, {})
    assert step.state == {"x": 0.0, "v": 3.0}
    assert step.duration == pytest.approx(0.25)


def test_a_duration_inside_a_loop_is_chosen_once(tmp_path: Path) -> None:
    """The flow lasts the same part of its longest duration, a tenth of a second, each time round."""
    loop = "{?x > 0; x := x - 1; {v' = 1}}*; ?!(x > 0);"
    pair = pair_of(loop, tmp_path, options={"duration": "agent"})
    step = pair.step_from({"x": 3.0, "v": 0.0}, {}, {}, {"duration_0": 0.5})
    assert step.state == {"x": 0.0, "v": pytest.approx(0.15)}
    assert step.duration == pytest.approx(0.15)


def test_a_loop_without_end_changes_nothing(tmp_path: Path) -> None:
    pair = pair_of("v := v + 1; {?x > 0; x := x + 1;}*; ?!(x > 0);", tmp_path, options={"max_loop": 100})
    step = pair.step_from({"x": 1.0, "v": 1.0}, {}, {}, {})
    assert (step.state, step.reason, step.truncated) == ({"x": 1.0, "v": 1.0}, "diverged", True)
    assert pair.step_from({"x": 0.0, "v": 1.0}, {}, {}, {}).state == {"x": 0.0, "v": 2.0}


def test_the_longest_loop_is_not_a_divergence(tmp_path: Path) -> None:
    pair = pair_of(COUNTDOWN, tmp_path, options={"max_loop": 3})
    assert pair.step_from({"x": 4.0, "v": 0.0}, {}, {}, {}).state["x"] == 1.0
    assert pair.step_from({"x": 5.0, "v": 0.0}, {}, {}, {}).reason == "diverged"


def test_masks_see_through_while_loops(tmp_path: Path) -> None:
    """What is left of x decides which alternatives are open; a loop that blocks is a deadlock."""
    pair = pair_of(f"{COUNTDOWN} {{?x > 0.5; v := 1; ++ ?x < 0.5; v := 2; ++ ?x != 0.5; v := 3;}}", tmp_path)
    for x, mask in ((3.75, [1, 0, 1]), (3.25, [0, 1, 1]), (3.5, [1, 1, 1])):
        pair.batch.set_state(0, [x, 0.0], [])
        assert pair.batch.mask[0].tolist() == mask
        for k in range(3):
            step = pair.step_from({"x": x, "v": 0.0}, {}, {"choice_0": k}, {})
            assert step.blocked == (not mask[k] or x == 3.5)
            assert (step.reason == "deadlock") == (x == 3.5)


def test_a_masked_run_never_blocks(tmp_path: Path) -> None:
    pair = pair_of(
        "{?x > 4; x := x - 3;}*; ?!(x > 4);"
        "{?x > 2; v := x; ++ ?x < 3; v := -x; ++ {?v > 0; v := v - 1;}*; ?!(v > 0); ?v < -0.5;}"
        "{x' = v + 7, v' = 1}",
        tmp_path,
    )
    pair.batch.set_state(0, [3.0, 0.5], [])
    rng, ran = Random(3), 0
    for _ in range(300):
        state = dict(zip(("x", "v"), pair.batch.get_state(0)[0].tolist(), strict=True))
        choice = rng.choice([k for k, open_ in enumerate(pair.batch.mask[0]) if open_])
        step = pair.step_from(state, {}, {"choice_0": choice}, {})
        assert not step.blocked
        ran += 1
        if step.terminated or step.truncated:
            pair.batch.set_state(0, [rng.uniform(-1, 9), rng.uniform(-3, 3)], [])
    assert ran == 300


# Programs repeated as often as decided ----------------------------------------


def test_how_often_is_a_decision(tmp_path: Path) -> None:
    pair = pair_of("{x := 2 * x; ?x <= 8;}*", tmp_path, options={"max_repeat": 4})
    (decision,) = pair.environment.paths.decisions
    assert decision.key == "loop_0" and len(decision.alternatives) == 5
    for k, x in enumerate((1.0, 2.0, 4.0, 8.0)):
        step = pair.step_from({"x": 1.0, "v": 0.0}, {}, {"loop_0": k}, {})
        assert (step.state["x"], step.blocked) == (x, False)
    step = pair.step_from({"x": 1.0, "v": 0.0}, {}, {"loop_0": 4}, {})
    assert (step.state["x"], step.decisions["loop_0"], step.blocked) == (1.0, 0, True)


def test_loops_are_numbered_and_nested_ones_multiply(tmp_path: Path) -> None:
    pair = pair_of("{{x := x + 1;}* v := v + 1;}*", tmp_path, options={"max_repeat": 2})
    assert [d.key for d in pair.environment.paths.decisions] == ["loop_0", "loop_1"]
    step = pair.step_from({"x": 0.0, "v": 0.0}, {}, {"loop_0": 2, "loop_1": 2}, {})
    assert step.state == {"x": 4.0, "v": 2.0}


INPUT = "Real x; Real v;\n/* @var: bound=[0:4] */ Real a;"


def test_a_choice_inside_a_loop_is_made_once(tmp_path: Path) -> None:
    pair = pair_of(
        "{x := x + 1; {v := v + 1; ++ v := v - 1;} {x' = 0}}*", tmp_path, options={"max_repeat": 3}
    )
    for choice, v in ((0, 3.0), (1, -3.0)):
        step = pair.step_from({"x": 0.0, "v": 0.0}, {}, {"loop_0": 3, "choice_0": choice}, {})
        assert step.state == {"x": 3.0, "v": v}


def test_an_input_inside_a_loop_is_given_once(tmp_path: Path) -> None:
    """Without a flow all tests limit it; after a flow the same value has to pass them again."""
    options = {"max_repeat": 2}
    flat = pair_of("{a := *; ?0 <= a & a <= x; x := x - a;}*", tmp_path, INPUT, options)
    step = flat.step_from({"x": 1.0, "v": 0.0, "a": 0.0}, {}, {"loop_0": 2}, {"assign_a": 0.75})
    assert (step.values["assign_a"], step.state["x"], step.blocked) == (0.5, 0.0, False)

    flowing = pair_of("{a := *; ?0 <= a & a <= x; x := x - a; {v' = 1}}*", tmp_path, INPUT, options)
    step = flowing.step_from({"x": 1.0, "v": 0.0, "a": 0.0}, {}, {"loop_0": 2}, {"assign_a": 0.25})
    assert (step.state["x"], step.blocked) == (0.5, False)
    step = flowing.step_from({"x": 1.0, "v": 0.0, "a": 0.0}, {}, {"loop_0": 2}, {"assign_a": 0.75})
    assert (step.state["x"], step.decisions["loop_0"], step.blocked) == (1.0, 0, True)


# Which loop, and what stands before it ------------------------------------------

TWO = "true -> [v := 1; {x := x + v;}* v := 2; {x := x - v;}* x := 0;] v > 0"


def test_one_of_several_loops_is_chosen() -> None:
    with pytest.raises(CompileError) as refused:
        lowered(TWO)
    assert codes(refused.value) == ["several-loops", "several-loops"]
    first = _with_loop(1)
    assert list(print_block(first.body)) == ["x := x + v;"] and list(print_block(first.prefix)) == ["v := 1;"]
    assert first.postcondition is None, "what follows the loop changes v"
    second = _with_loop(2)
    assert list(print_block(second.body)) == ["x := x - v;"]
    assert list(print_block(second.prefix)) == [
        "v := 1;",
        "prefix_loop_0 /* reset, at most 8 times */",
        "  x := x + v;",
        "v := 2;",
    ]
    with pytest.raises(CompileError) as refused:
        _with_loop(3)
    assert codes(refused.value) == ["no-such-loop"]


def _with_loop(number: int) -> Any:
    from dl2c.lower.problem import lower
    from dl2c.parse.parser import parse_archive
    from dl2c.resolve.problem import resolve

    annotated = "/* @var: bound=[0:1] */ Real x;\n/* @var: bound=[0:1] */ Real v;"
    definitions = "/* @safety: penalty=-1 */ Bool p(Real y) <-> y > 0;"
    text = model_text(TWO.replace("v > 0", "p(v)"), definitions, annotated, f"/* @episode: loop={number} */")
    archive, _ = parse_archive(Source("model.kyx", text))
    return lower(resolve(archive.entries[0]), resolve_options({}))


def test_what_nothing_depends_on_starts_at_zero() -> None:
    """Written before the loop, or in every step, before it is read."""
    model = lowered("true -> [v := x; {y := v; x := y;}*] x > 0", "", "Real x; Real v; Real y; Real z;")
    assert {v.name: v.initial for v in model.variables} == {
        "x": "sampled",
        "v": "zero",
        "y": "zero",
        "z": "sampled",
    }


BEFORE = """/* @var: bound=[0:1] */ Real x;
/* @var: bound=[0:9] */ Real v;
/* @var: bound=[-1:1] */ Real a;
/* @var: bound=[0:9] */ Real n;
/* @var: bound=[0:9] */ Real y;"""


def test_the_program_before_the_loop_runs_at_every_reset() -> None:
    """Only states from which it has a run are kept; what it decides is random, but in its limits."""
    env = Dl2cEnv(
        model_text(
            "v = 0 & n = 0 & y = 0 ->"
            " [?x > 0.5; a := *; ?-x <= a & a <= x; {v := 1; ++ ?a > 0; v := 2; ++ ?a < -2; v := 3;}"
            " {n := n + 1;}* {y' = 1 & y <= 2} {x := x + 1;}*] x > 0",
            "",
            BEFORE,
        ),
        loop=2,
        max_repeat=2,
        dt=4,
    )
    seen: Counter[object] = Counter()
    for seed in range(200):
        env.reset(seed=seed)
        state = env.state
        assert 0.5 < state["x"] <= 1 and abs(state["a"]) <= state["x"] and 0 < state["y"] <= 2
        assert state["v"] in ((1, 2) if state["a"] > 0 else (1,))
        seen.update([("n", state["n"]), ("v", state["v"]), ("early", state["y"] < 1)])
        env.reset(seed=seed)
        assert env.state == state
    assert all(40 <= seen["n", n] <= 100 for n in (0, 1, 2))
    assert 30 <= seen["v", 2] <= 75 and seen["v", 3] == 0
    assert 70 <= seen["early", True] <= 130


def test_a_program_before_the_loop_that_never_runs_is_an_error_at_reset() -> None:
    env = Dl2cEnv(model_text("true -> [?x > 2; {x := x + 1;}*] x > 0", "", BEFORE.splitlines()[0]))
    with pytest.raises(ResetFailed, match="none of 1000 initial states"):
        env.reset(seed=0)


# Warnings ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("program", "code"),
    [
        ("{x := *; ?0 <= x & x <= 1;}*", "decision-in-loop"),
        ("{?x > 0; {x := 0; ++ x := x - 1;}}*; ?!(x > 0);", "decision-in-loop"),
        ("?x > 0; {x' = 1} ++ ?x < 0; {x' = -1}", "agent-moves-world"),
        ("/* @choice: role=env */ {?x > 0; {x' = 1} ++ ?x < 0; {x' = -1}}", ""),
        ("x := 1; {x' = 1} ++ x := 2; {x' = -1}", ""),
        ("{x := x + 1;}*", ""),
    ],
)
def test_doubtful_decisions_are_named(program: str, code: str) -> None:
    text = model_text(f"x = 0 -> [{{{program}}}*] x >= 0", "", "/* @var: bound=[0:1] */ Real x;")
    assert [w.code for w in check_model(Source("model.kyx", text), resolve_options({}))] == [code] * bool(
        code
    )


def test_runs_are_whole_control_paths_up_to_the_first_flow() -> None:
    paths = paths_of(f"true -> [{{{COUNTDOWN} {{v := 1; ++ v := 2;}} {{x' = v}}}}*] x > 0")
    assert paths.runs == ((0,), (1,))
