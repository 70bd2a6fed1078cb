"""Policies changed until they are proved: taught, verified, and taught again what the proof lacks.

Each round draws states, asks `lessons` what should be requested in them, and fits the
policy to that. It stays what reinforcement learning found wherever that is admissible with a margin. States
in which the claim is violated, and boxes that the search left open, are drawn too in the rounds that follow.
Imports torch: import it only where training happens.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from dl2c.env.interface import interface_of
from dl2c.env.sb3 import Dl2cVecEnv
from dl2c.outputs import output_folder
from dl2c.policy.files import write_policy
from dl2c.policy.network import NetworkPolicy
from dl2c.policy_proof.question import NotCovered
from dl2c.policy_proof.search import Found
from dl2c.policy_proof.verdict import PolicyReport, percent
from dl2c.training.folders import POLICY
from dl2c.training.lessons import Lesson, Teacher
from dl2c.training.run import CERTIFICATE, PROOF, UNPROVED
from dl2c.training.saved import load_learner, policy_data
from dl2c.training.states import Doubles
from dl2c.training.teaching import Pupil

ROUNDS = 10
MARGINS = (0.002, 0.02)
"""In the first round and in the last, as a share of the bounds."""

MOST_LOST = 0.03
"""Of the reward, as a share of what it was: otherwise a policy that is proved is taught on."""

ENVIRONMENTS, STEPS = 64, 400
"""In which states are met, and for how many steps each."""

DRAWN, GUARDED, SEEN, NEAR = 4000, 12_000, 8000, 100
"""States of each round: drawn from the bounds, tried near guards, met by the policy, and near each that went
wrong."""

AT_GUARDS = 3.0
"""How far from guards states are drawn, in margins."""

TESTED, TESTS = 40_000, 6
"""States that a policy is tested in before it is verified, and how often."""

TEST_MARGIN = 0.25
"""Of these tests, as a share of that of the round."""

MOST_WRONG, MOST_KEPT = 2000, 8000
"""States that went wrong: of one test, and those that are kept."""

FIRST_FIT, MORE_FIT = 2000, 600
"""Steps in each round, and after each test."""

Verify: TypeAlias = Callable[[NetworkPolicy], PolicyReport]
Note: TypeAlias = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Taught:
    """A report, and after how many rounds it came; whether Ctrl-C ended the teaching."""

    report: PolicyReport
    rounds: int
    interrupted: bool = False

    def to_json(self) -> dict[str, Any]:
        """All of it as data."""
        return self.report.to_json() | {"rounds": self.rounds, "interrupted": self.interrupted}


def teach_saved(
    folder: Path, env: Dl2cVecEnv, verify: Verify, note: Note, seed: int, idle: Sequence[str]
) -> Taught:
    """Teach the policy in the folder of a training. Writes it back with the report and the certificate; the
    policy as it was goes to a folder in it.

    Raises what `taught` and reading the folder raise.
    """
    (_, learner), (_, before) = load_learner(folder / POLICY), load_learner(folder / POLICY)
    with output_folder(folder / UNPROVED) as fresh:
        write_policy(_data(learner, env), fresh)
    found = taught(learner, before.policy, env, verify, note, seed, idle)
    (folder / CERTIFICATE).unlink(missing_ok=True)
    with output_folder(folder) as fresh:
        learner.save(fresh / POLICY)
        write_policy(_data(learner, env), fresh)
        (fresh / PROOF).write_text(json.dumps(found.to_json(), indent=1) + "\n", encoding="utf-8")
        if found.report.answer == "proved":
            (fresh / CERTIFICATE).write_text(found.report.certificate, encoding="utf-8")
    return found


def taught(
    learner: Any, before: Any, env: Dl2cVecEnv, verify: Verify, note: Note, seed: int, idle: Sequence[str]
) -> Taught:
    """Change the policy of a learner of PPO until it is proved and earns nearly what it did, or until all
    rounds are done. `before` is a copy of the policy, which stays. It is made to ignore `idle` names, which a
    step overwrites.

    Raises what `verify` raises, and `NotCovered` where there is too much to decide at once.
    """
    rng = np.random.default_rng(seed)
    report = verify(_data(learner, env))
    topics = [Topic(Teacher(question, rng)) for question in report.questions]
    places = tuple(k for k, o in enumerate(env.manifest.observations) if o.name in idle)
    pupil = Pupil(learner.policy, topics[0].teacher, rng, places)
    example = replace(pupil, policy=before)
    seen, first = _seen(learner, env, rng, seed)
    kept, reward, failed = _Kept(Taught(report, 0), learner.policy), first, 0
    try:
        for number in range(ROUNDS + 1):
            if number > 0:
                for topic, found in zip(topics, report.found, strict=False):
                    topic.note(found)
                _round(pupil, example, topics, seen, _margin(failed))
                report = verify(_data(learner, env))
                failed += report.answer != "proved"
                seen, reward = _seen(learner, env, rng, seed)
            note(f"round {number}: {report.answer}, {percent(report.share)} decided, {reward:.3g} a step")
            kept.offer(Taught(report, number), reward, learner.policy)
            if report.interrupted:
                raise KeyboardInterrupt
            if report.answer == "proved" and reward >= first - MOST_LOST * abs(first):
                break
    except KeyboardInterrupt:  # what there is by then is kept
        kept.taught = replace(kept.taught, interrupted=True)
    return kept.restored(learner.policy)


def _margin(failed: int) -> float:
    """After so many rounds without a proof."""
    first, last = MARGINS
    return first * (last / first) ** (failed / (ROUNDS - 1))


@dataclass(slots=True)
class _Kept:
    """Of policies that are proved the one with the largest reward; as long as none is, the last one."""

    taught: Taught
    policy: InitVar[Any]
    reward: float = -np.inf
    state: Any = None

    def __post_init__(self, policy: Any) -> None:
        self.state = _copied(policy)

    def offer(self, taught: Taught, reward: float, policy: Any) -> None:
        before = self.taught.report.answer == "proved"
        if taught.report.answer == "proved":
            if not before or not reward <= self.reward:
                self.taught, self.reward, self.state = taught, reward, _copied(policy)
        elif not before:
            self.taught, self.state = taught, _copied(policy)

    def restored(self, policy: Any) -> Taught:
        """What is known of it, as which the policy then acts."""
        policy.load_state_dict(self.state)
        return self.taught


def _copied(policy: Any) -> dict[str, Any]:
    return {name: values.clone() for name, values in policy.state_dict().items()}


def _data(learner: Any, env: Dl2cVecEnv) -> NetworkPolicy:
    return policy_data(learner, interface_of(env.manifest), env.manifest, [], masked=False)


def _round(pupil: Pupil, before: Pupil, topics: Sequence["Topic"], seen: Doubles, margin: float) -> None:
    """Fit a policy until tests find nothing wrong, or have been done often enough. Raises `NotCovered`."""
    lesson = reduce(Lesson.joined, [t.lesson(t.states(seen, margin), before, margin) for t in topics])
    if not len(lesson.weight):
        raise NotCovered("no admissible request is found by trying, which it could be taught")
    pupil.fit(lesson, FIRST_FIT)
    for _ in range(TESTS):
        refused = [t.test(pupil, margin) for t in topics]
        if not any(map(len, refused)):
            return
        more = [t.lesson(states, before, margin) for t, states in zip(topics, refused, strict=True)]
        lesson = reduce(Lesson.joined, more, lesson)
        pupil.fit(lesson, MORE_FIT)


@dataclass(slots=True)
class Topic:
    """What is taught for one question: `wrong` are states to learn from again."""

    teacher: Teacher
    wrong: Doubles = field(init=False)

    def __post_init__(self) -> None:
        self.wrong = np.empty((0, len(self.teacher.question.dimensions)))

    def note(self, found: Found) -> None:
        """Take note of states near a violation, or in boxes that are open."""
        names = [s.name for s in self.teacher.question.dimensions]
        boxes = [np.array([box[n] for n in names]) for box in found.open_boxes]
        if found.violation is not None:
            point = np.array([float(found.violation.state[n]) for n in names])
            boxes.append(np.stack([point, point], axis=1))
        for box in boxes:
            self._keep(self.teacher.around(box, NEAR))

    def states(self, seen: Doubles, margin: float) -> Doubles:
        """States to learn from."""
        teacher = self.teacher
        own = teacher.drawn(DRAWN), teacher.near_guards(GUARDED, AT_GUARDS * margin)
        return np.concatenate([*own, teacher.states_seen(seen), self.wrong])

    def lesson(self, states: Doubles, before: Pupil, margin: float) -> Lesson:
        """What is wanted in states, of a policy that did what `before` does."""
        return self.teacher.lesson(states, before.outputs(self.teacher.observations(states)), margin)

    def test(self, pupil: Pupil, margin: float) -> Doubles:
        """States in which a policy asks for what is not admissible, some of all that are found."""
        teacher = self.teacher
        states = np.concatenate([teacher.drawn(TESTED), teacher.near_guards(TESTED, AT_GUARDS * margin)])
        outputs = pupil.outputs(teacher.observations(states))
        refused = teacher.refused(states, outputs, TEST_MARGIN * margin)[:MOST_WRONG]
        self._keep(refused)
        return refused

    def _keep(self, states: Doubles) -> None:
        self.wrong = np.concatenate([self.wrong, states])[-MOST_KEPT:]


def _seen(learner: Any, env: Dl2cVecEnv, rng: np.random.Generator, seed: int) -> tuple[Doubles, float]:
    """Observations (n, nobs) that the policy meets, some of all in many episodes, and the mean reward of a
    step.
    """
    env.seed(seed)
    observations = env.reset()
    found: list[Doubles] = []
    rewards: list[float] = []
    for _ in range(STEPS):
        found.append(observations.astype(np.float64))
        actions, _ = learner.predict(observations, deterministic=True)
        env.step_async(actions)
        observations, reward = env.step_wait()[:2]
        rewards.append(float(reward.mean()))
    every = np.concatenate(found)
    return every[rng.choice(len(every), SEEN, replace=False)], float(np.mean(rewards))
