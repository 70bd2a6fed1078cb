"""States of what is assumed in a question about a policy, drawn at random: in them it is taught.

Doubles are good enough here: what is taught is proved afterwards. Equations among what is assumed hold as
nearly as doubles are, and computed values are those of the terms.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.ir.arrays import truths
from dl2c.ir.arrays import values as value_in
from dl2c.ir.logic import conjunction, conjuncts, difference
from dl2c.ir.model import Compare, Formula, Symbol, Term
from dl2c.policy_proof.question import Question

Doubles: TypeAlias = NDArray[np.float64]
Truths: TypeAlias = NDArray[np.bool_]

AT_ENDS = 0.2
"""How often a name of a drawn state is at an end of its bounds, where networks are fitted worst."""

TRIES = 20
"""How often states are drawn, all at once, until there are enough of the hypothesis."""

CORRECTIONS = 8
"""Steps of Newton's method towards the states that satisfy equations among what is assumed."""

DIFFERENCE, SLACK = 1e-6, 1e-9
"""Of these: a share of the bounds, for slopes; and how far sides may be apart, relative to them."""

NEAR = 0.01
"""The surroundings of a box, as a share of all states."""


@dataclass(frozen=True)
class States:
    """Of one question: arrays (n, dimensions)."""

    question: Question
    rng: np.random.Generator

    @cached_property
    def limits(self) -> Doubles:
        """Of states: (dimensions, 2)."""
        ends = [[float(low), float(high)] for low, high in self.question.box]
        return np.array(ends, np.float64).reshape(-1, 2)

    @cached_property
    def equations(self) -> tuple[Compare, ...]:
        return self.question.equations

    @cached_property
    def other_assumptions(self) -> Formula:
        return conjunction(c for c in conjuncts(self.question.hypothesis) if c not in self.equations)

    def drawn(self, count: int) -> Doubles:
        """States of the hypothesis, at most `count`: drawn uniformly, in some dimensions from the ends."""
        low, high = self.limits.T
        found: list[Doubles] = []
        for _ in range(TRIES):
            inside = self.rng.uniform(low, high, (count, len(low)))
            ends = self.limits[np.arange(len(low)), self.rng.integers(0, 2, inside.shape)]
            mixed = np.where(self.rng.random(inside.shape) < AT_ENDS, ends, inside)
            found.append(self.assumed(self.settled(mixed)))
            if sum(map(len, found)) >= count:
                break
        return np.concatenate(found)[:count]

    def around(self, box: Doubles, count: int) -> Doubles:
        """States of the hypothesis in a box (dimensions, 2) and its surroundings."""
        low, high = self.limits.T
        far = NEAR * (high - low)
        first, last = np.maximum(box[:, 0] - far, low), np.minimum(box[:, 1] + far, high)
        return self.assumed(self.settled(self.rng.uniform(first, last, (count, len(low)))))

    def assumed(self, states: Doubles) -> Doubles:
        """Those of the states that the question is about."""
        low, high = self.limits.T
        inside = (states >= low).all(axis=1) & (states <= high).all(axis=1)
        return states[inside & self.is_assumed(states)]

    def is_assumed(self, states: Doubles) -> Truths:
        fine = self.holds(self.other_assumptions, states)
        for equation in self.equations:
            left, right = (self.value(side, states) for side in (equation.left, equation.right))
            fine = fine & (np.abs(left - right) <= SLACK * (1 + np.abs(left) + np.abs(right)))
        return fine

    def settled(self, states: Doubles) -> Doubles:
        """States (n, dimensions) within the limits, moved to where equations hold, in each dimension in
        proportion to its limits; with what is computed of them.
        """
        low, high = self.limits.T
        states = np.clip(states, low, high)
        free = [k for k, s in enumerate(self.question.dimensions) if s not in dict(self.question.computed)]
        widths = (high - low)[free]
        for _ in range(CORRECTIONS if self.equations and free else 0):
            for equation in self.equations:
                margin = difference(equation)
                apart = self.value(margin, states)[:, None]
                slopes = widths * np.stack([self._slope(margin, states, k) for k in free], axis=1)
                size = np.square(slopes).sum(axis=1, keepdims=True)
                states[:, free] -= np.where(size > 0, widths * slopes * apart / np.maximum(size, 1e-300), 0.0)
            states = np.clip(states, low, high)
        for symbol, term in self.question.computed:
            states[:, self.question.dimensions.index(symbol)] = self.value(term, states)
        return states

    def _slope(self, term: Term, states: Doubles, dimension: int) -> Doubles:
        low, high = self.limits[dimension]
        step = DIFFERENCE * (high - low)
        if step == 0:
            return np.zeros(len(states))
        ahead, behind = states.copy(), states.copy()
        ahead[:, dimension] += step
        behind[:, dimension] -= step
        return (self.value(term, ahead) - self.value(term, behind)) / (2 * step)

    def observations(self, states: Doubles) -> Doubles:
        """What the policy observes: (n, nobs)."""
        found = np.empty((len(states), len(self.question.observed)))
        for k, seen in enumerate(self.question.observed):
            if isinstance(seen.value, Symbol):
                values = states[:, self.question.dimensions.index(seen.value)]
            else:
                values = float(seen.value)
            found[:, k] = np.clip(values, seen.low, seen.high)
        return found

    def states_seen(self, observations: Doubles) -> Doubles:
        """The states of observations (n, nobs); none where some name of a state is not observed."""
        places = {s.value: k for k, s in enumerate(self.question.observed)}
        if any(s not in places for s in self.question.dimensions):
            return np.empty((0, len(self.question.dimensions)))
        return self.assumed(self.settled(observations[:, [places[s] for s in self.question.dimensions]]))

    def holds(self, formula: Formula, states: Doubles, values: Doubles | None = None) -> Truths:
        columns = self._columns(states)
        if values is not None:
            columns |= {r.symbol: values[:, k] for k, r in enumerate(self.question.requests)}
        return np.broadcast_to(truths(formula, columns), len(states))

    def value(self, term: Term, states: Doubles) -> Doubles:
        return np.broadcast_to(value_in(term, self._columns(states)), len(states))

    def _columns(self, states: Doubles) -> dict[Symbol, Any]:
        return {s: states[:, k] for k, s in enumerate(self.question.dimensions)}
