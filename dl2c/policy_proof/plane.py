"""What a search found out about a plane of states: two names of all, the others having one value each.

The plane goes through a state that violates the claim, or through the middle of the states. The leaves of
the tree that it meets cover it. Beside them there are points of a grid in which the policy itself asks for
what is not admissible, as far as doubles tell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dl2c.interval.arithmetic import enclosure
from dl2c.native.boxes import SUSPECT, Bytes, Doubles, Judge
from dl2c.policy.network import PolicyError
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.search import Found, that_count
from dl2c.policy_proof.tables import box_of, tables_of
from dl2c.policy_proof.tree import leaves, splits

POINTS = 200
"""Of the grid, along each axis."""

THREADS = 2

NOT_SEARCHED = Found("unknown", 0, 0, 0.0, 0.0, reason="not searched: another alternative is refuted")
"""Of a question after one that is refuted."""


@dataclass(frozen=True, slots=True)
class Plane:
    """`names` are those of the axes, one or two of them, `limits` (2, 2) their ends; where there is one axis,
    the other one goes from 0 to 1. `values` are those of other names. `leaves` (n, 2, 2) are low and high on
    both axes, and `decided` (n) is what decided them. `refuted` (m, 2) are points of a grid with this
    `spacing` (2); `violation` is a point too.
    """

    names: tuple[str, ...]
    limits: Doubles
    values: Mapping[str, float]
    leaves: Doubles
    decided: Bytes
    refuted: Doubles
    spacing: Doubles
    violation: tuple[float, float] | None


def free_names(question: Question) -> list[str]:
    """The dimensions that a plane may have: those that are not computed of others."""
    computed = {symbol for symbol, _ in question.computed}
    return [s.name for s in question.dimensions if s not in computed]


def axes_named(questions: Sequence[Question], text: str) -> tuple[str, ...]:
    """The names in X,Y, both dimensions of some question; none where the text is empty. Raises `PolicyError`
    also where no question has a dimension.
    """
    known = list(dict.fromkeys(name for q in questions for name in free_names(q)))
    if not known:
        raise PolicyError("there is no picture: every name that matters has one value")
    if not text:
        return ()
    names = tuple(part.strip() for part in text.split(","))
    if len(names) != 2 or not all(names):
        raise PolicyError(f"--over takes two names, X,Y, not {text!r}")
    if names[0] == names[1]:
        raise PolicyError(f"--over names `{names[0]}` twice; it takes two names")
    if wrong := next((n for n in names if n not in known), None):
        raise PolicyError(f"--over: `{wrong}` is not a dimension of the states; these are {', '.join(known)}")
    if not any(_has(q, names) for q in questions):
        raise PolicyError(f"--over: no alternative of the environment has both `{names[0]}` and `{names[1]}`")
    return names


def shown(
    questions: Sequence[Question], found: Sequence[Found], names: Sequence[str]
) -> tuple[Question, Found]:
    """The question to draw, which has the names, and dimensions: the one that is refuted, else the one with
    most boxes. There is one, as `axes_named` makes sure.
    """
    every = [*found, *[NOT_SEARCHED] * (len(questions) - len(found))]
    pairs = [p for p in zip(questions, every, strict=True) if free_names(p[0]) and _has(p[0], names)]
    return max(pairs, key=lambda p: (p[1].answer == "refuted", p[1].boxes))


def _has(question: Question, names: Sequence[str]) -> bool:
    return {*names} <= {*free_names(question)}


def plane_of(question: Question, found: Found, names: Sequence[str] = ()) -> Plane:
    """The plane of two names; of the dimensions that were split most often where none are given."""
    judge, box = Judge(tables_of(question)), box_of(question)
    own = [s.name for s in question.dimensions]
    axes = [own.index(n) for n in names] or _most_split(question, found)
    state = _state(question, judge, box, found)
    free = free_names(question)
    others = {k: float(state[k]) for k in range(len(own)) if k not in axes}
    met = list(leaves(question, found.tree, others))
    boxes, codes = np.concatenate([b for b, _ in met]), np.concatenate([c for _, c in met])
    limits = _flat(box[axes][None])[0]
    spacing = (limits[:, 1] - limits[:, 0]) / (POINTS - 1)
    violation = None
    if found.violation is not None:
        violation = float(state[axes[0]]), float(state[axes[1]]) if len(axes) == 2 else 0.5
    return Plane(
        tuple(own[k] for k in axes),
        limits,
        {own[k]: v for k, v in others.items() if own[k] in free},
        _flat(boxes[:, axes]),
        codes,
        _refuted(question, judge, box, state, axes),
        spacing if len(axes) == 2 else np.array([spacing[0], 1.0]),
        violation,
    )


def _flat(boxes: Doubles) -> Doubles:
    """Boxes (n, axes, 2) with two axes."""
    missing = 2 - boxes.shape[1]
    return np.concatenate([boxes, np.tile([[[0.0, 1.0]]], (len(boxes), missing, 1))], axis=1)


def _most_split(question: Question, found: Found) -> list[int]:
    """The dimensions along which the search split most often; of those that are equal one that counts."""
    counts, matters, free = splits(question, found.tree), that_count(question), free_names(question)
    candidates = [k for k, s in enumerate(question.dimensions) if s.name in free]
    return sorted(candidates, key=lambda k: (-counts[k], not matters[k], k))[:2]


def _state(question: Question, judge: Judge, box: Doubles, found: Found) -> Doubles:
    """The state that the plane goes through."""
    if found.violation is not None:
        state = np.array([float(found.violation.state[s.name]) for s in question.dimensions])
    else:
        middle = judge.middle(box)
        state = box.mean(axis=1) if middle is None else middle
    return np.clip(state, *box.T)


def _refuted(question: Question, judge: Judge, box: Doubles, state: Doubles, axes: Sequence[int]) -> Doubles:
    """Points of the grid that are suspect. What is computed of others is left to the judge."""
    ends = np.array([(enclosure(low).high, enclosure(high).low) for low, high in question.box])[axes]
    grid = np.stack(np.meshgrid(*np.linspace(ends[:, 0], ends[:, 1], POINTS, axis=1), indexing="ij"), axis=-1)
    places = grid.reshape(-1, len(axes))
    points = np.tile(np.stack([state, state], axis=1), (len(places), 1, 1))
    points[:, axes] = places[:, :, None]
    inner = len(box) - len(question.computed)
    points[:, inner:] = box[inner:]
    suspect = points[judge.verdicts(points, THREADS)[0] == SUSPECT][:, axes, 0]
    return suspect if len(axes) == 2 else np.stack([suspect[:, 0], np.full(len(suspect), 0.5)], axis=1)
