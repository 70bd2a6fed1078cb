"""Transitions of a controller in doubles, and states around them where checks change their truth.

Rows are the state before, the state after and the parameters. True ones come of executing paths of the
program with random values, many at once. The others are near: on both sides of where a verdict flips, a
few units in the last place or one tolerance away, with values that are zero, whole or those of others.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

import numpy as np
from numpy.typing import NDArray
from oracles.controller_relation import Path, Relation
from oracles.one_unknown import unknowns
from oracles.rigorous_arrays import Bools, Doubles, Near, evaluate, in_doubles, near

from dl2c.ir.model import And, Assign, AssignAny, Bound, Compare, Formula, Model, Sub, Symbol, Test

Truth = Callable[[Doubles], Bools]
Columns = NDArray[np.int64]
TRIES = 40
BATCH = 4000
HALVINGS = 64
STEPS = (0, 0, 1, 1, 2, 3, 8, 40)
"""How many units in the last place."""


@dataclass(slots=True)
class States:
    """Draws rows for a relation, in doubles or floats; of true ones the part `simple` has whole numbers and
    quarters alone.
    """

    model: Model
    relation: Relation
    rng: np.random.Generator
    single: bool = False
    simple: float = 0.3

    @property
    def bounds(self) -> list[Bound]:
        """Of the variables, then of the parameters."""
        declared = {c.name: c.bound for c in self.model.constants}
        return [v.bound for v in self.model.variables] + [declared[c] for c in self.relation.parameters]

    def true(self, count: int) -> Doubles:
        """Transitions, about as many of each path where one is found at all; maybe fewer than `count`."""
        paths = self.relation.paths
        found = [self._of_path(p, -(-count // len(paths))) for p in paths]
        rows = np.concatenate(found)
        more = [self._of_path(p, count - len(rows)) for p, f in zip(paths, found, strict=True) if len(f)]
        rows = np.concatenate([rows, *more]) if len(rows) < count else rows
        return self.rng.permutation(rows)[:count]

    def near(self, rows: Doubles, truth: Truth, tolerance: float) -> Doubles:
        """Rows that are near to the given ones."""
        kinds = self.rng.integers(0, 8, len(rows))
        changed = rows.copy()
        for kind, change in (
            (0, self._copied),
            (1, self._simple),
            (2, partial(self._moved, tolerance=tolerance)),
            (3, self._nudged),
        ):
            changed[kinds == kind] = change(rows[kinds == kind])
        changed[kinds == 4] = self._copied(rows[kinds == 4])
        changed[kinds > 3] = self._bisected(changed[kinds > 3], truth)
        return self.rounded(changed)

    def rounded(self, rows: Doubles) -> Doubles:
        """As the target holds them, inside the bounds of the parameters."""
        n = len(self.relation.variables)
        for k, bound in enumerate(self.bounds[n:], 2 * n):
            low, high = (_inward(end, sign, self.single) for end, sign in _ends(bound))
            rows[:, k] = np.clip(rows[:, k], low, high)
        return rows.astype(np.float32).astype(np.float64) if self.single else rows

    def _of_path(self, path: Path, count: int) -> Doubles:
        found = np.empty((0, len(self.bounds) + len(self.relation.variables)))
        for k in range(TRIES):
            if len(found) >= count or (k == TRIES // 4 and not len(found)):
                break
            found = np.concatenate([found, self._executed(path)])
        return found[:count]

    def _executed(self, path: Path) -> Doubles:
        """What a path makes of random states, where it is possible."""
        n, names = len(self.relation.variables), self.relation.variables
        simple = self.rng.random(BATCH) < self.simple
        drawn = [self._drawn(bound, simple) for bound in self.bounds]
        pool = np.array(drawn)
        env = {Symbol(x, "variable"): Near(drawn[k]) for k, x in enumerate(names)}
        env |= {Symbol(c, "constant"): Near(drawn[n + k]) for k, c in enumerate(self.relation.parameters)}
        env |= {Symbol(c, "constant"): near(v) for c, v in self.relation.fixed.items()}
        bounds = dict(zip(names, self.bounds, strict=False))
        possible, inputs = np.ones(BATCH, np.bool_), dict[str, Symbol]()
        with np.errstate(all="ignore"):
            for statement in path.statements:
                match statement:
                    case Assign(x, term):
                        value = np.broadcast_to(evaluate(term, env).value, (BATCH,))
                        env[Symbol(x, "variable")] = Near(value)
                        possible &= np.isfinite(value)
                    case AssignAny(x, key):
                        if key not in inputs:
                            env[Symbol(key, "input")] = Near(self._input(bounds[x], pool, simple))
                        inputs[key] = Symbol(x, "variable")
                        env[inputs[key]] = env[Symbol(key, "input")]
                    case Test(formula):
                        possible &= self._passed(formula, env, list(inputs.values()))
        after = [env[Symbol(x, "variable")].value for x in names]
        rows = np.array([*drawn[:n], *after, *drawn[n:]]).T
        return self.rounded(rows[possible])

    def _passed(self, formula: Formula, env: dict[Symbol, Near], inputs: list[Symbol]) -> Bools:
        """Where a test passes; an equality that is linear in the value last chosen is solved for it."""
        found = np.ones(BATCH, np.bool_)
        for part in formula.children if isinstance(formula, And) else (formula,):
            used = [x for x in reversed(inputs) if x in unknowns(part)]
            if isinstance(part, Compare) and part.op == "=" and used:
                apart = [
                    evaluate(Sub(part.left, part.right), dict(env) | {used[0]: near(v)}).value for v in (0, 1)
                ]
                value = -apart[0] / (apart[1] - apart[0])
                env[used[0]] = Near(np.broadcast_to(np.where(np.isfinite(value), value, 0), (BATCH,)))
                rest = evaluate(Sub(part.left, part.right), env)
                found &= np.abs(rest.value) <= 1e-12 * (1 + np.abs(apart[0]))
            else:
                found &= in_doubles(part, env, BATCH)
        return found

    def _drawn(self, bound: Bound, simple: Bools) -> Doubles:
        """Random numbers inside a bound: any, ends, whole ones, quarters and zeros among them; where `simple`
        only these, so that doubles compute with them exactly.
        """
        low = -10.0 if bound.low is None else float(bound.low)
        high = max(low, 10.0 if bound.high is None else float(bound.high))
        values = self.rng.uniform(low, high, BATCH)
        kinds = self.rng.integers(0, 12, BATCH)
        values = np.select(
            [kinds == 0, kinds == 1, kinds == 2, kinds == 3, kinds == 4],
            [np.zeros(BATCH), np.round(values), np.round(values * 4) / 4, np.full(BATCH, low), values / 50],
            values,
        )
        scale = np.where(kinds < 9, 1, 4)
        values = np.where(simple, np.round(values * scale) / scale, values)
        return np.clip(values, low, high)

    def _input(self, bound: Bound, pool: Doubles, simple: Bools) -> Doubles:
        """Random values for `x := *`: also those of others, or their opposites, which often limit them."""
        values = self._drawn(bound, simple)
        others = pool[self.rng.integers(0, len(pool), BATCH), np.arange(BATCH)]
        others = others * self.rng.choice([-1.0, 1.0, 0.5], BATCH)
        return np.where(self.rng.random(BATCH) < 0.2, others, values)

    def _together(self, rows: Doubles, columns: Columns, values: Doubles, both: Bools) -> Doubles:
        """Rows with one value each replaced, where `both` in the state after too if it has a copy of it."""
        n, lines = len(self.relation.variables), np.arange(len(rows))
        changed = rows.copy()
        changed[lines, columns] = values
        twins = np.minimum(columns + n, 2 * n - 1)
        same = both & (columns < n) & (rows[lines, twins] == rows[lines, np.minimum(columns, n - 1)])
        changed[lines[same], twins[same]] = values[same]
        return changed

    def _half(self, size: int) -> Bools:
        return self.rng.random(size) < 0.5

    def _columns(self, rows: Doubles) -> Columns:
        return self.rng.integers(0, rows.shape[1], len(rows))

    def _copied(self, rows: Doubles) -> Doubles:
        """One value is zero, whole, or another's."""
        columns, lines = self._columns(rows), np.arange(len(rows))
        kinds, old = self.rng.integers(0, 4, len(rows)), rows[lines, columns]
        others = rows[lines, self._columns(rows)]
        zeros = np.zeros(len(rows))
        new = np.select([kinds == 0, kinds == 1, kinds == 2], [zeros, np.round(old), -others], others)
        return self._together(rows, columns, new, self._half(len(rows)))

    def _simple(self, rows: Doubles) -> Doubles:
        """All values are whole, or quarters."""
        scale = np.where(self._half(len(rows)), 1.0, 4.0)[:, None]
        return np.round(rows * scale) / scale

    def _moved(self, rows: Doubles, tolerance: float) -> Doubles:
        """One value after is about a tolerance away."""
        n, lines = len(self.relation.variables), np.arange(len(rows))
        columns = self.rng.integers(n, 2 * n, len(rows))
        old = rows[lines, columns]
        factors = np.array([0.5, 1, 1, 1, 1, 2]) * (1 + np.array([0, 0, 1e-6, -1e-6, 1e-9, 0]))
        far = tolerance * self.rng.choice(factors, len(rows)) * self.rng.choice([-1, 1], len(rows))
        rows = rows.copy()
        rows[lines, columns] = old + far * (1 + np.where(self._half(len(rows)), np.abs(old), 0))
        return rows

    def _nudged(self, rows: Doubles) -> Doubles:
        """One value is a few units in the last place away."""
        columns, lines = self._columns(rows), np.arange(len(rows))
        values = self._neighbours(rows[lines, columns])
        return self._together(rows, columns, values, self._half(len(rows)))

    def _neighbours(self, values: Doubles) -> Doubles:
        steps = self.rng.choice(STEPS, len(values)) * self.rng.choice([-1, 1], len(values))
        kind = np.float32 if self.single else np.float64
        return values + steps * np.spacing(np.abs(values).astype(kind)).astype(np.float64)

    def _bisected(self, rows: Doubles, truth: Truth) -> Doubles:
        """One value is beside where the truth flips, if it does somewhere near."""
        if not len(rows):
            return rows
        columns, lines = self._columns(rows), np.arange(len(rows))
        low = rows[lines, columns]
        high = low + self.rng.normal(0, 1, len(rows)) * self.rng.choice([0.1, 3, 30], len(rows))
        both = self._half(len(rows))

        def at(values: Doubles) -> Doubles:
            return self._together(rows, columns, values, both)

        before = truth(rows)
        flips = truth(at(high)) != before
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            same = truth(at(middle)) == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        beside = self._neighbours(np.where(self._half(len(rows)), low, high))
        return at(np.where(flips, beside, high))


def _ends(bound: Bound) -> list[tuple[Fraction | None, int]]:
    return [(bound.low, 1), (bound.high, -1)]


def _inward(end: Fraction | None, sign: int, single: bool) -> float:
    """The nearest number of the target that is not beyond an end."""
    if end is None:
        return -sign * np.inf
    kind = np.float32 if single else np.float64
    found = kind(float(end))
    if sign * Fraction(float(found)) < sign * end:
        found = np.nextafter(found, kind(sign * np.inf))
    return float(found)
