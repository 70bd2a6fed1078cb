"""What the environment decides: when, among what, and from which random numbers."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from agreement import assert_batch_equals_singles
from differential import pair_of
from generators.kyx_builder import lowered, model_text
from gymnasium.vector import AutoresetMode
from oracles.streams import Stream

from dl2c.env.single import Dl2cEnv
from dl2c.env.vector import Dl2cVectorEnv
from dl2c.ir.model import ONE, TRUE, Assign, AssignAny, Choice, Evolve, Test
from dl2c.ir.printer import print_block
from dl2c.lower.leading import leading

pytestmark = pytest.mark.usefixtures("unoptimised")

WALK = Path(__file__).parents[1] / "good" / "walk.kyx"


def split(program: str, variables: str = "Real x;\n/* @var: role=env, bound=[0:1] */ Real w;") -> list[str]:
    model = lowered(f"true -> [{{{program}}}*] x > 0", "", variables)
    return [" ".join(" ".join(print_block(part)).split()) for part in (model.lead, model.body)]


def test_a_step_begins_with_what_the_environment_decides_first() -> None:
    drawn = "w := *; /* assign_w, env */"
    assert split("x := 1; w := *; ?w <= x; x := 2; x := w;") == [
        f"x := 1; {drawn} ?w <= x;",
        "x := 2; x := w;",
    ]
    assert split("{x' = 1} w := *;") == ["", f"flow 0 {drawn}"]
    assert split("{x := 1; ++ x := 2;} w := *;")[0] == ""
    assert split("if (x > 0) {w := *;} x := 3;")[1] == "x := 3;"


def test_a_choice_of_the_environment_may_hold_decisions_of_the_agent() -> None:
    """It is made early, and what remains of it knows how."""
    model = lowered(
        "true -> [{/* @choice: role=env */ {?x > 0; {v := 1; ++ v := 2;} ++ v := 3; {x' = v}}}*] x > 0"
    )
    (early,), (late,) = model.lead, model.body
    assert isinstance(early, Choice) and isinstance(late, Choice) and early.key == late.key
    assert [[type(s) for s in a.body] for a in early.alternatives] == [[Test], []]
    assert [[type(s) for s in a.body] for a in late.alternatives] == [[Choice], [Assign, Evolve]]


def test_splitting_a_step_keeps_its_statements() -> None:
    body = (Test(TRUE), AssignAny("x", "assign_x", "env"), Test(TRUE), Assign("x", ONE), Test(TRUE))
    assert leading(body) == (body[:3], body[3:])


WIND = """/* @var: bound=[-9:9] */ Real x;
/* @var: bound=[-2:2], role=env */ Real w;
/* @var: bound=[0:9] */ Real g;"""
WINDY = model_text(
    "x = 0 & w = 0 & g = 0 -> [{w := *; ?x - 1 <= w & w <= x + 1;"
    " {x := x + 1; ++ ?w > 0; x := x - 1; ++ ?w < 0; g := 5;}"
    " /* @choice: role=env */ {g := 0; ++ ?x > 0; g := 1; ++ ?x < 0; g := 2;}}*] calm(w)",
    "/* @stability: reward={w} */ Bool calm(Real y) <-> true;",
    WIND,
)


def test_the_agent_sees_what_the_environment_decided_first() -> None:
    """Observation and mask show the new wind; the reward judges the state before it."""
    env = Dl2cEnv(WINDY)
    assert str(env.action_space) == "Discrete(3)"
    drawn: Counter[object] = Counter()
    for seed in range(60):
        observation, info = env.reset(seed=seed)
        x, w, g = observation.tolist()
        for _ in range(5):
            assert x - 1 <= w <= x + 1 and -2 <= w <= 2
            assert info["action_mask"].tolist() == [1, int(w > 0), int(w < 0)]
            observation, reward, terminated, truncated, info = env.step(0)
            assert info["environment"]["assign_w"] == pytest.approx(w)
            assert reward == pytest.approx(w), "judged before the next wind"
            assert not info["blocked"] and set(info["environment"]) == {"choice_1", "assign_w"}
            x, w, g = observation.tolist()
            assert g == info["environment"]["choice_1"] and g in (0, 1)
            drawn[g] += 1
            if terminated or truncated:
                break
    assert 0.35 <= drawn[0] / (drawn[0] + drawn[1]) <= 0.65


def test_an_alternative_for_which_the_environment_has_no_answer_is_closed(tmp_path: Path) -> None:
    pair = pair_of(
        "{x := 1; ++ x := 2; ++ x := 3;}"
        " /* @choice: role=env */ {?x = 1; v := 1; ++ ?x = 3; v := 3; ++ ?x > 2;}",
        tmp_path,
    )
    pair.batch.reset_to(0, 7, [0.0, 0.0], [])
    assert pair.batch.mask[0].tolist() == [1, 0, 1]
    assert [d.role for d in pair.environment.paths.decisions] == ["agent", "env"]
    pair.batch.choices[0, 0] = 1
    pair.batch.step()
    assert pair.batch.blocked[0] and pair.batch.executed_choices[0].tolist() == [0]
    assert pair.batch.drawn_choices[0].tolist() == [0]


def test_environment_draws_are_the_stream_of_the_episode(tmp_path: Path) -> None:
    variables = "Real x;\n/* @var: role=env, bound=[2:4] */ Real w;"
    pair = pair_of("w := *; x := x + w;", tmp_path, variables)
    pair.batch.reset_to(0, 11, [0.0, 2.0], [])
    stream, total = Stream.of(11, 0), 0.0
    for _ in range(4):
        wind = 2.0 + 2.0 * stream.unit()
        assert pair.batch.get_state(0)[0].tolist() == [total, wind]
        total += wind
        pair.batch.step()
        assert pair.batch.drawn_inputs[0, 0] == wind


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_a_batch_of_changing_environments_is_many_single_ones(mode: AutoresetMode) -> None:
    ended = assert_batch_equals_singles(str(WALK), mode, n=5, steps=50)
    assert ended >= 5


def test_a_batch_of_many_blocks_is_many_single_ones() -> None:
    envs, single = Dl2cVectorEnv(str(WALK), 130), Dl2cEnv(str(WALK))
    envs.reset(seed=100)
    single.reset(seed=229)
    for _ in range(30):
        envs.step(np.tile([1, 0], (130, 1)))
        _, _, terminated, truncated, _ = single.step([1, 0])
        if terminated or truncated:
            return
        assert envs.state(129) == single.state


def test_a_value_is_drawn_before_what_depends_on_it(tmp_path: Path) -> None:
    """Both branches are as likely as the values that lead to them."""
    variables = "Real x;\n/* @var: role=env, bound=[-3:1] */ Real w;"
    pair = pair_of("{x' = 0} w := *; if (w > 0) { x := 1; } else { x := 2; }", tmp_path, variables)
    pair.batch.reset_to(0, 5, [0.0, 0.0], [])
    seen: Counter[float] = Counter()
    for _ in range(400):
        pair.batch.step()
        x, w = pair.batch.get_state(0)[0].tolist()
        assert x == (1 if w > 0 else 2) and w == pair.batch.drawn_inputs[0, 0]
        seen[x] += 1
    assert 70 <= seen[1.0] <= 130
