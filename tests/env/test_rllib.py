"""RLlib on the waypoint, with the masks inside observations. `make test-ray` runs this: RLlib needs a
Gymnasium of its own choice.
"""

from collections.abc import Iterator
from typing import Any

import pytest

from dl2c.env.masked import env_creator

pytestmark = pytest.mark.slow
ray: Any = pytest.importorskip("ray")
pytest.importorskip("ray.rllib")

PENALTY = -1e6


@pytest.fixture
def one_machine() -> Iterator[None]:
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


@pytest.mark.usefixtures("one_machine")
def test_ppo_learns_with_masks() -> None:
    """Any request that the mask excludes would show in the returns."""
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.rl_module import RLModuleSpec
    from ray.rllib.examples.rl_modules.classes.action_masking_rlm import ActionMaskingTorchRLModule
    from ray.tune.registry import register_env

    register_env("waypoint", env_creator)
    model = {"model": "example:waypoint", "masked": True, "blocked_penalty": PENALTY}
    module = RLModuleSpec(
        module_class=ActionMaskingTorchRLModule, model_config={"head_fcnet_hiddens": [32, 32]}
    )
    algorithm = (
        PPOConfig()
        .environment("waypoint", env_config=model)
        .env_runners(num_env_runners=1, num_envs_per_env_runner=4)
        .rl_module(rl_module_spec=module)
        .training(train_batch_size_per_learner=500, minibatch_size=128, num_epochs=1)
        .build_algo()
    )
    found = algorithm.train()["env_runners"]
    algorithm.stop()
    assert found["num_env_steps_sampled_lifetime"] >= 500
    assert found["num_episodes_lifetime"] > 1
    assert found["episode_return_min"] > PENALTY
