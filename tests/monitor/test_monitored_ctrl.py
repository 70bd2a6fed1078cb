"""The controller's side of an exported monitor: what it executes is what the simulator executes."""

import math
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY
from monitor_program import Program, program_of
from selection import quick_among

import dl2c
from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.files import monitor_files
from dl2c.env.actions import flat_format
from dl2c.env.encodings import Flat
from dl2c.env.opening import open_library, source_of
from dl2c.native.program import answers, compile_program

pytestmark = pytest.mark.usefixtures("unoptimised")

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
INPUTS = ["acc", "dubins", "pendulum", "static_safety", "watertank"]
ENVIRONMENT = {"static_safety": ("xo", "yo")}
"""What the environment gives values to, by example."""

State = dict[str, float]


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """`programs(example, **options)` is its monitor, compiled once."""
    made: dict[str, Program] = {}

    def program(example: str, sound: bool = False, real: str = "double", **options: Any) -> Program:
        key = f"{example}-{sound}-{real}-{sorted(options.items())}"
        if key not in made:
            unit = unit_of(f"example:{example}", options, real=real, sound=sound)
            made[key] = program_of(unit, tmp_path_factory.mktemp("monitor"))
        return made[key]

    return program


def numbers(*parts: State) -> str:
    return " ".join(repr(float(v)) for part in parts for v in part.values())


def states_of(program: Program, lines: list[str]) -> list[list[float]]:
    return [[float(word) for word in text.split()] for text in answers(program.path, lines)]


def environment(example: str, **options: Any) -> tuple[Any, Any]:
    """The environment with flat actions, and how these are written."""
    source = source_of(f"example:{example}")
    action_format = flat_format(open_library(source, options).manifest)
    env = dl2c.make(source, action_format=action_format, **options)
    return env, env.unwrapped._encoding


def steps(example: str, count: int, **options: Any) -> Iterator[tuple[State, Any, State, dict[str, Any]]]:
    """State before, the action asked for, state after, info of steps with random actions."""
    env, _ = environment(example, **options)
    env.action_space.seed(3)
    seed = ended = 0
    for _ in range(count):
        if not seed or ended:
            env.reset(seed=(seed := seed + 1))
        before, action = env.state, env.action_space.sample()
        *_, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
        yield before, action, env.state, info
    env.close()


def requested(program: Program, code: Any, action: Any, after: State, example: str) -> str:
    """What a program is asked for an action: values of its inputs, alternatives of its decisions."""
    controller = program.unit.monitor.controller
    assert controller is not None
    agent = [i for i in controller.inputs if i.role == "agent"]
    flat = list(np.asarray(action, float).reshape(-1))
    values = {i.key: flat[k] for k, i in enumerate(agent)} if isinstance(code, Flat) else {}
    tail = flat[len(values) :]
    if isinstance(code, Flat) and code.squash:
        tail = [(t + 1) / 2 * (n - 1) for t, n in zip(tail, code.counts, strict=True)]
    choices = [
        int(np.clip(np.rint(t), 0, len(d.alternatives) - 1))
        for t, d in zip(tail, controller.decisions, strict=False)
    ]
    given = [values[i.key] if i.role == "agent" else after[i.variable] for i in controller.inputs]
    return " ".join(map(repr, map(float, given))) + " " + " ".join(map(str, choices))


@pytest.mark.parametrize("action_map", ["project", "squash"])
@pytest.mark.parametrize("example", quick_among(INPUTS, ("dubins", "static_safety")))
def test_runs_give_inputs_the_values_of_the_simulator(example: str, action_map: str, programs: Any) -> None:
    program = programs(example, action_map=action_map)
    _, code = environment(example, action_map=action_map)
    model = program.unit.monitor.model
    names = [v.name for v in model.variables]
    chosen = {i.variable for i in program.unit.monitor.controller.inputs} - set(ENVIRONMENT.get(example, ()))
    chosen -= {
        x for flow in model.flows for x, rate in flow.equations if float(getattr(rate, "value", 1)) != 0
    }
    lines: list[str] = []
    wanted: list[State] = []
    for before, action, after, info in steps(example, 400, action_map=action_map):
        if not info["blocked"] and info["reason"] not in ("numerical", "solver"):
            parameters = {c.name: before[c.name] for c in program.unit.parameters}
            asked = requested(program, code, action, after, example)
            lines.append(f"run {numbers({x: before[x] for x in names}, parameters)} {asked}")
            wanted.append(after)
    assert len(lines) > 40 and chosen
    for (possible, *post), after in zip(states_of(program, lines), wanted, strict=True):
        got = dict(zip(names, post, strict=True))
        assert possible == 1
        for name in chosen:
            assert math.isclose(got[name], after[name], rel_tol=1e-9, abs_tol=1e-9), name


@pytest.mark.parametrize("sound", [False, True], ids=["plain", "sound"])
@pytest.mark.parametrize("example", quick_among(EXAMPLES, ("etcs", "pendulum")))
def test_the_fallback_satisfies_the_monitor(example: str, sound: bool, programs: Any) -> None:
    """From every state that the simulator reaches, whatever is asked for and measured there. The environment
    has decided already in these, and then takes its first alternatives.
    """
    program = programs(example, sound=sound)
    model, controller = program.unit.monitor.model, program.unit.monitor.controller
    rng = random.Random(5)
    rows: list[list[State]] = []
    lines: list[str] = []
    for before, _, after, _ in steps(example, 300):
        state = {v.name: before[v.name] for v in model.variables}
        parameters = {c.name: before[c.name] for c in program.unit.parameters}
        given = {
            i.key: rng.uniform(-30, 30) if i.role == "agent" else after[i.variable] for i in controller.inputs
        }
        given |= dict.fromkeys((d.key for d in controller.measured), 0)
        rows.append([state, parameters])
        lines.append(f"fallback {numbers(state, parameters, given)}")
    posts = [dict(zip(rows[0][0], post, strict=True)) for post in states_of(program, lines)]
    asked = [f"controller {numbers(s, post, p)}" for (s, p), post in zip(rows, posts, strict=True)]
    verdicts = [text.split()[0] for text in answers(program.path, asked)]
    assert set(verdicts) == {"0"}


# Users' controllers ----------------------------------------------------------------------------------

DRIVER = """\
#include "Static_safety_on_a_line_monitor.h"

#include <math.h>
#include <stdio.h>

typedef Static_safety_on_a_line_state state;
typedef Static_safety_on_a_line_parameters parameters;
typedef Static_safety_on_a_line_input input;

static state reckless(state curr, const parameters *params, const input *in)
{
  (void)in;
  curr.a = params->A;
  curr.t = 0;
  return curr;
}

static state own(state curr, const parameters *params, const input *in)
{
  (void)params;
  (void)in;
  curr.a = -1;
  return curr;
}

int main(void)
{
  const parameters p = {0.25, 4, 2, 3};
  const input in = {0};
  const state far = {1, 2, 0, 60, 0.25};
  state near = far;
  near.xo = 2;
  state blind = far;
  blind.xo = NAN;
  printf("%g ", Static_safety_on_a_line_monitored_ctrl(far, &p, &in, reckless, 0).a);
  printf("%g ", Static_safety_on_a_line_monitored_ctrl(near, &p, &in, reckless, 0).a);
  printf("%g ", Static_safety_on_a_line_monitored_ctrl(near, &p, &in, reckless, own).a);
  printf("%g ", Static_safety_on_a_line_monitored_ctrl(blind, &p, &in, reckless, 0).a);
  printf("%g ", Static_safety_on_a_line_monitored_ctrl(near, &p, &in, 0, 0).a);
  const state post = reckless(far, &p, &in);
  const Static_safety_on_a_line_decision free =
      Static_safety_on_a_line_decide(far, &p, &in, reckless, own);
  const Static_safety_on_a_line_decision held =
      Static_safety_on_a_line_decide(near, &p, &in, reckless, own);
  const Static_safety_on_a_line_decision lost =
      Static_safety_on_a_line_decide(blind, &p, &in, reckless, own);
  printf("%d%d%d ", free.overruled, free.verdict.id, free.wanted.id);
  printf("%d%d%d ", held.overruled, held.verdict.id, held.wanted.id > 1);
  printf("%d%d%d%g ", lost.overruled, lost.verdict.id, lost.wanted.id, lost.post.a);
  printf("%d ", Static_safety_on_a_line_monitor_satisfied(far, post, &p));
  printf("%d\\n", Static_safety_on_a_line_boundary_dist(far, post, &p).val > 0);
  return 0;
}
"""


def test_a_controller_is_heeded_while_the_monitor_accepts_it(tmp_path: Path) -> None:
    """Full speed far away; near the obstacle, and where it is not seen, the model's own first alternative."""
    unit = unit_of("example:static_safety_line", {})
    program = compile_program(monitor_files(unit) | {"main.c": DRIVER}, tmp_path)
    assert answers(program, []) == ["2 -4 -4 -4 -4 000 101 111-1 1 1"]


MARKED = """ProgramVariables Real x; Real y; End.
Problem x = 0 & y = 0 -> [{
  {?x >= 0; y := 1; ++ {y := 2; ++ y := 3;} ++ @MARK {?x >= 1; y := 4;}} x := x + 1;
}*]y >= 0 End.
"""


@pytest.mark.parametrize(
    ("mark", "x", "y"), [("", 5, 1), ("", -1, 2), ("/* @fallback */", 5, 4), ("/* @fallback */", 0, 1)]
)
def test_the_fallback_is_the_marked_alternative_or_the_first(
    mark: str, x: float, y: float, tmp_path: Path
) -> None:
    program = program_of(unit_of(MARKED.replace("@MARK", mark), {}), tmp_path)
    assert states_of(program, [f"fallback {x} 0"]) == [[x + 1, y]]
