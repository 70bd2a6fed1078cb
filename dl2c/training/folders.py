"""The folder of a training, which is also what a checkpoint is and what a training goes on from.

- `policy.zip` is the learner of Stable-Baselines3, `vecnormalize.pkl` the statistics of VecNormalize;
- `policy.json` and `policy.npz` are the policy as data, which needs neither;
- `model.kyx` is the model's text, and `run.json` says what was asked for, with the learning curve, the
  evaluations and the versions used;
- `replay_buffer.pkl` is SAC's memory, in the last state only;
- `proof.json` and `certificate.json` are what was proved of the policy with `--provable`, `unproved/` is the
  policy before it was taught;
- `best/` is the state that did best in an evaluation, `checkpoints/<steps>/` those saved in between.

Reading zip and pkl files executes code that they contain. Imports torch when called.
"""

import json
import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

from dl2c.env.interface import interface_of
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.inputs import checked_input, read_json
from dl2c.outputs import output_folder
from dl2c.policy.files import write_policy
from dl2c.source import Source
from dl2c.training.evaluation import evaluate
from dl2c.training.hyper import constructor
from dl2c.training.run import (
    ALGORITHMS,
    CERTIFICATE,
    MOST_BYTES,
    PROOF,
    RUN,
    TEXT,
    UNPROVED,
    Checked,
    Estimate,
    Evaluation,
    Given,
    Point,
    Run,
    Settings,
    TrainingError,
)
from dl2c.training.saved import policy_data, scaling_of
from dl2c.version import __version__

POLICY, STATISTICS, BUFFER = "policy.zip", "vecnormalize.pkl", "replay_buffer.pkl"
LIBRARIES = ("numpy", "gymnasium", "torch", "stable-baselines3", "sb3-contrib")


class Training:
    """A training that runs: what was asked for, the learner, and what is known of it so far."""

    def __init__(
        self, source: Source, directory: Path, given: Given, env: Dl2cVecEnv, learner: Any, earlier: Run
    ) -> None:
        self.source, self.directory, self.given = source, directory, given
        self.env, self.learner = env, learner
        self.curve, self.evaluations = list(earlier.curve), list(earlier.evaluations)
        self._before, self._began = earlier.seconds, time.perf_counter()

    def evaluate(self) -> None:
        """Measure the policy as it is; the best so far is kept."""
        given = self.given
        masked, episodes = given.algo == "maskable-ppo", given.settings.eval_episodes
        options = {**given.options, **given.settings.eval_options}
        found = evaluate(self._data().act, self.source, episodes, masked=masked, **options)
        best = max((_rank(e.found) for e in self.evaluations), default=None)
        self.evaluations.append(Checked(self.learner.num_timesteps, found))
        for name in ("success", "violations", "episode_return"):
            self.learner.logger.record(f"evaluation/{name}", getattr(found, name).value)
        if best is None or _rank(found) > best:
            self._write(self.directory / "best", interrupted=False)

    def checkpoint(self) -> None:
        """Save the state as it is."""
        self._write(self.directory / "checkpoints" / str(self.learner.num_timesteps), interrupted=False)

    def finish(self, interrupted: bool) -> Run:
        """Save the last state."""
        return self._write(self.directory, interrupted, last=True)

    def _data(self) -> Any:
        manifest = self.env.manifest
        scaling = scaling_of(self.learner.get_vec_normalize_env())
        scalings = [] if scaling is None else [scaling]
        masked = self.given.algo == "maskable-ppo"
        return policy_data(self.learner, interface_of(manifest), manifest, scalings, masked)

    def _write(self, folder: Path, interrupted: bool, last: bool = False) -> Run:
        seconds = self._before + time.perf_counter() - self._began
        run = Run(folder / POLICY, tuple(self.curve), seconds, tuple(self.evaluations), interrupted)
        content = self.given.content() | {
            "source": self.source.file_name,
            "steps": self.learner.num_timesteps,
            "seconds": seconds,
            "interrupted": interrupted,
            "curve": [asdict(point) for point in self.curve],
            "evaluations": [asdict(checked) for checked in self.evaluations],
            "versions": {"dl2c": __version__} | {name: version(name) for name in LIBRARIES},
        }
        if last:
            _forget_proof(folder)
        with output_folder(folder) as fresh:
            (fresh / TEXT).write_text(self.source.text, encoding="utf-8", errors="surrogateescape")
            self.learner.save(fresh / POLICY)
            self.learner.get_vec_normalize_env().save(str(fresh / STATISTICS))
            if last and self.given.algo == "sac":
                self.learner.save_replay_buffer(fresh / BUFFER)
            write_policy(self._data(), fresh)
            (fresh / RUN).write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return run


def _forget_proof(folder: Path) -> None:
    """Remove what was proved of a policy that is replaced."""
    for name in (PROOF, CERTIFICATE):
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / UNPROVED, ignore_errors=True)


def _rank(found: Evaluation) -> tuple[float, float, float]:
    """Of policies that are equally successful and safe, the one with the larger return is better."""
    return found.success.value, -found.violations.value, found.episode_return.value


# Going on ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Earlier:
    """What `run.json` says of a training."""

    folder: Path
    given: Given
    run: Run


def read_run(folder: Path) -> Earlier:
    """The training of a folder, of its last checkpoint if it was killed.

    Raises `TrainingError`, `OSError`.
    """
    if not (folder / RUN).exists():
        found = (p for p in (folder / "checkpoints").glob(f"*/{RUN}") if p.parent.name.isdecimal())
        kept = sorted(found, key=lambda path: int(path.parent.name))
        if not kept:
            raise TrainingError(f"{folder} holds no training: neither {RUN} nor checkpoints")
        folder = kept[-1].parent
    with checked_input(TrainingError, f"{folder / RUN} is not of `dl2c train`"):
        data = read_json(folder / RUN, MOST_BYTES)
        settings = Settings(**_part(Settings, data["settings"]))
        if data["algo"] not in ALGORITHMS:
            raise ValueError(data["algo"])
        given = Given(data["model"], data["algo"], data["seed"], data["options"], settings)
        curve = tuple(Point(**point) for point in data["curve"])
        evaluations = tuple(_checked(entry) for entry in data["evaluations"])
        run = Run(folder / POLICY, curve, data["seconds"], evaluations, data["interrupted"])
    return Earlier(folder, given, run)


def _part(kind: Any, data: Mapping[str, Any]) -> dict[str, Any]:
    """Of some data what a data type has fields for: an older version wrote less, a newer one more."""
    names = {f.name for f in fields(kind)}
    return {name: value for name, value in data.items() if name in names}


def _checked(entry: Mapping[str, Any]) -> Checked:
    found: dict[str, Any] = dict(entry["found"])
    rates = {name: Estimate(**value) for name, value in found.items() if name != "episodes"}
    return Checked(entry["steps"], Evaluation(found["episodes"], **rates))


def opened(folder: Path, given: Given, env: Dl2cVecEnv) -> tuple[Any, Run]:
    """The learner of a folder, with a random stream of its own. Raises `TrainingError`, `OSError`."""
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    earlier = read_run(folder)
    for name in ("model", "algo", "options"):
        own, wanted = getattr(earlier.given, name), getattr(given, name)
        if own != json.loads(json.dumps(wanted)):
            raise TrainingError(f"{folder} was trained with {name} {own}, not {wanted}")
    for name in ("n_envs", "normalize", "hyper"):
        own, wanted = getattr(earlier.given.settings, name), getattr(given.settings, name)
        if own != wanted:
            raise TrainingError(f"{folder} was trained with {name} {own}, not {wanted}")
    scaled = VecNormalize.load(str(earlier.folder / STATISTICS), VecMonitor(env))
    learner = constructor(given.algo).load(earlier.folder / POLICY, env=scaled, device="cpu")
    learner.set_random_seed((given.seed + learner.num_timesteps) % 2**31)
    if given.algo == "sac":
        if (earlier.folder / BUFFER).exists():
            learner.load_replay_buffer(earlier.folder / BUFFER)
        else:
            learner.learning_starts += learner.num_timesteps
    return learner, earlier.run
