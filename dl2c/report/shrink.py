"""Making a counterexample small: fewer steps, simpler numbers, still a violation."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, cast

from dl2c.env.single import Dl2cEnv
from dl2c.native.errors import ResetFailed
from dl2c.report.episode import Episode, Start, play

MOST_TRIES = 4000
"""Episodes that shrinking may run."""

Try = Callable[[Start, Sequence[Any]], bool]
"""Whether a start and actions still violate; what does becomes the smallest known."""


def shrunk(
    env: Dl2cEnv, episode: Episode, violates: Callable[[Episode], int], names: Sequence[str]
) -> Episode:
    """The smallest violation found near `episode`, in an environment of its model and options.

    `violates` gives the step of an episode, counted from 1, that is the violation, 0 for none. `names` are
    what a reset draws: numbers that may be made simpler, within the precondition.
    """
    best, tries = episode, 0

    def attempt(start: Start, actions: Sequence[Any]) -> bool:
        nonlocal best, tries
        if tries >= MOST_TRIES:
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

    while any([_shorter(best, attempt), _later(lambda: best, attempt, names)]) or any(
        [_plainer_actions(lambda: best, attempt), _plainer_state(lambda: best, attempt, names)]
    ):
        pass
    return best


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


def _shorter(episode: Episode, attempt: Try) -> bool:
    """Without some of the actions: halves first, single ones last."""
    actions, better = list(episode.actions), False
    width = len(actions) // 2
    while width:
        at = 0
        while at < len(actions):
            rest = actions[:at] + actions[at + width :]
            if rest and attempt(episode.start, rest):
                actions, better = rest, True
            else:
                at += width
        width //= 2
    return better


def _later(best: Callable[[], Episode], attempt: Try, names: Sequence[str]) -> bool:
    """From a state on the way, if the precondition admits it."""
    episode = best()
    if not names:
        return False
    for k in range(len(episode.moments) - 1, 0, -1):
        start = Start(episode.start.seed, 0, dict(episode.states[k]))
        if attempt(start, episode.actions[k:]):
            return True
    return False


def _plainer_actions(best: Callable[[], Episode], attempt: Try) -> bool:
    """One number of one action after the other, made simpler."""
    better = False
    for k in range(len(best().actions)):
        if k >= len(best().actions):
            break
        for action in _plainer(best().actions[k]):
            actions = list(best().actions)
            actions[k] = action
            if attempt(best().start, actions):
                better = True
                break
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


def _plainer_state(best: Callable[[], Episode], attempt: Try, names: Sequence[str]) -> bool:
    """One number of the initial state after the other, made simpler."""
    better = False
    for name in names:
        start = best().start
        state = dict(best().initial if start.state is None else start.state)
        for value in simpler(state[name]):
            if attempt(replace(start, number=0, state=state | {name: value}), best().actions):
                better = True
                break
    return better


def simpler(number: float) -> Iterator[float]:
    """Numbers that are written with fewer digits, those with the fewest first: 0, 1, then rounded ones, to
    both sides."""
    candidates = [0.0, 1.0, -1.0]
    if number and math.isfinite(number):
        places = math.floor(math.log10(abs(number)))
        for digits in range(1, 7):
            scale = 10.0 ** (digits - 1 - places)
            candidates += [math.floor(number * scale) / scale, math.ceil(number * scale) / scale]
    tried: set[float] = set()
    for candidate in candidates:
        if candidate not in tried and _length(candidate) < _length(number):
            tried.add(candidate)
            yield candidate
