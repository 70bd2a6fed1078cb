"""From a model to a small counterexample: search, then shrink."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from dl2c.diagnostics import Diagnostic
from dl2c.env.opening import Model, compilation_of, open_library, source_of
from dl2c.env.single import Dl2cEnv
from dl2c.ir.model import TRUE
from dl2c.report.blame import blamed, model_of
from dl2c.report.episode import Episode, replay
from dl2c.report.search import Note, Target, limits_of, objective, options_of, search
from dl2c.report.shrink import shrunk


class NothingToFalsify(Exception):
    """The model has no condition of the kind that is to be violated, or no initial states to search."""


@dataclass(frozen=True, slots=True)
class Falsified:
    """What a search found: a counterexample and the conditions it violates, or None and no conditions; in
    how many episodes. Before it was made smaller it had `steps`, and failed by as much as `worst` says at the
    end of its last step, which a violation otherwise ends at once.
    """

    episode: Episode | None
    conditions: tuple[Diagnostic, ...]
    episodes: int
    steps: int = 0
    worst: tuple[Diagnostic, ...] = ()


def falsify(
    model: Model,
    *,
    target: Target = "safety",
    episodes: int = 10_000,
    steps: int = 200,
    n_envs: int = 250,
    seed: int = 0,
    note: Note = lambda done: None,
    **options: Any,
) -> Falsified:
    """Look for a violation in about so many episodes of at most so many steps, and make it small.

    The same arguments give the same result. Raises `NothingToFalsify`, and what `Dl2cVectorEnv` raises.
    """
    source, given = source_of(model), options_of(options)
    drawn = compilation_of(source, given).lowered.drawn
    if objective(drawn, target) == TRUE:
        raise NothingToFalsify(f"{drawn.name} has no condition that `{target}` is about")
    if open_library(source, given).manifest.certificate == "none":
        raise NothingToFalsify(f"initial states of {drawn.name} cannot be drawn: `dl2c check` says why")
    found = search(
        source,
        target=target,
        episodes=episodes,
        steps=steps,
        n_envs=min(n_envs, episodes),
        seed=seed,
        note=note,
        **given,
    )
    if found.episode is None:
        return Falsified(None, (), found.episodes)
    small = _shrunk(found.episode, target, limits_of(drawn))
    conditions = blamed(small, model_of(small))
    return Falsified(small, conditions, found.episodes, len(found.episode.moments), _worst(found.episode))


def _worst(episode: Episode) -> tuple[Diagnostic, ...]:
    """What fails where the steps of the episode are not ended by a violation, or else where they are."""
    whole = replay(replace(episode, options={**episode.options, "safety_check": "step"}))
    return blamed(whole, model_of(whole)) or blamed(episode, model_of(episode))


def _shrunk(episode: Episode, target: Target, limits: Mapping[str, tuple[float, float]]) -> Episode:
    env = Dl2cEnv(episode.source, **episode.options)
    safety = [p.name for p in env.manifest.predicates if p.category == "safety"]
    try:
        return shrunk(env, episode, lambda e: violation(e, target, safety), limits)
    finally:
        env.close()


def violation(episode: Episode, target: Target, safety: Sequence[str]) -> int:
    """The first step, counted from 1, that violates; 0 for none. `safety` names the @safety predicates."""
    last = len(episode.moments)
    match target:
        case "failure":
            return last if episode.status == "failure" else 0
        case "postcondition":
            return next((k for k, m in enumerate(episode.moments, 1) if not m.postcondition), 0)
        case "safety":
            ended = last if episode.status == "failure" and episode.reason in safety else 0
            return next((k for k, m in enumerate(episode.moments, 1) if m.cost > 0), ended)
