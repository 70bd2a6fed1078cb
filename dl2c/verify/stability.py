"""Guesses for theorems about the stability of switched systems: witnesses and invariants.

Such a theorem says of a norm N of the state: for every e > 0 there is d > 0 such that from N < d^2 every run
of a loop keeps N < e^2 (stability), or that there is a time T after which N < e^2 holds (attractivity). With
Lyapunov functions V, one for each differential equation of the loop or one for all, for which
L*N <= V <= U*N and V' <= -c*V,

- stability has the witness d = r*e with r^2 <= L/U, and the invariant V < L*e^2;
- attractivity has the witness T = U*d^2 / (c*L*e^2), and the invariant V*(1 + c*t) < U*d^2.

The numbers are estimated from samples. Nothing here proves anything: guesses are proved like any other.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import floor, sqrt
from typing import Any, TypeAlias

import numpy as np

from dl2c.diagnostics import CompileError
from dl2c.ir.arrays import truths, values
from dl2c.ir.model import Symbol
from dl2c.lower.terms import lower_formula, lower_term
from dl2c.parse import tree
from dl2c.resolve.symbols import free_variables, nodes
from dl2c.source import Span
from dl2c.verify.arithmetic.polynomials import NotPolynomial, TooLarge
from dl2c.verify.field import Field
from dl2c.verify.states import Names, has_program
from dl2c.verify.theorem import Theorem

SAMPLES = 2000
RADII = (0.01, 0.1, 1.0, 10.0)
MARGIN = 0.9
"""By which estimates are made smaller."""

Guess: TypeAlias = Mapping[Span, tuple[tree.Formula, ...]]
"""Invariants of loops and differential equations, and an equation for each existential quantifier, by their
places.
"""


@dataclass(frozen=True, slots=True)
class Stability:
    """That a loop started with norm < inner^2 keeps norm < outer^2; with a `clock`, once that has reached the
    witness. `modes` are its differential equations; without a loop the only one.
    """

    witness: tree.Exists
    norm: tree.Term
    inner: tree.Term
    outer: tree.Term
    loop: tree.Loop | tree.ODESystem
    modes: tuple[tree.ODESystem, ...]
    clock: str | None


def guesses(theorem: Theorem) -> Iterator[Guess]:
    """Witnesses and invariants that may prove a theorem about stability; none for other theorems."""
    shape = _shape(theorem.formula)
    if shape is None:
        return
    names = sorted(free_variables(shape.norm))
    for functions in (*theorem.hints.functions, (shape.norm,)):
        known = all(free_variables(f) and free_variables(f) <= set(names) for f in functions)
        if not known or len(functions) not in (1, len(shape.modes)):
            continue
        each = functions if len(functions) > 1 else functions * len(shape.modes)
        try:
            rates = _estimated(shape, each, names)
        except (CompileError, NotPolynomial, TooLarge, KeyError):
            continue
        if rates is not None:
            yield _guess(shape, each, *rates)


def _shape(formula: tree.Formula) -> Stability | None:
    """The claim of a theorem, if it is about stability."""
    witness: tree.Exists | None = None
    assumed: tree.Formula | None = None
    while not isinstance(formula, tree.Box):
        match formula:
            case tree.Forall(_, child):
                formula = child
            case tree.Exists(_, child) if witness is None:
                witness, formula = formula, child
            case tree.Imply(assumed, right):
                formula = right
            case tree.And(left, right) if not has_program(left):
                formula = right
            case _:
                return None
    match assumed, formula.child:
        case (
            tree.Compare("<", norm, inner),
            tree.Compare("<", again, outer) | tree.Imply(_, tree.Compare("<", again, outer)),
        ) if norm == again and witness is not None:
            return _with_loop(formula, witness, norm, inner, outer)
        case _:
            return None


def _with_loop(
    box: tree.Box, witness: tree.Exists, norm: tree.Term, inner: tree.Term, outer: tree.Term
) -> Stability | None:
    loops = [n for n in nodes(box.program) if isinstance(n, tree.Loop)]
    modes = tuple(n for n in nodes(box.program) if isinstance(n, tree.ODESystem))
    bases = _root(inner), _root(outer)
    if len(loops or modes) != 1 or bases[0] is None or bases[1] is None:
        return None
    match box.child:
        case tree.Imply(tree.Compare(">=", tree.Variable(clock), tree.Variable(limit)), _):
            if limit != witness.variable:
                return None
        case _:
            clock = None
            if bases[0] != tree.Variable(witness.variable):
                return None
    return Stability(witness, norm, bases[0], bases[1], (*loops, *modes)[0], modes, clock)


def _root(term: tree.Term) -> tree.Term | None:
    """The base of a square."""
    match term:
        case tree.Power(base, tree.Number(value)) if value == 2:
            return base
        case tree.Times(base, other) if base == other:
            return base
        case _:
            return None


Rates: TypeAlias = tuple[Fraction, Fraction, Fraction]
"""The numbers L, U and c."""


def _estimated(shape: Stability, functions: Sequence[tree.Term], names: Sequence[str]) -> Rates | None:
    """The numbers, if the functions are positive and fall."""
    scope = {name: Symbol(name, "variable") for name in names}
    directions = np.random.default_rng(0).normal(size=(len(names), SAMPLES))
    directions /= np.linalg.norm(directions, axis=0)
    points = np.concatenate([r * directions for r in RADII], axis=1)
    columns: dict[Symbol, Any] = dict(zip(scope.values(), points, strict=True))
    norm = values(lower_term(shape.norm, scope), columns)
    least, most, decay = np.inf, 0.0, np.inf
    for mode, function in zip(shape.modes, functions, strict=True):
        inside = np.broadcast_to(truths(lower_formula(mode.domain, scope), columns), norm.shape) & (norm > 0)
        equations = [e for e in mode.equations if isinstance(e, tree.AtomicODE) and e.name in scope]
        field = Field({scope[e.name]: lower_term(e.term, scope) for e in equations}, Names(), lambda _: False)
        term = lower_term(function, scope)
        value, rate = values(term, columns), values(field.derivative(term), columns)
        with np.errstate(all="ignore"):
            chosen = (np.broadcast_to(a, norm.shape)[inside] for a in (value / norm, -rate / value))
            share, fall = chosen
        if not share.size or not np.isfinite(fall).all():
            return None
        least, most, decay = min(least, share.min()), max(most, share.max()), min(decay, fall.min())
    if least <= 0 or decay < (-1e-9 if shape.clock is None else 1e-6):
        return None
    return _below(MARGIN * least), -_below(-most / MARGIN), _below(MARGIN * max(decay, 0.0))


def _below(value: float) -> Fraction:
    """A short number that is not above."""
    digits = 10 ** (2 - floor(np.log10(abs(value)))) if value else 1
    return Fraction(floor(value * digits)) / Fraction(digits)


def _guess(
    shape: Stability, functions: Sequence[tree.Term], least: Fraction, most: Fraction, decay: Fraction
) -> Guess:
    inner, outer = (tree.Power(base, tree.Number(Fraction(2))) for base in (shape.inner, shape.outer))
    if shape.clock is None:
        ratio = _below(MARGIN * sqrt(least / most))
        value = tree.Times(tree.Number(ratio), shape.outer)
        parts = [_less(f, tree.Times(tree.Number(least), outer)) for f in functions]
    else:
        clock = tree.Variable(shape.clock)
        slowest = tree.Times(tree.Number(decay * least), outer)
        value = tree.Divide(tree.Times(tree.Number(most), inner), slowest)
        grown = tree.Plus(tree.Number(Fraction(1)), tree.Times(tree.Number(decay), clock))
        parts = [_less(tree.Times(f, grown), tree.Times(tree.Number(most), inner)) for f in functions]
    guarded = [
        part if mode.domain == tree.Truth(True) else tree.Imply(mode.domain, part)
        for mode, part in zip(shape.modes, parts, strict=True)
    ]
    if shape.clock is not None:
        guarded.insert(0, tree.Compare(">=", tree.Variable(shape.clock), tree.Number(Fraction(0))))
    equation = tree.Compare("=", tree.Variable(shape.witness.variable), value)
    invariant = tuple(replace(part, span=shape.loop.span) for part in dict.fromkeys(guarded))
    return {shape.loop.span: invariant, shape.witness.span: (equation,)}


def _less(left: tree.Term, right: tree.Term) -> tree.Formula:
    return tree.Compare("<", left, right)
