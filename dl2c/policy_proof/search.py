"""Branch and bound: boxes of states are judged, and those that stay open are split, level after level.

What is judged where does not depend on the number of threads. Boxes that are still open when they are small
are given to `leaves`; suspect ones are judged exactly. The tree of boxes is kept: for every box in the
order of levels the dimension along which it is split at its middle, or what decided it (see `tree`).
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import nextafter
from typing import Literal, TypeAlias

import numpy as np

from dl2c.ir.logic import symbols
from dl2c.native.boxes import NO_SPLIT, OPEN, OUTSIDE, PROVED, SUSPECT, Bytes, Doubles, Judge
from dl2c.policy_proof.exact import Violation, violation
from dl2c.policy_proof.leaves import ask
from dl2c.policy_proof.points import violation_on_equations
from dl2c.policy_proof.question import Question
from dl2c.policy_proof.tables import box_of, tables_of
from dl2c.policy_proof.tree import BY_BOUNDS, BY_SOLVER, LEFT_OPEN, MOST_BOXES, NO_STATE
from dl2c.smt.query import Oracle

Answer: TypeAlias = Literal["proved", "refuted", "unknown"]

CHUNK = 2048
"""Boxes between two looks at the clock."""

MOST_LEVELS = 200

MOST_UNEQUAL = 32.0
"""How much wider than others a box may be in one dimension, as a share of all, before that one is split."""

FIRST_LEAVES, EACH_LEVELS, MOST_LEAVES = 24, 4, 64
"""From which level on, how often and of how many boxes Z3 is asked."""

LEAF_SECONDS, LEAVES_SECONDS = 1.0, 600.0

ON_EQUATIONS = 0.25
"""Of the time, for states in which equations hold."""

NOT_ALL = nextafter(1.0, 0.0)
"""The largest share of a volume of which some is open, which may be too little for the sum to show it."""


@dataclass(slots=True)
class Limits:
    """Of one search. `note` is told how far it is."""

    seconds: float = 60.0
    threads: int = 2
    note: Callable[[str], None] = lambda _: None


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a search is after a level, or where it ends: seconds since it began, boxes judged so far, the
    share of the volume that is decided, and how many boxes are open.
    """

    seconds: float = field(compare=False)
    boxes: int
    decided: float
    open: int


@dataclass(frozen=True, slots=True)
class Before:
    """A search that goes on: the levels that were judged, and after how many seconds each was."""

    tree: tuple[bytes, ...] = ()
    seconds: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Found:
    """`share` of the volume of the box is decided. `open_boxes` are some of those that are not, each low and
    high by name. `by_solver` counts boxes that Z3 decided. `tree` are the levels that are judged; the last
    one, where a violation was found in it, as far as it was judged. `states`: some box may have states of the
    hypothesis. `seconds` are those of this search, `progress` counts from where it began first.
    """

    answer: Answer
    boxes: int
    by_solver: int
    share: float
    seconds: float
    violation: Violation | None = None
    open_boxes: tuple[dict[str, tuple[float, float]], ...] = ()
    tree: tuple[bytes, ...] = ()
    progress: tuple[Progress, ...] = ()
    reason: str = ""
    states: bool = True
    interrupted: bool = False


@dataclass(slots=True)
class _Search:
    question: Question
    judge: Judge
    limits: Limits
    begun: float = field(default_factory=time.monotonic)
    boxes: int = 0
    by_solver: int = 0
    decided: float = 0.0
    tree: list[Bytes] = field(default_factory=list[Bytes])
    progress: list[Progress] = field(default_factory=list[Progress])
    before: Before = Before()
    oracle: Oracle = field(default_factory=lambda: Oracle(LEAF_SECONDS, LEAVES_SECONDS))
    widths: Doubles = field(init=False)
    counts: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.counts = that_count(self.question)

    def run(self) -> Found:
        level = box_of(self.question)[None]
        self.oracle.total = min(LEAVES_SECONDS, self.limits.seconds)
        self.widths = np.maximum(level[0, :, 1] - level[0, :, 0], np.finfo(float).tiny)
        if not self.before.tree:
            found = violation_on_equations(self.question, lambda: self._late(ON_EQUATIONS))
            if found is not None:
                return self._found("refuted", level, found)
        for number in range(MOST_LEVELS):
            self.limits.note(f"{self.decided:.2%} decided, {len(level)} boxes open")
            try:
                codes = self._known(number) if number < len(self.before.tree) else self._next(level, number)
            except KeyboardInterrupt:
                return replace(self._ended("unknown", level, reason="interrupted"), interrupted=True)
            if isinstance(codes, Found):
                return codes
            final = self._keep(level, codes, number)
            if (codes == LEFT_OPEN).any():
                return self._found("unknown", level[codes == LEFT_OPEN], reason="boxes that cannot be split")
            if final.all():
                return self._found("proved", level)
            level = _halves(level[~final], codes[~final])
            if len(level) > MOST_BOXES:
                return self._found("unknown", level, reason=f"after {MOST_BOXES} open boxes")
        return self._found("unknown", level, reason=f"after {MOST_LEVELS} levels")

    def _keep(self, level: Doubles, codes: Bytes, number: int) -> np.ndarray:
        """Keep a level that is judged; which of its boxes are not split."""
        self.tree.append(codes.astype(np.uint8))
        final, left = codes >= BY_SOLVER, codes == LEFT_OPEN
        self.decided += _volume(level[final & ~left], self.widths)
        known = number < len(self.before.tree)
        seconds = self.before.seconds[number] if known else self._seconds()
        share = 1.0 if final.all() and not left.any() else min(self.decided, NOT_ALL)
        undecided = int(left.sum() + 2 * (~final).sum())
        self.progress.append(Progress(seconds, self.boxes, share, undecided))
        return final

    def _seconds(self) -> float:
        """Since the search began, without the time in which it did not go on."""
        earlier = self.before.seconds[-1] if self.before.seconds else 0.0
        return earlier + time.monotonic() - self.begun

    def _known(self, number: int) -> Bytes:
        """A level that was judged before."""
        codes = np.frombuffer(self.before.tree[number], np.uint8)
        self.boxes += len(codes)
        self.by_solver += int((codes == BY_SOLVER).sum())
        return codes

    def _next(self, level: Doubles, number: int) -> Bytes | Found:
        """What decided each box of a level, or along what it is split; what is found if the search ends. A
        level that is not judged to its end is kept only where a violation is found in it.
        """
        late = f"after {self.limits.seconds:.3g} seconds"
        verdicts, splits, found = self._judged(level)
        self.boxes += len(verdicts)
        codes = np.full(len(level), LEFT_OPEN, np.uint8)
        codes[: len(verdicts)] = np.where(
            verdicts == PROVED, BY_BOUNDS, np.where(verdicts == OUTSIDE, NO_STATE, LEFT_OPEN)
        )
        if found is not None:
            return self._refuted(level, codes, found, number)
        if len(verdicts) < len(level):
            return self._ended("unknown", level, reason=late)
        left = np.flatnonzero((verdicts == OPEN) | (verdicts == SUSPECT))
        codes[left] = _balanced(level, splits, self.widths, self.counts)[left]
        if number >= FIRST_LEAVES and number % EACH_LEVELS == 0 and len(left) <= MOST_LEAVES:
            found = self._asked(level, left, codes)
            if found is not None:
                return self._refuted(level, np.where(codes < BY_SOLVER, LEFT_OPEN, codes), found, number)
            if self._late():
                return self._ended("unknown", level, reason=late)
        codes[codes == NO_SPLIT] = LEFT_OPEN
        return codes

    def _refuted(self, level: Doubles, codes: Bytes, found: Violation, number: int) -> Found:
        """The end with a violation: boxes of the level that are not decided stay open."""
        self._keep(level, np.where(codes == NO_SPLIT, LEFT_OPEN, codes), number)
        return self._found("refuted", level, found)

    def _judged(self, level: Doubles) -> tuple[Bytes, Bytes, Violation | None]:
        """Verdicts and dimensions, as far as time goes; the first violation that is confirmed."""
        verdicts: list[Bytes] = []
        splits: list[Bytes] = []
        for first in range(0, len(level), CHUNK):
            if self._late():
                break
            chunk = level[first : first + CHUNK]
            judged, along = self.judge.verdicts(chunk, self.limits.threads)
            verdicts.append(judged)
            splits.append(along)
            for k in np.flatnonzero(judged == SUSPECT)[:4]:
                point = self.judge.middle(chunk[k])
                if point is not None and (found := self._confirmed(point.tolist())) is not None:
                    return np.concatenate(verdicts), np.concatenate(splits), found
        empty = np.empty(0, np.uint8)
        return np.concatenate([empty, *verdicts]), np.concatenate([empty, *splits]), None

    def _confirmed(self, point: list[float]) -> Violation | None:
        state = {s: Fraction(v) for s, v in zip(self.question.dimensions, point, strict=True)}
        return violation(self.question, state)

    def _asked(self, level: Doubles, left: np.ndarray, codes: np.ndarray) -> Violation | None:
        """Let Z3 decide boxes that are open; a violation, if one is confirmed."""
        for k in left:
            if self._late():
                return None
            leaf = ask(self.question, self.judge, level[k], self.oracle)
            if leaf.proved:
                codes[k] = BY_SOLVER
                self.by_solver += 1
            elif leaf.suspect is not None:
                state = {s: leaf.suspect[s.name] for s in self.question.dimensions}
                if (found := violation(self.question, state)) is not None:
                    return found
        return None

    def _late(self, share: float = 1.0) -> bool:
        return time.monotonic() - self.begun > share * self.limits.seconds

    def _ended(self, answer: Answer, level: Doubles, reason: str) -> Found:
        """The end inside a level, all of whose boxes are open."""
        self.progress.append(Progress(self._seconds(), self.boxes, min(self.decided, NOT_ALL), len(level)))
        return self._found(answer, level, reason=reason)

    def _found(
        self, answer: Answer, level: Doubles, violated: Violation | None = None, reason: str = ""
    ) -> Found:
        names = [s.name for s in self.question.dimensions]
        some = level[:5] if answer == "unknown" else level[:0]
        return Found(
            answer,
            self.boxes,
            self.by_solver,
            1.0 if answer == "proved" else min(self.decided, NOT_ALL),
            time.monotonic() - self.begun,
            violated,
            tuple(_by_name(names, box) for box in some),
            tuple(codes.tobytes() for codes in self.tree),
            tuple(self.progress),
            reason,
            any(np.isin(codes, (BY_SOLVER, BY_BOUNDS)).any() for codes in self.tree),
        )


def search(question: Question, limits: Limits, before: Before | None = None) -> Found:
    """Look for a proof and for a violation; go on after the levels that were judged `before`.

    Raises `NotCovered`, `NativeError`.
    """
    return _Search(question, Judge(tables_of(question)), limits, before=before or Before()).run()


def _by_name(names: Sequence[str], box: Doubles) -> dict[str, tuple[float, float]]:
    return {n: (float(low), float(high)) for n, (low, high) in zip(names, box, strict=True)}


def _volume(boxes: Doubles, widths: Doubles) -> float:
    """The volume of boxes (n, dimensions, 2), as a share."""
    shares = np.where(widths > np.finfo(float).tiny, (boxes[:, :, 1] - boxes[:, :, 0]) / widths, 1.0)
    return float(np.prod(shares, axis=1).sum())


def _balanced(boxes: Doubles, splits: Bytes, widths: Doubles, counts: np.ndarray) -> Bytes:
    """The dimensions along which boxes are split: of those that count the widest, instead of one that is much
    narrower.
    """
    if not counts.any():
        return splits
    shares = (boxes[:, :, 1] - boxes[:, :, 0]) / widths
    shares[:, (widths <= np.finfo(float).tiny) | ~counts] = 0.0
    widest = shares.argmax(axis=1)
    rows = np.arange(len(boxes))
    chosen = shares[rows, np.minimum(splits, len(widths) - 1)]
    unequal = (splits != NO_SPLIT) & (shares[rows, widest] > MOST_UNEQUAL * chosen)
    return np.where(unequal, widest, splits).astype(np.uint8)


def that_count(question: Question) -> np.ndarray:
    """Which dimensions the network or a condition depends on, but for those that are computed of others."""
    weights = question.layers[0].weight
    seen = {o.value for k, o in enumerate(question.observed) if weights[:, k].any()}
    used = seen | symbols(question.hypothesis, *(c.conclusion for c in question.cases))
    used -= {symbol for symbol, _ in question.computed}
    return np.array([s in used for s in question.dimensions], np.bool_)


def _halves(boxes: Doubles, along: np.ndarray) -> Doubles:
    """Both halves of each box, one after the other: split at the middle of a dimension."""
    rows = np.arange(len(boxes))
    low, high = boxes[rows, along, 0], boxes[rows, along, 1]
    middle = low + 0.5 * (high - low)
    first, second = boxes.copy(), boxes.copy()
    first[rows, along, 1] = middle
    second[rows, along, 0] = middle
    return np.stack([first, second], axis=1).reshape(-1, *boxes.shape[1:])
