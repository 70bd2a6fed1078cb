"""Where the agent has a decision to take. That elsewhere its request makes no difference is compared in every
step of `differential.py`, on random models.
"""

from pathlib import Path

import numpy as np
import pytest
from differential import pair_of

from dl2c.env.opening import batch_options, open_library, source_of
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.native.errors import BatchClosed

FLOW = "t := 0; {x' = v, t' = 1 & t <= 1}"
VARIABLES = "Real x; Real v; Real t;"

PROGRAMS = {
    "a choice": ("if (x > 1) { {v := 1; ++ v := 2;} } " + FLOW, lambda x: x > 1),
    "an input": ("if (x > 1) { v := *; ?(0 <= v & v <= 2); } " + FLOW, lambda x: x > 1),
    "one alternative": ("if (x > 1) { {?x < 0; v := 1; ++ v := 2;} } " + FLOW, lambda x: x > 1),
    "none": ("if (x > 1) { v := 1; } else { v := 2; } " + FLOW, lambda x: False),
    "chance": ("/* @choice: role=env */ {v := 1; ++ v := 2;} " + FLOW, lambda x: False),
    "after a flow": (FLOW + "; if (x > 1) { {v := 1; ++ v := 2;} }", lambda x: True),
    "after two flows": (
        f"if (x > 1) {{ {FLOW} }} {FLOW}; if (x > 3) {{ {{v := 1; ++ v := 2;}} }}",
        lambda x: True,
    ),
    "after a flow of some runs": (
        f"if (x > 1) {{ {FLOW}; {{v := 1; ++ v := 2;}} }} else {{ {FLOW} }}",
        lambda x: x > 1,
    ),
    "after a while loop": (
        "{?x > 1; x := x - 1;}* ?!(x > 1); {v := 1; ++ v := 2;} " + FLOW,
        lambda x: True,
    ),
    "in a while loop": ("{?x > 1; {x := x - 1; ++ x := x - 2;}}* ?!(x > 1); " + FLOW, lambda x: x > 1),
}
"""What a step does, and for which x the agent decides something in it."""


@pytest.mark.parametrize("name", PROGRAMS)
def test_where_the_agent_decides(name: str, tmp_path: Path) -> None:
    program, expected = PROGRAMS[name]
    pair = pair_of(program + (";" if program.endswith("}") else ""), tmp_path, VARIABLES)
    for x in (-2.0, 0.0, 1.0, 1.5, 3.0):
        pair.batch.set_state(0, [x, 0.5, 0.0], [])
        assert pair.batch.decides().tolist() == [expected(x)]


@pytest.mark.parametrize("autoreset", ["disabled", "next_step", "same_step"])
def test_nothing_is_decided_where_the_next_step_begins_an_episode(autoreset: str) -> None:
    library = open_library(source_of("example:acc"), {"max_episode_steps": 3})
    batch = library.batch(70, autoreset=autoreset, **batch_options(library.manifest))
    batch.reset(seeds=np.arange(70, dtype=np.uint64))
    for _ in range(3):
        assert batch.decides().all()
        batch.step()
    assert batch.decides().all() == (autoreset == "same_step")
    assert batch.decides().any() == (autoreset == "same_step")


def test_a_ball_is_hit_at_the_ground_alone() -> None:
    envs = Dl2cVecEnv("example:bouncing_ball", 64)
    envs.seed(0)
    heights, asked = envs.reset()[:, 0], 0
    for _ in range(100):
        assert np.array_equal(envs.decides(), heights == 0)
        asked += int(envs.decides().sum())
        heights = envs.step(np.ones(64, np.int64))[0][:, 0]
    assert asked > 64
    envs.close()
    with pytest.raises(BatchClosed):
        envs.decides()
