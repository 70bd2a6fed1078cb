"""Lyapunov functions of the modes of a switched system: candidates, and numbers about them from samples.

Candidates are what tactics and unused definitions name, the norm itself, and for linear modes quadratic forms
that solve Lyapunov's equation A'*P + P*A = -I, with A shifted so far that they fall as fast as they can.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations_with_replacement
from math import floor, log10
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from dl2c.diagnostics import CompileError
from dl2c.ir.arrays import truths, values
from dl2c.ir.model import Symbol
from dl2c.lower.terms import lower_formula, lower_term
from dl2c.parse import tree
from dl2c.resolve.symbols import free_variables, nodes
from dl2c.verify.arithmetic.polynomials import NotPolynomial, TooLarge
from dl2c.verify.field import Field
from dl2c.verify.stability.claim import Claim
from dl2c.verify.stability.switching import ZERO, Mode
from dl2c.verify.states import Names

DIRECTIONS = 4000
RADII = np.geomspace(0.01, 10.0, 7)
CONSTANTS = 200
"""Values of constants that are drawn, of which those are taken that the theorem assumes."""

MARGIN = 0.9
"""By which estimates are made smaller."""

FLAT = 1.5
"""How much V/N may differ between spheres where both are said to be of one degree."""

DIGITS = 3
"""Of the entries of quadratic forms, of which the largest is about 1."""

SLOWER = (0.1, 0.01)
"""Of how fast a mode can fall at all: by so much less its quadratic form falls."""

NUMBERLESS = (CompileError, NotPolynomial, TooLarge, KeyError, IndexError, ValueError, ArithmeticError)
"""What is raised for functions of which samples say nothing, such as those that are not always defined."""

Numbers: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """Of functions V in modes, by the norm N: least and greatest V, and the least -V' and -V'/V. All have one
    number for each of `RADII`, infinite where no state of that radius is meant.
    """

    norms: Numbers
    least: Numbers
    most: Numbers
    drop: Numbers
    decay: Numbers

    @classmethod
    def of_all(cls, several: Sequence["Estimate"]) -> "Estimate":
        """Of several functions, for the radii of which one of them has states."""
        least = np.min([e.least for e in several], axis=0)
        most = np.max([e.most for e in several], axis=0)
        drop = np.min([e.drop for e in several], axis=0)
        decay = np.min([e.decay for e in several], axis=0)
        known = np.isfinite(least) & np.isfinite(most)
        return cls(several[0].norms[known], least[known], most[known], drop[known], decay[known])

    @property
    def proportional(self) -> bool:
        """Whether V and N are of one degree."""
        return all(max(r) < FLAT * min(r) for r in (self.least / self.norms, self.most / self.norms))

    def within(self, end: int) -> "Estimate":
        """For the first radii."""
        parts = (self.norms, self.least, self.most, self.drop, self.decay)
        return Estimate(*(part[:end] for part in parts))


@dataclass(frozen=True, slots=True)
class Samples:
    """States of a claim, with values of its constants: points on spheres, sphere after sphere."""

    claim: Claim
    names: tuple[str, ...]
    scope: Mapping[str, Symbol]
    columns: Mapping[Symbol, Any]

    @classmethod
    def of(cls, claim: Claim) -> "Samples | None":
        """None where no values of constants are found that the theorem assumes."""
        rng = np.random.default_rng(0)
        names = tuple(sorted(free_variables(claim.norm)))
        systems = [mode.system for mode in claim.system.modes]
        rates = [e.term for s in systems for e in s.equations if isinstance(e, tree.AtomicODE)]
        parts = (*rates, *(s.domain for s in systems), *claim.kept)
        mentioned = {n.name for part in parts for n in nodes(part) if isinstance(n, tree.Variable)}
        moving = {e.name for s in systems for e in s.equations if isinstance(e, tree.AtomicODE)}
        fixed = sorted(mentioned - set(names) - moving)
        scope = {name: Symbol(name, "variable") for name in {*names, *mentioned, *moving}}
        directions = rng.normal(size=(len(names), DIRECTIONS))
        directions /= np.linalg.norm(directions, axis=0)
        points = np.concatenate([r * directions for r in RADII], axis=1)
        columns: dict[Symbol, Any] = {scope[name]: 0.0 for name in moving}
        columns |= dict(zip((scope[name] for name in names), points, strict=True))
        drawn = _constants(claim, {name: scope[name] for name in fixed}, rng)
        if drawn is None:
            return None
        chosen = cast(Any, rng).integers(0, drawn.shape[1], points.shape[1])
        columns |= {scope[name]: row[chosen] for name, row in zip(fixed, drawn, strict=True)}
        return cls(claim, names, scope, columns)

    @property
    def constant(self) -> bool:
        """Whether all that modes depend on is the state."""
        return not any(isinstance(c, np.ndarray) for s, c in self.columns.items() if s.name not in self.names)

    def _field(self, mode: Mode) -> Field:
        equations = [e for e in mode.system.equations if isinstance(e, tree.AtomicODE)]
        rates = {self.scope[e.name]: lower_term(e.term, self.scope) for e in equations}
        return Field(rates, Names(), lambda _: False)

    def estimate(self, function: tree.Term, mode: Mode) -> Estimate:
        """Numbers about a function. Raises `CompileError`, `NotPolynomial`, `TooLarge`, `KeyError`."""
        shape = (len(RADII), DIRECTIONS)
        term = lower_term(function, self.scope)
        norm, value, rate = (
            np.broadcast_to(values(t, self.columns), shape[0] * shape[1]).reshape(shape)
            for t in (lower_term(self.claim.norm, self.scope), term, self._field(mode).derivative(term))
        )
        inside = np.ones(shape, bool)
        for part in (mode.system.domain, *self.claim.kept):
            holds = truths(lower_formula(part, self.scope), self.columns)
            inside &= np.broadcast_to(holds, shape[0] * shape[1]).reshape(shape)
        everywhere = np.ones(shape, bool) if mode.tests else inside
        with np.errstate(all="ignore"):
            fall = np.where(inside, -rate / value, np.inf)
        return Estimate(
            norm.mean(axis=1),
            np.where(everywhere, value, np.inf).min(axis=1),
            np.where(everywhere, value, -np.inf).max(axis=1),
            np.where(inside, -rate, np.inf).min(axis=1),
            np.where(np.isnan(fall), -np.inf, fall).min(axis=1),
        )

    def ratio(self, above: tree.Term, below: tree.Term) -> float:
        """The greatest quotient of two functions."""
        a, b = (values(lower_term(f, self.scope), self.columns) for f in (above, below))
        return float(np.max(a / b))

    def matrix(self, mode: Mode) -> Numbers | None:
        """The matrix of a linear mode."""
        rates = {
            e.name: lower_term(e.term, self.scope)
            for e in mode.system.equations
            if isinstance(e, tree.AtomicODE) and e.name in self.names
        }
        zero = dict.fromkeys(self.names, 0.0)
        if rates.keys() != zero.keys() or not self.constant:
            return None

        def field(point: Mapping[str, Any]) -> Numbers:
            columns = {**self.columns, **{self.scope[n]: v for n, v in point.items()}}
            size = np.size(next(iter(point.values())))
            return np.array([np.broadcast_to(values(rates[n], columns), size) for n in self.names])

        matrix = np.column_stack([field({**zero, n: 1.0}) for n in self.names])
        points = np.array([self.columns[self.scope[n]] for n in self.names])
        linear = np.allclose(field(dict(zip(self.names, points, strict=True))), matrix @ points)
        return matrix if linear else None


def _constants(claim: Claim, scope: Mapping[str, Symbol], rng: np.random.Generator) -> Numbers | None:
    """Values of constants, a row for each, of which all holds that is assumed of them alone."""
    drawn = np.exp(rng.normal(size=(len(scope), CONSTANTS))) * rng.choice([1, 1, -1], (len(scope), CONSTANTS))
    columns = dict(zip(scope.values(), drawn, strict=True))
    kept = np.ones(CONSTANTS, bool)
    for part in claim.assumed:
        if free_variables(part) and free_variables(part) <= scope.keys():
            kept &= np.broadcast_to(truths(lower_formula(part, scope), columns), CONSTANTS)
    return drawn[:, kept] if kept.any() else None


def candidates(samples: Samples, named: Sequence[tuple[tree.Term, ...]]) -> Iterator[tuple[tree.Term, ...]]:
    """Functions for the modes, one for each."""
    modes = samples.claim.system.modes
    known = set(samples.names)
    found: dict[tuple[tree.Term, ...], None] = {}
    for functions in (*named, (samples.claim.norm,)):
        fits = all(free_variables(f) and free_variables(f) <= known for f in functions)
        if fits and len(functions) in (1, len(modes)):
            found.setdefault(functions * len(modes) if len(functions) == 1 else functions)
    with suppress(*NUMBERLESS), np.errstate(all="ignore"):
        found |= dict.fromkeys(_quadratic_forms(samples))
    yield from found


def _quadratic_forms(samples: Samples) -> list[tuple[tree.Term, ...]]:
    """Quadratic forms of linear modes: for each mode its own, and that of one mode for all."""
    modes = samples.claim.system.modes
    matrices = [m for mode in modes if (m := samples.matrix(mode)) is not None]
    if len(matrices) < len(modes):
        return []
    found: dict[tuple[tree.Term, ...], None] = {}
    for slower in SLOWER:
        forms = [quadratic(m, samples.names, slower) for m in matrices]
        found |= dict.fromkeys([tuple(forms), *((f,) * len(modes) for f in forms)])
    return list(found)


def quadratic(matrix: Numbers, names: Sequence[str], slower: float) -> tree.Term:
    """A quadratic form that falls along a linear mode almost as fast as its slowest solution."""
    size = len(names)
    slowest = np.linalg.eigvals(matrix).real.max()
    shifted = matrix - (slowest + slower * max(abs(slowest), 0.1)) * np.eye(size)
    identity = np.eye(size)
    kron, solve = cast(Any, np.kron), cast(Any, np.linalg.solve)
    form = solve(kron(shifted.T, identity) + kron(identity, shifted.T), -identity.ravel()).reshape(size, size)
    form /= abs(form).max()
    result: tree.Term = ZERO
    for (i, a), (j, b) in combinations_with_replacement(enumerate(names), 2):
        entry = Fraction(round(float(form[i, j] * (1 if i == j else 2)), DIGITS)).limit_denominator(
            10**DIGITS
        )
        if entry:
            one, other = tree.Variable(a), tree.Variable(b)
            product = tree.Times(one, other) if a != b else tree.Power(one, tree.Number(Fraction(2)))
            part = product if abs(entry) == 1 else tree.Times(tree.Number(abs(entry)), product)
            sign: Callable[..., tree.Term] = tree.Plus if entry > 0 else tree.Minus
            result = part if result == ZERO else sign(result, part)
    return result


def below(value: float) -> Fraction:
    """A short number that is not above."""
    digits = 10 ** (2 - floor(log10(abs(value)))) if value else 1
    return Fraction(floor(value * digits)) / Fraction(digits)


def above(value: float) -> Fraction:
    """A short number that is not below."""
    return -below(-value)
