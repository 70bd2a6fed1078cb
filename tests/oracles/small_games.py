"""Discrete hybrid games: as text, and what every play of a round leads to, by enumeration.

Moves are Python expressions over the state, which dL reads alike. No part of the package is used.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

AGENT, OTHER = "agent", "other"
MOST = 8
"""Iterations of a loop inside a round."""


@dataclass(frozen=True)
class Set:
    name: str
    value: str


@dataclass(frozen=True)
class Test:
    __test__ = False

    formula: str


@dataclass(frozen=True)
class Pick:
    """`a ++ b ++ c`"""

    sides: tuple["Game", ...]


@dataclass(frozen=True)
class Often:
    """`{body}*`"""

    body: "Game"


@dataclass(frozen=True)
class Dual:
    body: "Game"


Game: TypeAlias = Set | Test | Pick | Often | Dual | tuple["Game", ...]

State: TypeAlias = Mapping[str, int]
Moves: TypeAlias = tuple[tuple[str, str, int], ...]
"""Who decided what, and how: in the order in which it was decided."""


@dataclass(frozen=True)
class Play:
    moves: Moves
    state: State

    def by(self, player: str) -> dict[str, int]:
        return {key: k for who, key, k in self.moves if who == player}


def text(game: Game) -> str:
    match game:
        case Set(name, value):
            return f"{name} := {value};"
        case Test(formula):
            return f"?{formula};"
        case Pick(sides):
            return "{" + " ++ ".join(map(text, sides)) + "}"
        case Often(body):
            return "{" + text(body) + "}*"
        case Dual(body):
            return "{" + text(body) + "}^@"
        case tuple():
            return " ".join(map(text, game))


def holds(formula: str, state: State) -> bool:
    return bool(eval(formula, {}, dict(state)))


def plays(game: Game, state: State) -> list[Play]:
    """All plays of a round in which every test is passed. Decisions are numbered as they are written."""
    numbers = dict(_numbered(game, {"choice": 0, "loop": 0}))
    return list(_plays(game, Play((), state), AGENT, numbers))


def _numbered(game: Game, counts: dict[str, int]) -> Iterator[tuple[int, str]]:
    """The key of every decision, by the identity of what is decided."""
    match game:
        case Pick() | Often():
            kind = "choice" if isinstance(game, Pick) else "loop"
            yield id(game), f"{kind}_{counts[kind]}"
            counts[kind] += 1
            for part in game.sides if isinstance(game, Pick) else (game.body,):
                yield from _numbered(part, counts)
        case Dual(body):
            yield from _numbered(body, counts)
        case tuple():
            for part in game:
                yield from _numbered(part, counts)
        case Set() | Test():
            pass


def _plays(game: Game, play: Play, player: str, numbers: Mapping[int, str]) -> Iterator[Play]:
    match game:
        case Set(name, value):
            yield Play(play.moves, {**play.state, name: eval(value, {}, dict(play.state))})
        case Test(formula):
            if holds(formula, play.state):
                yield play
        case Dual(body):
            yield from _plays(body, play, OTHER if player == AGENT else AGENT, numbers)
        case tuple():
            if not game:
                yield play
            else:
                for first in _plays(game[0], play, player, numbers):
                    yield from _plays(game[1:], first, player, numbers)
        case Pick() | Often():
            key = numbers[id(game)]
            outcomes = (
                game.sides if isinstance(game, Pick) else tuple((game.body,) * k for k in range(MOST + 1))
            )
            made = {k: taken for _, k, taken in play.moves}
            for k, outcome in enumerate(outcomes):
                if made.get(key, k) != k:
                    continue
                move = () if key in made else ((player, key, k),)
                yield from _plays(outcome, Play((*play.moves, *move), play.state), player, numbers)
