"""Looking for violations of a model: the cross-entropy method over initial states and actions.

An attempt is a reset to a state that the precondition admits, a seed for what chance decides, and a plan of
actions: stretches of steps in which the same is asked for. Attempts run together in a vector environment.
What is to be violated may be a conjunction: each conjunct has its own belief about where its violations
are, which is drawn from the attempts that came nearest to one, and gets its share of the next round.
Everything follows from the seed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.env.actions import encoding
from dl2c.env.encodings import Encoding, Named
from dl2c.env.opening import Model as ModelName
from dl2c.env.opening import compilation_of, source_of
from dl2c.env.single import Dl2cEnv
from dl2c.env.vector import Dl2cVectorEnv
from dl2c.ir.arrays import margins
from dl2c.ir.doubles import rounded_down, rounded_up
from dl2c.ir.logic import conjunction, conjuncts
from dl2c.ir.model import Bound, Formula, Model, Symbol
from dl2c.native.errors import ResetFailed
from dl2c.report.episode import Episode, Start, play

Target: TypeAlias = Literal["safety", "failure", "postcondition"]
"""What counts as a violation: a @safety predicate that fails, any episode that ends in failure, or a step
after which the postcondition is false."""

PIECES = 8
"""Different requests in a plan."""

ELITE = 0.1
"""The part of a round that the next one follows."""

INERTIA, FRESH = 0.3, 0.3
"""How much of the last round's belief stays, and which part of a round does not follow it."""

Ints: TypeAlias = NDArray[np.int64]
Floats: TypeAlias = NDArray[np.float64]
Note: TypeAlias = Callable[[int], None]
"""Is told how many episodes have run."""


@dataclass(frozen=True, slots=True)
class Attempts:
    """n attempts. `starts` (n, names) are states, `drawn` (n) where the reset draws one, from the seed;
    `pace` (n) is the steps of a piece; `choices` (n, PIECES, choices) and `inputs` (n, PIECES, inputs) are
    the requests.
    """

    seeds: NDArray[np.uint64]
    starts: Floats
    drawn: NDArray[np.bool_]
    pace: Ints
    choices: Ints
    inputs: Floats

    def at(self, rows: Any) -> "Attempts":
        return Attempts(*(getattr(self, name)[rows] for name in self.__slots__))

    def piece(self, step: int) -> Ints:
        """Which piece of its plan each attempt is in."""
        return np.minimum(step // self.pace, PIECES - 1)


@dataclass(frozen=True, slots=True)
class Belief:
    """Where violations are expected: probabilities of each alternative by choice (PIECES, alternatives),
    mean and deviation of inputs (PIECES, inputs), and the best attempts so far.
    """

    odds: tuple[Floats, ...]
    mean: Floats
    deviation: Floats
    best: Attempts


@dataclass(frozen=True, slots=True)
class Space:
    """What attempts are made of: limits of inputs, how many alternatives each choice has, and names and
    limits of what a reset draws (none where programs run before the loop).
    """

    counts: tuple[int, ...]
    low: Floats
    high: Floats
    names: tuple[str, ...]
    least: Floats
    most: Floats
    dtype: Any
    steps: int


@dataclass(frozen=True, slots=True)
class Search:
    """What was found: the worst of the first violations, if any, after how many episodes."""

    episode: Episode | None
    episodes: int


def options_of(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options under which violations are looked for: actions in the format that a step has anyway."""
    return {**options, "action_format": "auto", "monitor_every_step": False}


def search(
    model: ModelName,
    *,
    target: Target = "safety",
    episodes: int = 10_000,
    steps: int = 200,
    n_envs: int = 250,
    seed: int = 0,
    note: Note = lambda done: None,
    **options: Any,
) -> Search:
    """Look for a violation in so many episodes of at most so many steps.

    Raises what `Dl2cVectorEnv` raises, and `ResetFailed` where no initial state can be drawn.
    """
    source, given = source_of(model), options_of(options)
    drawn = compilation_of(source, given).lowered.drawn
    env = Dl2cVectorEnv(source, n_envs, autoreset_mode="Disabled", **given)
    space = _space(env, drawn, steps)
    rng = np.random.default_rng(seed)
    beliefs: tuple[Belief | None, ...] = (None,)
    done = 0
    while done < episodes:
        shares = [len(part) for part in np.array_split(np.arange(n_envs), len(beliefs))]
        parts = [propose(space, size, b, rng) for size, b in zip(shares, beliefs, strict=True) if size]
        attempts, scores, hits = run(env, drawn, space, joined(parts), target)
        done += n_envs
        note(done)
        if (hits >= 0).any():
            worst = int(np.argmin(np.where(hits >= 0, scores.min(axis=0), np.inf)))
            found = _recorded(env, space, attempts.at([worst]), int(hits[worst]), given)
            env.close()
            return Search(found, done)
        beliefs = _beliefs(space, attempts, scores, beliefs)
    env.close()
    return Search(None, done)


def _beliefs(
    space: Space, attempts: Attempts, scores: Floats, before: tuple[Belief | None, ...]
) -> tuple[Belief | None, ...]:
    """A belief for each conjunct that some attempts come nearer to violating than others."""
    old = before if len(before) == len(scores) else (None,) * len(scores)
    told = [np.ptp(np.clip(row, -1, 1)) > 0 for row in scores]
    return tuple(
        learn(space, attempts, row, b) if t else b for row, t, b in zip(scores, told, old, strict=True)
    )


def _space(env: Dl2cVectorEnv, drawn: Model, steps: int) -> Space:
    manifest = env.manifest
    squash = manifest.options["action_map"] == "squash"
    inputs = [(-1.0, 1.0) if squash else (i.low, i.high) for i in manifest.inputs]
    limits = limits_of(drawn)
    longest = manifest.options["max_episode_steps"] or steps
    low, high = np.array(inputs).reshape(-1, 2).T
    least, most = np.array(list(limits.values())).reshape(-1, 2).T
    counts = tuple(len(c.alternatives) for c in manifest.choices)
    dtype = env.batch.obs.dtype
    return Space(counts, low, high, tuple(limits), least, most, dtype, min(steps, longest))


def joined(parts: Sequence[Attempts]) -> Attempts:
    """All attempts of several."""
    return Attempts(*(np.concatenate([getattr(p, name) for p in parts]) for name in Attempts.__slots__))


def limits_of(drawn: Model) -> dict[str, tuple[float, float]]:
    """Between which doubles each name that a reset draws lies; nothing where programs run before the loop,
    since no state after these can be asked for.
    """
    bounds = {item.name: item.bound for item in (*drawn.variables, *drawn.constants)}

    def limits(bound: Bound) -> tuple[float, float]:
        low = -math.inf if bound.low is None else rounded_up(bound.low)
        return low, math.inf if bound.high is None else rounded_down(bound.high)

    return {} if drawn.prefix else {name: limits(bounds[name]) for name in drawn.sampled}


# One round ----------------------------------------------------------------------


def propose(space: Space, n: int, belief: Belief | None, rng: np.random.Generator) -> Attempts:
    """n attempts where violations are expected, and some anywhere."""
    fresh = np.ones(n, np.bool_) if belief is None else rng.random(n) < FRESH
    parents = np.zeros(n, np.int64) if belief is None else rng.integers(len(belief.best.seeds), size=n)
    longest = int(np.log2(max(2, space.steps // PIECES + 1)))
    seeds = rng.integers(2**64, size=n, dtype=np.uint64)
    pace = 2 ** rng.integers(0, longest + 1, size=n)
    choices = [rng.integers(c, size=(n, PIECES)) for c in space.counts]
    inputs = rng.uniform(space.low, space.high, (n, PIECES, len(space.low)))
    inputs = np.where(rng.random(inputs.shape) < 0.5, inputs, _ends(space.low, space.high, inputs.shape, rng))
    starts = np.zeros((n, len(space.names)))
    if belief is not None:
        followed = [_drawn(odds, n, rng) for odds in belief.odds]
        choices = [np.where(fresh[:, None], c, f) for c, f in zip(choices, followed, strict=True)]
        near = belief.mean + belief.deviation * rng.standard_normal(inputs.shape)
        inputs = np.where(fresh[:, None, None], inputs, np.clip(near, space.low, space.high))
        keeps = ~fresh & (rng.random(n) < 0.7)
        seeds = np.where(keeps, belief.best.seeds[parents], seeds)
        pace = np.where(keeps, belief.best.pace[parents], pace)
        starts = _moved(space, belief.best.starts[parents], belief, rng)
    picked = np.stack(choices, axis=2) if choices else np.zeros((n, PIECES, 0), np.int64)
    return Attempts(seeds, starts, fresh | (not space.names), pace, picked, _representable(space, inputs))


def _representable(space: Space, inputs: Floats) -> Floats:
    """Inputs as an action of the environment holds them, within their limits."""
    return np.clip(inputs.astype(space.dtype).astype(np.float64), space.low, space.high)


def _ends(low: Floats, high: Floats, shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    return np.where(rng.random(shape) < 0.5, low, high)


def _drawn(odds: Floats, n: int, rng: np.random.Generator) -> Ints:
    """Alternatives (n, PIECES) with probabilities (PIECES, alternatives)."""
    levels = odds.cumsum(axis=1)
    found = (rng.random((n, PIECES, 1)) * levels[:, -1:] >= levels).sum(axis=2)
    return np.minimum(found, odds.shape[1] - 1)


def _moved(space: Space, starts: Floats, belief: Belief, rng: np.random.Generator) -> Floats:
    """States near given ones: some names moved by about as much as the best ones differ, or to a limit."""
    width = np.nan_to_num(space.most - space.least, posinf=0.0)
    spread = belief.best.starts.std(axis=0) + 0.02 * width
    moved = starts + spread * rng.standard_normal(starts.shape)
    ends = _ends(space.least, space.most, starts.shape, rng)
    moved = np.where((rng.random(starts.shape) < 0.1) & np.isfinite(ends), ends, moved)
    which = rng.random(starts.shape) < rng.choice([0.0, 0.2, 0.5], size=(len(starts), 1))
    return np.clip(np.where(which, moved, starts), space.least, space.most)


def run(
    env: Dl2cVectorEnv, model: Model, space: Space, attempts: Attempts, target: Target
) -> tuple[Attempts, Floats, Ints]:
    """The attempts with their initial states; scores (conjuncts, n), the least margins of each; and in which
    step it met a violation, -1 for never. The first violation ends the round.
    """
    batch, n, rows = env.batch, env.num_envs, np.arange(env.num_envs)
    parts = conjuncts(objective(model, target))
    safety = [16 + k for k, p in enumerate(model.predicates) if p.category == "safety"]
    attempts = _begin(env, space, attempts)
    running, hits = np.ones(n, np.bool_), np.full(n, -1)
    scores = np.full((len(parts), n), np.inf)
    for step in range(space.steps):
        piece = attempts.piece(step)
        batch.choices[:] = attempts.choices[rows, piece]
        batch.inputs[:] = attempts.inputs[rows, piece]
        batch.step()
        met = running & _violated(batch, target, safety)
        hits[met] = step
        columns = _columns(env, model, np.flatnonzero(running))
        near = np.array([margins(part, columns) + np.zeros(int(running.sum())) for part in parts])
        scores[:, running] = np.minimum(scores[:, running], near)
        running &= ~(batch.terminated | batch.truncated | met)
        if met.any() or not running.any():
            break
    return attempts, scores, hits


def _violated(batch: Any, target: Target, safety: list[int]) -> NDArray[np.bool_]:
    ended = batch.terminated | batch.truncated
    match target:
        case "safety":
            return (batch.cost > 0) | (ended & (batch.status == 2) & np.isin(batch.reason, safety))
        case "failure":
            return ended & (batch.status == 2)
        case "postcondition":
            return ~batch.postcondition


def objective(model: Model, target: Target) -> Formula:
    """What a violation makes false."""
    match target:
        case "safety":
            return conjunction(p.formula for p in model.predicates if p.category == "safety")
        case "failure":
            return conjunction(
                p.formula for p in model.predicates if p.on_failure and p.on_failure.status == "failure"
            )
        case "postcondition":
            return conjunction([] if model.postcondition is None else [model.postcondition])


def _begin(env: Dl2cVectorEnv, space: Space, attempts: Attempts) -> Attempts:
    """Reset everything, to the states that are asked for where the precondition admits them."""
    env.reset(seed=[int(s) for s in attempts.seeds])
    manifest = env.manifest
    names = [q.name for q in (*manifest.variables, *manifest.constants)]
    columns, nx = [names.index(n) for n in space.names], len(manifest.variables)
    starts, drawn = attempts.starts.copy(), attempts.drawn.copy()
    for i, state in enumerate(env.batch.states(range(env.num_envs))):
        if not drawn[i]:
            wanted = state.copy()
            wanted[columns] = starts[i]
            try:
                env.batch.reset_to(i, int(attempts.seeds[i]), wanted[:nx], wanted[nx:])
                continue
            except ResetFailed:
                drawn[i] = True
        starts[i] = state[columns]
    if (again := drawn & ~attempts.drawn).any():
        env.batch.reset(again, attempts.seeds)
    return replace(attempts, starts=starts, drawn=drawn)


def _columns(env: Dl2cVectorEnv, model: Model, rows: Ints) -> dict[Symbol, Floats]:
    """The states of some environments by symbol."""
    states = env.batch.states(rows.tolist()).T
    symbols = [Symbol(v.name, "variable") for v in model.variables]
    symbols += [Symbol(c.name, "constant") for c in model.constants]
    return dict(zip(symbols, states, strict=True))


def learn(space: Space, attempts: Attempts, scores: Floats, before: Belief | None) -> Belief:
    """What the best attempts of a round, and those before, have in common."""
    order = np.argsort(scores, kind="stable")[: max(2, int(ELITE * len(scores)))]
    best = attempts.at(order)
    odds = [
        np.stack([(best.choices[:, :, k] == a).mean(axis=0) for a in range(c)], axis=1) + 0.05 / c
        for k, c in enumerate(space.counts)
    ]
    mean, deviation = best.inputs.mean(axis=0), best.inputs.std(axis=0) + 0.02 * (space.high - space.low)
    if before is not None:
        odds = [INERTIA * old + (1 - INERTIA) * new for old, new in zip(before.odds, odds, strict=True)]
        mean = INERTIA * before.mean + (1 - INERTIA) * mean
        deviation = INERTIA * before.deviation + (1 - INERTIA) * deviation
    return Belief(tuple(odds), mean, deviation, best)


# What was found -----------------------------------------------------------------


def _recorded(env: Dl2cVectorEnv, space: Space, attempt: Attempts, last: int, options: Any) -> Episode:
    """The episode of one attempt up to its violation, in the single environment."""
    single = Dl2cEnv(source_of(env.source), **options)
    start = Start(int(attempt.seeds[0]))
    if not attempt.drawn[0]:
        fixed = {q.name: q.value for q in single.manifest.constants if q.value is not None}
        single.reset(seed=start.seed)
        state = single.state | dict(zip(space.names, attempt.starts[0].tolist(), strict=True)) | fixed
        start = replace(start, state=state)
    code: Encoding = encoding(single.manifest)
    pieces = [int(attempt.piece(step)[0]) for step in range(last + 1)]
    found = play(single, start, [_action(code, attempt, piece) for piece in pieces])
    single.close()
    return found


def _action(code: Encoding, attempt: Attempts, piece: int) -> Any:
    """What the only attempt asks for in a piece, as an action of the single environment."""
    asked: Any = code.executed(attempt.choices[:, piece].astype(np.int32), attempt.inputs[:, piece])
    if isinstance(code, Named):
        return {key: part[0] for key, part in asked.items()}
    return asked[0]
