"""What a policy should ask for to be proved: in given states the requests that are admissible with a margin.

In: a question, and states (n, dimensions). Out: for each state what is wanted there, and how far from that a
policy may be. Doubles are good enough here: what is taught is proved afterwards.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, reduce
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.model import Symbol
from dl2c.policy_proof.question import NotCovered, Premise
from dl2c.training.states import TRIES, Doubles, States, Truths

MOST_CANDIDATES = 400
VALUES, MORE_VALUES = (1, 41, 15, 7, 4), (1, 400, 20, 7, 4)
"""Values of each request that are tried, by how many requests there are: everywhere, and where none of these
is admissible.
"""

ENOUGH = 1000
"""States that are drawn to see whether there are any."""

BISECTIONS = 12
"""Steps from two states of which one admits a request to where it becomes admissible."""

NEIGHBOURS = 8
"""States around each in which a request should be admissible, too."""

BEYOND = 0.02
"""How far beyond a limit a request should be that has to be clipped to it, as a share of the limits."""

GUARD, AT_GUARD = 4.0, 0.2
"""In margins: how near to a guard less counts what is wanted, and how much less."""

ROUNDED = 0.3
"""How far from a choice an output may be that is rounded to it."""


@dataclass(frozen=True, slots=True)
class Lesson:
    """What is wanted for `observations` (n, nobs).

    Of requests: intervals (n, m, 2) in which outputs are what is wanted, and in which they are admissible
    with a margin. Of choices: the case that is wanted (n), and which cases are admissible with a margin
    (n, cases). `weight` (n) is how much it counts that the outputs are what is wanted.
    """

    observations: Doubles
    wanted: NDArray[Any]
    fine: NDArray[Any]
    weight: Doubles

    def joined(self, other: "Lesson") -> "Lesson":
        """Both."""
        pairs = [(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)]
        return Lesson(*map(np.concatenate, pairs))

    def of(self, rows: Truths) -> "Lesson":
        """What it says of some of its states."""
        return Lesson(*(getattr(self, f.name)[rows] for f in fields(self)))


@dataclass(frozen=True)
class Teacher(States):
    """Of one question. A margin is a share: of its box, around a state, where the same request must be
    admissible, and of the limits of a request.
    """

    @cached_property
    def winners(self) -> NDArray[np.int64]:
        """Of each case the outputs that are largest: (cases, groups)."""
        cases = self.question.cases
        if len(cases) > MOST_CANDIDATES:
            raise NotCovered(f"it decides between {len(cases)} cases, too many to be taught")
        found = [list(dict.fromkeys(first for first, _ in case.largest)) for case in cases]
        return np.array(found, np.int64).reshape(len(found), -1)

    @cached_property
    def axes(self) -> tuple[Doubles, ...]:
        """Values of each request that are tried. Raises `NotCovered`."""
        if not (axes := self._axes(VALUES)):
            raise NotCovered("it decides too many numbers at once to be taught")
        return axes

    @cached_property
    def more_axes(self) -> tuple[Doubles, ...]:
        """More values; none where these are too many, or not more."""
        found = self._axes(MORE_VALUES)
        return found if sum(map(len, found)) > sum(map(len, self.axes)) else ()

    def _axes(self, values: Sequence[int]) -> tuple[Doubles, ...]:
        """None where they are too many."""
        requests = self.question.requests
        count = values[min(len(requests), len(values) - 1)]
        axes = tuple(_axis(float(r.low), float(r.high), r.symbol, count) for r in requests)
        return axes if np.prod([len(a) for a in axes]) <= MOST_CANDIDATES else ()

    @cached_property
    def ends(self) -> Doubles:
        """Of requests: lower and upper limits (2, m)."""
        return np.array([[float(r.low), float(r.high)] for r in self.question.requests]).reshape(-1, 2).T

    @cached_property
    def rounded(self) -> Truths:
        """Which requests are choices."""
        return np.array([_is_choice(r.symbol) for r in self.question.requests], np.bool_)

    def finds_states(self) -> bool:
        """Whether states of the hypothesis are found by drawing. Raises `NotCovered` where there is too much
        to decide at once.
        """
        _ = self.axes if self.question.requests else self.winners
        return len(self.drawn(ENOUGH)) > 0

    # States ------------------------------------------------------------------------------------------

    def near_guards(self, count: int, margin: float) -> Doubles:
        """States of the hypothesis, at most `count`, close to where some request becomes admissible."""
        found: list[Doubles] = []
        for _ in range(TRIES):
            found.append(self._between(self.drawn(count), self.drawn(count), margin))
            if sum(map(len, found)) >= count:
                break
        return np.concatenate(found)[:count]

    def _between(self, first: Doubles, last: Doubles, margin: float) -> Doubles:
        """States near which some request becomes admissible, between states of which one admits it."""
        number = min(len(first), len(last))
        first, last = first[:number], last[:number]
        fine = self._some_request(number)
        before, after = fine(first), fine(last)
        for _ in range(BISECTIONS):
            middle = self.settled(0.5 * (first + last))
            same = (fine(middle) == before)[:, None]
            first, last = np.where(same, middle, first), np.where(same, last, middle)
        low, high = self.limits.T
        far = margin * (high - low) * self.rng.uniform(-1.0, 1.0, first.shape)
        return self.assumed(self.settled(first + far)[before != after])

    def _some_request(self, count: int) -> Callable[[Doubles], Truths]:
        """Whether in each of so many states a request is admissible, one that is drawn for it now."""
        if not self.question.requests:
            case = self.rng.integers(0, len(self.question.cases), count)
            return lambda states: self._choices(states)[np.arange(count), case]
        values = np.stack([self.rng.choice(axis, count) for axis in self.axes], axis=1)
        return lambda states: self.admissible(states, values)

    def refused(self, states: Doubles, outputs: Doubles, margin: float) -> Doubles:
        """Those of the states in which, or near which, what a network with `outputs` (n, k) asks for is not
        admissible.
        """
        around = self._around(states, margin)
        if self.question.requests:
            own = self._clipped(outputs)
            fine = [self.admissible(x, own) for x in around]
        else:
            rows = np.arange(len(states)), self._preferences(outputs).argmax(axis=1)
            fine = [self._choices(x)[rows] for x in around]
        return states[~reduce(np.logical_and, fine)]

    # Lessons -----------------------------------------------------------------------------------------

    def lesson(self, states: Doubles, outputs: Doubles, margin: float) -> Lesson:
        """What is wanted in states, as near as possible to a policy that gives `outputs` (n, k) there.
        Nothing is said of states in which no request that is tried is admissible.
        """
        around, wide = self._around(states, margin), [*self._moved(states, GUARD * margin)]
        if self.question.requests:
            own = self._clipped(outputs)
            found = self._requests(around, own, margin, self.axes)
            rest = ~found[-1]
            if rest.any() and self.more_axes:
                more = self._requests([x[rest] for x in around], own[rest], margin, self.more_axes)
                for all_of_it, part in zip(found, more, strict=True):
                    all_of_it[rest] = part
            wanted, fine, asked, known = found
            clear = [self.admissible(x, asked) for x in wide]
        else:
            counts = np.sum([self._choices(x) for x in around], axis=0)
            fine, known = _most(counts), counts.max(axis=1) > 0
            wanted = np.where(fine, self._preferences(outputs), -np.inf).argmax(axis=1)
            clear = [self._choices(x)[np.arange(len(x)), wanted] for x in wide]
        weight = np.where(reduce(np.logical_and, clear), 1.0, AT_GUARD)
        return Lesson(self.observations(states), wanted, fine, weight).of(known)

    def admissible(self, states: Doubles, values: Doubles) -> Truths:
        """Whether requests (n, m) are admissible in states (n, dimensions)."""
        fine = np.zeros(len(states), np.bool_)
        for case in self.question.cases:
            taken = reduce(np.logical_and, (_met(p, values[:, p.request]) for p in case.premises))
            if taken.any():
                fine[taken] = self.holds(case.conclusion, states[taken], values[taken])
        return fine

    def _requests(
        self, around: list[Doubles], own: Doubles, margin: float, axes: Sequence[Doubles]
    ) -> tuple[Doubles, Doubles, Doubles, Truths]:
        """For requests `own` (n, m) what outputs are wanted and fine, and the requests (n, m) that are
        wanted: of values on these axes the nearest that are admissible in most states around; and whether (n)
        there are any.
        """
        candidates = np.array(list(product(*axes)), np.float64)
        counts = np.stack([self._count(around, values) for values in candidates], axis=1)
        fine = _most(counts)
        low, high = self.ends
        size = np.maximum(high - low, 1e-12)
        far = np.abs((own[:, None, :] - candidates) / size).sum(axis=2)
        nearest = np.where(fine, far, np.inf).argmin(axis=1)
        inner = np.stack(
            [self._interval(k, axes, fine, nearest, margin * size[k]) for k in range(len(size))], axis=1
        )
        near = np.clip(own, inner[..., 0], inner[..., 1])
        ends = np.where(near <= low, -np.inf, near), np.where(near >= high, np.inf, near)
        return np.stack(ends, axis=2), inner, np.clip(near, low, high), counts.max(axis=1) > 0

    def _count(self, around: list[Doubles], values: Doubles) -> NDArray[np.int64]:
        """In how many of the states around each a request (m) is admissible."""
        together = np.concatenate(around)
        fine = self.admissible(together, np.broadcast_to(values, (len(together), len(values))))
        return fine.reshape(len(around), -1).sum(axis=0)

    def _interval(
        self, k: int, axes: Sequence[Doubles], fine: Truths, nearest: NDArray[np.int64], inside: float
    ) -> Doubles:
        """Outputs k (n, 2) around the nearest candidates, moved inwards, the others as they are."""
        axis, step = axes[k], int(np.prod([len(a) for a in axes[k + 1 :]]))
        count = np.arange(len(axis))
        place = nearest // step % len(axis)
        lines = (nearest - place * step)[:, None] + step * count
        bad = ~np.take_along_axis(fine, lines, axis=1)
        first = np.where(bad & (count < place[:, None]), count + 1, 0).max(axis=1)
        last = np.where(bad & (count > place[:, None]), count - 1, len(axis) - 1).min(axis=1)
        low, high = axis[first], axis[last]
        move = np.full(len(low), -ROUNDED) if self.rounded[k] else np.minimum(inside, (high - low) / 3)
        alone, beyond = first == last, BEYOND * (axis[-1] - axis[0])
        at_low, at_high = first == 0, last == len(axis) - 1
        edge = np.where(alone & at_high & ~self.rounded[k], high + beyond, low + move)
        other = np.where(alone & at_low & ~self.rounded[k], low - beyond, high - move)
        return np.stack([np.where(at_low, -np.inf, edge), np.where(at_high, np.inf, other)], axis=1)

    def _preferences(self, outputs: Doubles) -> Doubles:
        """How much a network prefers each case: (n, cases)."""
        return outputs[:, self.winners].sum(axis=2)

    def _clipped(self, outputs: Doubles) -> Doubles:
        """Outputs (n, m) as requests."""
        own = np.clip(outputs, *self.ends)
        own[:, self.rounded] = np.round(own[:, self.rounded])
        return own

    def _around(self, states: Doubles, margin: float) -> list[Doubles]:
        """These states, and states near them, or these again where what is near is none."""
        return [states, *self._moved(states, margin)]

    def _moved(self, states: Doubles, margin: float) -> Iterator[Doubles]:
        low, high = self.limits.T
        for _ in range(NEIGHBOURS):
            step = margin * (high - low) * self.rng.choice((-1.0, 1.0), states.shape)
            near = self.settled(states + step)
            yield np.where(self.is_assumed(near)[:, None], near, states)

    def _choices(self, states: Doubles) -> Truths:
        """Which cases are admissible: (n, cases)."""
        return np.stack([self.holds(c.conclusion, states) for c in self.question.cases], axis=1)


def _most(scores: NDArray[np.int64]) -> Truths:
    """Which columns have the largest score of their row."""
    return scores == scores.max(axis=1, keepdims=True)


def _is_choice(symbol: Symbol) -> bool:
    return symbol.name.startswith("request choice ")


def _axis(low: float, high: float, symbol: Symbol, count: int) -> Doubles:
    return np.arange(low, high + 1) if _is_choice(symbol) else np.linspace(low, high, count)


def _met(premise: Premise, values: Doubles) -> Truths:
    """Whether requests are as a premise says."""
    low = -np.inf if premise.low is None else float(premise.low)
    high = np.inf if premise.high is None else float(premise.high)
    return (values > low) & (values < high) if premise.inside else (values >= low) & (values <= high)
