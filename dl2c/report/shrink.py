"""Making a counterexample small: fewer steps, simpler numbers, still a violation."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from itertools import product
from typing import Any, cast

import numpy as np

from dl2c.env.single import Dl2cEnv
from dl2c.native.errors import ResetFailed
from dl2c.report.episode import Episode, Start, play

MOST_TRIES = 4000
"""Episodes that shrinking may run."""

Try = Callable[[Start, Sequence[Any]], bool]
"""Whether a start and actions still violate and are smaller; if so they become the smallest known."""

Best = Callable[[], Episode]
"""The smallest known."""

Limits = Mapping[str, tuple[float, float]]


def shrunk(env: Dl2cEnv, episode: Episode, violates: Callable[[Episode], int], limits: Limits) -> Episode:
    """The smallest violation found near `episode`, in an environment of its model and options.

    `violates` gives the step of an episode, counted from 1, that is the violation, 0 for none. `limits` are
    of the names that a reset draws: their numbers may be made simpler, within limits and precondition.
    """
    best, tries = episode, 0

    def attempt(start: Start, actions: Sequence[Any]) -> bool:
        nonlocal best, tries
        if tries >= MOST_TRIES or not (_within(start.state, limits) and _asks(env, actions)):
            return False
        tries += 1
        try:
            found = play(env, start, actions)
        except (ResetFailed, ValueError):
            return False
        step = violates(found)
        if not step or _size(found, step) >= _size(best, len(best.moments)):
            return False
        best = found if step == len(found.moments) else play(env, start, actions[:step])
        return True

    def smallest() -> Episode:
        return best

    ways = (_later, _shorter, _plainer_actions, _plainer_state)
    better = [True]
    while any(better):
        better = [way(smallest, attempt, limits) for way in ways]
    return best


def _within(state: Mapping[str, float] | None, limits: Limits) -> bool:
    return state is None or all(low <= state[name] <= high for name, (low, high) in limits.items())


def _asks(env: Dl2cEnv, actions: Sequence[Any]) -> bool:
    """Whether actions are in the action space, as they are when it has rounded them."""
    space: Any = env.action_space

    def contained(part: Any, action: Any) -> bool:
        if isinstance(action, dict):
            given = cast("dict[str, Any]", action)
            return all(contained(part[key], given[key]) for key in given)
        return bool(part.contains(np.asarray(action, part.dtype)))

    return all(contained(space, action) for action in actions)


def _size(episode: Episode, steps: int) -> tuple[int, int]:
    """How much there is to read: steps, then characters of numbers."""
    state = episode.start.state
    numbers = list(_numbers([m.action for m in episode.moments[:steps]]))
    numbers += list((episode.initial if state is None else state).values())
    return steps, sum(map(_length, numbers))


def _length(number: float) -> int:
    return len(f"{float(number)!r}".removesuffix(".0").lstrip("-0"))


def _numbers(actions: Any) -> Iterator[float]:
    match actions:
        case dict():
            for part in cast("dict[str, Any]", actions).values():
                yield from _numbers(part)
        case list():
            for part in cast("list[Any]", actions):
                yield from _numbers(part)
        case _:
            yield actions


def _later(best: Best, attempt: Try, limits: Limits) -> bool:
    """From a state on the way, if the precondition admits it."""
    episode = best()
    for k in range(len(episode.moments) - 1, 0, -1) if limits else ():
        state = {name: value if name in limits else 0.0 for name, value in episode.states[k].items()}
        if attempt(Start(episode.start.seed, 0, state), episode.actions[k:]):
            return True
    return False


def _shorter(best: Best, attempt: Try, limits: Limits) -> bool:
    """Without some of the actions: halves first, single ones last."""
    better, width = False, len(best().moments) // 2
    while width:
        at = 0
        while at < len(actions := best().actions):
            rest = actions[:at] + actions[at + width :]
            if rest and attempt(best().start, rest):
                better = True
            else:
                at += width
        width //= 2
    return better


def _plainer_actions(best: Best, attempt: Try, limits: Limits) -> bool:
    """One number of one action after the other, made simpler."""
    better, k = False, 0
    while k < len(actions := best().actions):
        for action in _plainer(actions[k]):
            if attempt(best().start, (*actions[:k], action, *actions[k + 1 :])):
                better = True
                break
        k += 1
    return better


def _plainer(action: Any) -> Iterator[Any]:
    match action:
        case dict():
            given = cast("dict[str, Any]", action)
            for key, part in given.items():
                yield from ({**given, key: simple} for simple in _plainer(part))
        case list():
            items = cast("list[Any]", action)
            for k, part in enumerate(items):
                yield from ([*items[:k], simple, *items[k + 1 :]] for simple in _plainer(part))
        case int():
            yield from range(action)
        case float():
            yield from simpler(action)
        case _:
            raise AssertionError(action)


def _plainer_state(best: Best, attempt: Try, limits: Limits) -> bool:
    """One number of the initial state after the other, made simpler."""
    better = False
    for name in limits:
        episode = best()
        state = dict(episode.initial if episode.start.state is None else episode.start.state)
        for value in simpler(state[name]):
            if attempt(Start(episode.start.seed, 0, state | {name: value}), episode.actions):
                better = True
                break
    return better


def simpler(number: float) -> Iterator[float]:
    """Numbers that are written with fewer digits, those with the fewest first: 0, 1, then rounded ones, to
    both sides."""
    candidates = [0.0, 1.0, -1.0]
    if math.isfinite(number):
        for digits, rounding in product(range(1, 7), (ROUND_FLOOR, ROUND_CEILING)):
            context = Context(prec=digits, rounding=rounding)
            candidates.append(float(context.create_decimal_from_float(number)))
    tried: set[float] = set()
    for candidate in candidates:
        if candidate not in tried and _length(candidate) < _length(number):
            tried.add(candidate)
            yield candidate
