"""Exported policies: the C does what `predict` of Stable-Baselines3 does, and the simulator makes of it."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selection import quick_among, quick_rows

import dl2c
from dl2c.commands.monitor import unit_of
from dl2c.commands.policy import policy_for
from dl2c.emit.monitor.files import monitor_files
from dl2c.env.state import read_drawn
from dl2c.ir.liveness import written
from dl2c.native.program import answers, compile_program

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
contrib = pytest.importorskip("sb3_contrib")

COUNT = 10_000

TWO_CHOICES = """ProgramVariables
  /* @var: bound=[-5:5] */ Real x;
  /* @var: bound=[-5:5] */ Real y;
End.
Problem x = 0 & y = 0 -> [{
  {?x < 4; x := x + 1; ++ ?x > -4; x := x - 1; ++ x := x / 2;}
  {?y < 4 & x > 0; y := y + 1; ++ y := 0;}
}*](x <= 5)
End.
"""


BEFORE = """Definitions Real half(Real v) = v / 3; End.
ProgramVariables
  /* @var: bound=[-5:5] */ Real x;
  /* @var: bound=[-5:5], role=env */ Real y;
  /* @var: bound=[-20:20] */ Real seen;
  /* @var: bound=[-20:20] */ Real w;
End.
Problem x = 0 & y = 0 & seen = 0 & w = 0 -> [{
  y := *; ?-5 <= y & y <= 5;
  if (y > x) { seen := half(y) - x; } else {
    /* @choice: name="mode", role=env */ { seen := y * y / 7; ++ seen := x; w := y; }
  }
  { {?seen < 4; x := x / 2 + seen / 8; ++ x := x / 2;} }
}*](x <= 50)
End.
"""


@dataclass(frozen=True)
class Kind:
    """A policy to export: a model, how it is acted in, and how the policy is made. `earlier` are variables
    that have the value of others before the environment decides, since its second alternative copies them.
    """

    model: str
    algorithm: str = "PPO"
    normalised: bool = False
    options: dict[str, Any] = field(default_factory=dict)
    arguments: dict[str, Any] = field(default_factory=dict)
    earlier: dict[str, str] = field(default_factory=dict)


KINDS = {
    "discrete": Kind("example:waypoint"),
    "discrete-normalised": Kind("example:waypoint", normalised=True),
    "masked": Kind("example:waypoint", "MaskablePPO"),
    "masked-normalised": Kind("example:static_safety_line", "MaskablePPO", True),
    "runs": Kind("example:waypoint", "MaskablePPO", options={"action_format": "discrete"}),
    "multidiscrete": Kind(TWO_CHOICES, "MaskablePPO"),
    "multidiscrete-runs": Kind(TWO_CHOICES, "MaskablePPO", options={"action_format": "discrete"}),
    "multidiscrete-unmasked": Kind(TWO_CHOICES),
    "continuous": Kind("example:dubins", options={"obs_dtype": "float64"}),
    "continuous-normalised": Kind("example:watertank", normalised=True),
    "continuous-squash": Kind("example:watertank", options={"action_map": "squash"}),
    "continuous-squash-normalised": Kind(
        "example:pendulum", normalised=True, options={"action_map": "squash"}
    ),
    "choice-and-value": Kind("example:acc"),
    "environment-choice": Kind("example:etcs", earlier={"m": "m0", "d": "d0"}),
    "environment-choice-normalised": Kind(
        "example:etcs", normalised=True, options={"obs_dtype": "float64"}, earlier={"m": "m0", "d": "d0"}
    ),
    "environment-branches": Kind(BEFORE, "MaskablePPO"),
    "choice-and-value-squash": Kind("example:acc", options={"action_map": "squash"}),
    "sde-squashed-output": Kind(
        "example:watertank", arguments={"use_sde": True, "policy_kwargs": {"squash_output": True}}
    ),
    "relu": Kind("example:dubins", arguments={"policy_kwargs": {"activation_fn": torch.nn.ReLU}}),
    "elu": Kind(
        "example:dubins", arguments={"policy_kwargs": {"activation_fn": torch.nn.ELU, "net_arch": [8]}}
    ),
}


@dataclass(frozen=True)
class Exported:
    """A policy of Stable-Baselines3, its environment, and the program of what was exported."""

    model: Any
    env: Any
    statistics: Any
    program: Path
    unit: Any
    policy: Any

    def normalised(self, observations: Any) -> Any:
        return observations if self.statistics is None else self.statistics.normalize_obs(observations)

    def predicted(self, observations: Any, masks: Any = None) -> Any:
        given = {} if masks is None else {"action_masks": masks}
        return self.model.predict(self.normalised(observations), deterministic=True, **given)[0]

    def raw(self, observations: Any) -> Any:
        """Logits, or means before they are clipped, of the same network in doubles."""
        policy = self.model.policy.double()
        with torch.no_grad():
            given = policy.pi_features_extractor(torch.as_tensor(self.normalised(observations)).double())
            values = policy.action_net(policy.mlp_extractor.forward_actor(given))
        policy.float()
        return (torch.tanh(values) if policy.squash_output else values).numpy()


NETWORK = """\
#include "@_policy.h"
#include <stdio.h>

int main(void)
{
  double x[@@_OBSERVATIONS];
  for (;;) {
    REAL observation[@@_OBSERVATIONS], output[@@_OUTPUTS];
    for (int k = 0; k < @@_OBSERVATIONS; k++) {
      if (scanf("%lf", &x[k]) != 1)
        return 0;
      observation[k] = (REAL)x[k];
    }
    @_policy_outputs(observation, output);
    for (int k = 0; k < @@_OUTPUTS; k++)
      printf("%.9g ", (double)output[k]);
    puts("");
  }
}
"""


def saved(kind: Kind, folder: Path) -> tuple[Any, Any, Any]:
    """An untrained policy with random weights, written as Stable-Baselines3 does."""
    torch.manual_seed(7)
    env = dl2c.make_sb3(kind.model, 1, **kind.options)
    algorithm = contrib.MaskablePPO if kind.algorithm == "MaskablePPO" else sb3.PPO
    model = algorithm("MlpPolicy", env, device="cpu", seed=7, **kind.arguments)
    with torch.no_grad():
        for p in model.policy.parameters():
            p.copy_(torch.randn_like(p) * (0.3 if p.ndim > 1 else 0.1))
    model.save(folder / "policy.zip")
    statistics = None
    if kind.normalised:
        statistics = sb3.common.vec_env.VecNormalize(env, clip_obs=3.0)
        rng = np.random.default_rng(1)
        statistics.obs_rms.mean = rng.normal(size=env.observation_space.shape)
        statistics.obs_rms.var = rng.uniform(0.5, 20, env.observation_space.shape)
        statistics.save(folder / "vecnormalize.pkl")
    return model, env, statistics


def export(name: str, folder: Path, real: str = "double", main: str = "") -> Exported:
    kind = KINDS[name]
    model, env, statistics = saved(kind, folder)
    policy, options = policy_for(kind.model, folder, kind.options)
    unit = unit_of(kind.model, options, ("controller",), real=real)
    files = monitor_files(unit, policy)
    if main:
        files["main.c"] = main.replace("@@", unit.stem.upper()).replace("@", unit.stem).replace("REAL", real)
    return Exported(model, env, statistics, compile_program(files, folder), unit, policy)


QUICK = (
    *("masked", "multidiscrete-runs", "continuous-squash-normalised", "choice-and-value"),
    "environment-choice",
)
FORMS = [*((k, "double") for k in KINDS), *((k, "float") for k in ("masked-normalised", "continuous", "elu"))]


@pytest.mark.parametrize(
    ("name", "real"), quick_rows(FORMS, [("choice-and-value", "double"), ("elu", "float")])
)
def test_the_network_is_that_of_stable_baselines(name: str, real: str, tmp_path: Path) -> None:
    one = export(name, tmp_path, real, NETWORK)
    space, policy = one.env.observation_space, one.policy
    rng = np.random.default_rng(2)
    low = np.maximum(space.low, -100)
    high = np.where(low < 100, np.minimum(space.high, 100), space.high)
    observations = rng.uniform(low, high, (COUNT, len(low))).astype(space.dtype)
    lines = [" ".join(map(repr, o.tolist())) for o in observations]
    found = np.array([list(map(float, text.split())) for text in answers(one.program, lines)])
    wanted = one.raw(observations)
    scale = np.maximum(1, np.abs(wanted).max())
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() <= 1e-5 * scale
    assert np.abs(policy.network.outputs(observations) - wanted).max() <= 1e-5 * scale
    masks = np.ones((COUNT, policy.interface.outputs), np.bool_)
    predicted = one.predicted(observations)
    acted = policy.act(observations, masks)
    if policy.interface.kind == "box":
        assert np.abs(acted - predicted).max() <= 1e-5 * scale
    else:
        same = (acted == predicted).reshape(COUNT, -1).all(axis=1)
        assert all(_is_tied(wanted[k], policy.interface) for k in np.flatnonzero(~same))
        assert same.mean() > 0.999


def _is_tied(values: Any, io: Any) -> bool:
    """Whether two of the largest numbers are as good as equal."""
    parts = np.split(values, np.cumsum(io.counts)[:-1]) if io.kind == "choices" else [values]
    return any(np.diff(np.sort(p)[-2:])[0] < 1e-4 for p in parts)


STEPS = 300


@pytest.mark.parametrize("name", quick_among(KINDS, QUICK))
def test_the_monitored_policy_does_what_the_simulator_does(name: str, tmp_path: Path) -> None:
    """Observations, masks, actions and values of inputs; and what is done instead of what is not possible.

    States are shown when the environment has decided for the next step.
    """
    one = export(name, tmp_path)
    model, unit = one.unit.monitor.model, one.unit
    moving = {
        x for flow in model.flows for x, rate in flow.equations if float(getattr(rate, "value", 1)) != 0
    }
    decided = written(model.lead, ())
    still = [v.name for v in model.variables if v.name not in moving and v.name not in decided]
    lines: list[str] = []
    wanted: list[dict[str, float]] = []
    outputs: list[Any] = []
    one.env.seed(5)
    observation = one.env.reset()
    for _ in range(STEPS):
        masks = one.env.action_masks() if one.policy.masked else None
        before = state_of(one.env)
        action, given = one.predicted(observation, masks), one.raw(observation)[0]
        observation, _, dones, _ = one.env.step(action)
        if dones[0] or (one.env.batch.blocked[0] and len(unit.monitor.controller.decisions) > 1):
            continue
        decisions = read_drawn(one.env.manifest, one.env.batch)
        drawn = {key: float(np.nan_to_num(value[0])) for key, value in decisions.items()}
        if drawn.get("choice_0") == 1:
            before |= {x: before[copy] for x, copy in KINDS[name].earlier.items()}
        keys = [known.key for known in (*unit.monitor.controller.inputs, *unit.monitor.controller.measured)]
        inputs = " ".join(repr(drawn.get(key, 0.0)) for key in keys)
        numbers = [before[v.name] for v in model.variables] + [before[c.name] for c in unit.parameters]
        lines.append(f"policy {' '.join(map(repr, numbers))} {inputs}")
        wanted.append(state_of(one.env))
        outputs.append(given)
    assert len(lines) > 50
    names = [v.name for v in model.variables]
    for text, after, given in zip(answers(one.program, lines), wanted, outputs, strict=True):
        found = list(map(float, text.split()))
        assert np.abs(np.array(found[: -len(names)]) - given).max() <= 1e-5 * max(1, np.abs(given).max())
        post = dict(zip(names, found[-len(names) :], strict=True))
        for x in still:
            assert math.isclose(post[x], after[x], rel_tol=2e-5, abs_tol=2e-5), (x, post, after)


def state_of(env: Any) -> dict[str, float]:
    x, p = env.batch.get_state(0)
    names = [q.name for q in (*env.manifest.variables, *env.manifest.constants)]
    return dict(zip(names, (*x.tolist(), *p.tolist()), strict=True))
