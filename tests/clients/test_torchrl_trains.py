"""One iteration of PPO of TorchRL, with masks and without. `make test-clients` runs this.

Its checkers are in `tests/env/test_torchrl.py`.
"""

from typing import Any

import pytest

import dl2c
from dl2c.env.masked import env_creator

pytestmark = pytest.mark.slow
torch: Any = pytest.importorskip("torch")
envs: Any = pytest.importorskip("torchrl.envs")

PENALTY = -1e6
FRAMES = 256


def layers(outputs: int) -> Any:
    return torch.nn.Sequential(torch.nn.LazyLinear(32), torch.nn.Tanh(), torch.nn.LazyLinear(outputs))


def policy_of(env: Any, keys: dict[str, str]) -> Any:
    """An actor: `keys` are the entries that its distribution takes, and the observation among them."""
    from tensordict.nn import NormalParamExtractor, TensorDictModule
    from torchrl.modules import MaskedCategorical, ProbabilisticActor, TanhNormal

    obs, spec = keys["obs"], env.action_spec_unbatched
    discrete = "mask" in keys
    if discrete:
        net = TensorDictModule(layers(spec.space.n), in_keys=[obs], out_keys=["logits"])
        distribution: dict[str, Any] = {"distribution_class": MaskedCategorical}
        entries: Any = {"logits": "logits", "mask": keys["mask"]}
    else:
        size = spec.shape[-1]
        parts = torch.nn.Sequential(layers(2 * size), NormalParamExtractor())
        net = TensorDictModule(parts, in_keys=[obs], out_keys=["loc", "scale"])
        limits = {"low": spec.space.low, "high": spec.space.high}
        distribution = {"distribution_class": TanhNormal, "distribution_kwargs": limits}
        entries = ["loc", "scale"]
    return ProbabilisticActor(
        net, spec=env.action_spec, in_keys=entries, return_log_prob=True, **distribution
    )


def trained(make: Any, keys: dict[str, str]) -> Any:
    """The rewards of one iteration, which has changed the policy."""
    from tensordict.nn import TensorDictModule
    from torchrl.collectors import Collector
    from torchrl.modules import ValueOperator
    from torchrl.objectives import ClipPPOLoss
    from torchrl.objectives.value import GAE

    env = make()
    actor: TensorDictModule = policy_of(env, keys)
    critic = ValueOperator(layers(1), in_keys=[keys["obs"]])
    start = env.reset()
    actor(start.clone())
    critic(start.clone())
    before = [p.detach().clone() for p in actor.parameters()]
    collector = Collector(make, actor, frames_per_batch=FRAMES, total_frames=FRAMES)
    (data,) = [batch.clone() for batch in collector]
    collector.shutdown()
    loss = ClipPPOLoss(actor, critic)
    optimiser = torch.optim.Adam(loss.parameters(), 1e-3)
    GAE(gamma=0.99, lmbda=0.95, value_network=critic)(data)
    losses = loss(data)
    sum(value for key, value in losses.items() if key.startswith("loss_")).backward()
    optimiser.step()
    assert any(not torch.equal(p, old) for p, old in zip(actor.parameters(), before, strict=True))
    assert data.numel() == FRAMES
    return data["next", "reward"]


def test_ppo_trains_on_an_id() -> None:
    rewards = trained(lambda: envs.GymEnv("dl2c/Dubins-v0"), {"obs": "observation"})
    assert torch.isfinite(rewards).all()


def test_ppo_trains_on_a_batch() -> None:
    """A native vector environment, which its wrapper resets."""

    def make() -> Any:
        return envs.GymWrapper(dl2c.make_vec("example:dubins", 4, autoreset_mode="Disabled"))

    assert torch.isfinite(trained(make, {"obs": "observation"})).all()


def test_ppo_trains_with_masks() -> None:
    """A request that the mask excludes would show among the rewards."""
    config = {"model": "example:thermostat", "masked": True, "blocked_penalty": PENALTY}

    def make() -> Any:
        wrapped = envs.GymWrapper(env_creator(config), categorical_action_encoding=True)
        to_bool = envs.DTypeCastTransform(torch.float32, torch.bool, in_keys=["action_mask"])
        return envs.TransformedEnv(wrapped, to_bool)

    rewards = trained(make, {"obs": "observations", "mask": "action_mask"})
    assert rewards.min() > PENALTY
