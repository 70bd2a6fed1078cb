"""Training with PPO, MaskablePPO and SAC of Stable-Baselines3 on native environments.

Imports torch: import this module only where training happens.
"""

import threading
from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector.utils import batch_space
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from dl2c.env.opening import Model, source_of
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.native.manifest import Manifest
from dl2c.training.activations import Tanh
from dl2c.training.callbacks import Every, Watch
from dl2c.training.folders import Training, opened
from dl2c.training.hyper import complete, constructor
from dl2c.training.run import Algorithm, Given, Progress, Run, Settings, TrainingError
from dl2c.training.standardised import Standardised
from dl2c.training.stopping import stoppable

SAMPLED_STEPS = 200
"""Steps of every environment from which observations are standardised."""

FUNCTIONS = (torch.exp, torch.log, torch.sqrt, torch.tanh)
"""What trainings leave to MKL."""


def train(
    model: Model,
    algo: Algorithm = "ppo",
    *,
    seed: int = 0,
    directory: Path = Path("build/train"),
    settings: Settings | None = None,
    progress: Progress | None = None,
    resume: Path | None = None,
    tensorboard: Path | None = None,
    whole: bool = False,
    **options: Any,
) -> Run:
    """Train a policy and write to `directory` what `dl2c.training.folders` says.

    `options` are those of the environment. With `resume` the training of that folder goes on: `model`,
    `algo`, `seed`, `options` and hyperparameters have to be its own; only what is written counts as
    trained. Ctrl-C ends the training early, without an error: all is written. Where only a `whole` training
    is of use, as a part of something larger, it is a `KeyboardInterrupt` as ever. The same arguments give the
    same policy. Raises what `Dl2cVecEnv` raises, and `TrainingError` for what cannot be trained.
    """
    chosen = complete(algo, settings or Settings())
    if tensorboard is not None and find_spec("tensorboard") is None:
        raise TrainingError("TensorBoard is not installed; `pip install tensorboard`, or leave it out")
    torch.set_num_threads(chosen.threads)
    for function in FUNCTIONS:
        function(torch.ones(1))  # MKL before 2025 loses digits where threads race for the first call of one
    torch.distributions.Distribution.set_default_validate_args(False)
    source = source_of(model)
    env = Dl2cVecEnv(source, chosen.n_envs or 1, num_threads=None, **options)
    check_decisions(algo, env.manifest)
    given = Given(env.manifest.name, algo, seed, env.manifest.options, chosen)
    learner, earlier = _begun(given, env) if resume is None else opened(resume, given, env)
    learner.tensorboard_log = None if tensorboard is None else str(tensorboard)
    training = Training(source, directory, given, env, learner, earlier)
    with nullcontext(threading.Event()) if whole else stoppable() as stopped:
        run = _learned(training, progress, stopped)
    env.close()
    return run


def check_decisions(algo: Algorithm, manifest: Manifest) -> None:
    """Raises `TrainingError` where the decisions of a model are none that the algorithm can learn."""
    inputs = ", ".join(i.key for i in manifest.inputs)
    choices = ", ".join(c.key for c in manifest.choices)
    if algo == "maskable-ppo" and inputs:
        raise TrainingError(
            f"maskable-ppo needs discrete decisions only, but {inputs} is continuous; use ppo or sac"
        )
    if algo == "sac" and (choices or not inputs):
        found = f"{choices} is a choice" if choices else "the model decides nothing"
        raise TrainingError(f"sac needs continuous decisions only, but {found}; use ppo")


def _learned(training: Training, progress: Progress | None, stopped: threading.Event) -> Run:
    """Train until all steps are done or it is stopped; write what there is."""
    given, learner = training.given, training.learner
    steps, done = given.settings.steps or 0, learner.num_timesteps
    if done >= steps:
        raise TrainingError(f"this training has its {steps} steps already; ask for more to go on")
    watch = Watch(training, progress, stopped, 0 if given.algo != "sac" else 1000)
    callbacks: list[BaseCallback] = [watch]
    if given.settings.eval_every:
        callbacks.append(Every(given.settings.eval_every, training.evaluate))
    if given.settings.checkpoint_every:
        callbacks.append(Every(given.settings.checkpoint_every, training.checkpoint))
    learner.learn(steps - done, callback=callbacks, reset_num_timesteps=done == 0, log_interval=1)
    return training.finish(interrupted=stopped.is_set())


def _begun(given: Given, env: Dl2cVecEnv) -> tuple[Any, Run]:
    """A learner that has learned nothing."""
    settings = given.settings
    hyper = dict(settings.hyper)
    layers, activation = hyper.pop("net_arch"), ACTIVATION[hyper.pop("activation")]
    policy: dict[str, Any] = {"net_arch": layers, "activation_fn": activation}
    if given.algo != "sac":
        policy["optimizer_kwargs"] = {"eps": 1e-5, "fused": True}
    if not settings.normalize:
        moments = _moments(env, given.seed)
        policy |= {"features_extractor_class": Standardised, "features_extractor_kwargs": moments}
    schedule = hyper.pop("schedule")
    if schedule != "constant":
        hyper["learning_rate"] = _falling(hyper["learning_rate"])
    if given.algo != "sac":
        hyper["batch_size"] = min(hyper["batch_size"], hyper["n_steps"] * env.num_envs)
    scaled = VecNormalize(VecMonitor(env), norm_obs=settings.normalize, gamma=hyper["gamma"])
    try:
        learner = constructor(given.algo)(
            "MlpPolicy", scaled, policy_kwargs=policy, seed=given.seed, device="cpu", **hyper
        )
    except (AssertionError, ValueError) as problem:
        raise TrainingError(f"{given.algo} refuses these hyperparameters: {problem}") from None
    learner.tapered = schedule == "tapered"
    return learner, Run(Path(), (), 0.0)


ACTIVATION: dict[str, type[torch.nn.Module]] = {
    "tanh": Tanh,
    "relu": torch.nn.ReLU,
    "elu": torch.nn.ELU,
    "sigmoid": torch.nn.Sigmoid,
}


def _moments(env: Dl2cVecEnv, seed: int) -> dict[str, list[float]]:
    """Mean and deviation of each observation entry while a random policy acts, for `Standardised`."""
    space: Any = batch_space(env.encoding.space(), env.num_envs)
    space.seed(seed)
    env.seed(seed)
    seen = [env.reset()]
    for _ in range(SAMPLED_STEPS):
        env.step_async(space.sample())
        seen.append(env.step_wait()[0])
    rows = np.concatenate(seen).astype(np.float64)
    deviation = rows.std(axis=0)
    return {"center": rows.mean(axis=0).tolist(), "scale": np.where(deviation > 0, deviation, 1).tolist()}


def _falling(rate: float) -> Callable[[float], float]:
    """From `rate` down to 0, given the fraction of the training that is left."""
    return lambda left: rate * left
