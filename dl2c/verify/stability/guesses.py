"""Witnesses and invariants for theorems about the stability of switched systems.

Of a norm N with functions V of the modes for which L*N <= V <= U*N and V' <= -c*V:

- stability has the witness d = r*e with r^2 <= L/U, and the invariant V < L*e^2;
- attractivity has the witness T = U*d^2 / (c*L*e^2), and the invariant V*(1 + c*t) < U*d^2.

Where V and N are not of one degree, or V falls near the origin only, r*min(b, e^2)^j stands for L*e^2: V is
not less on the sphere N = e^2, and N < min(b, e^2) is an invariant too. Where modes last for some time, each
V has a weight. Numbers are estimated from samples. Nothing here proves anything.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from itertools import product
from math import ceil, floor, inf, log
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.parse import tree
from dl2c.resolve.symbols import free_variables
from dl2c.source import Span
from dl2c.verify.stability.claim import Claim, Radius, claim_of
from dl2c.verify.stability.dwell import Weight, weights
from dl2c.verify.stability.lyapunov import (
    MARGIN,
    NUMBERLESS,
    Estimate,
    Numbers,
    Samples,
    above,
    below,
    candidates,
)
from dl2c.verify.stability.switching import ONE, ZERO
from dl2c.verify.theorem import Theorem

SLACKS = tuple(map(Fraction, ("0.5", "0.2", "0.1", "0.05", "0.02", "0.01", "0.005", "0.002")))
"""Rates of decay that are tried for attractivity where modes last for some time."""

MARGINS = (0.9, 0.99)
"""By which rates are made slower, and quotients of functions greater, where modes last for some time."""

STEADY, FALLING = -1e-9, 1e-6
"""Rates of decay that are enough for stability and for attractivity."""

SLOW = 0.01
"""Of the greatest rate of decay: less of it near the origin says that functions fall ever slower."""

NEAR = 0.01
"""Norms at which functions fall at least."""

Truths: TypeAlias = NDArray[np.bool_]

Guess: TypeAlias = Mapping[Span, tuple[tree.Formula, ...]]
"""Invariants of loops and differential equations, and an equation for each existential quantifier, by their
places.
"""


def guesses(theorem: Theorem) -> Iterator[Guess]:
    """Witnesses and invariants that may prove a theorem about stability; none for other theorems."""
    yield from _vacuous(theorem.formula)
    claim = claim_of(theorem.formula)
    samples = None
    if claim is not None:
        with suppress(*NUMBERLESS):
            samples = Samples.of(claim)
    if samples is None:
        return
    for functions in candidates(samples, theorem.hints.functions):
        found: list[Guess] = []
        with suppress(*NUMBERLESS), np.errstate(all="ignore"):
            found = list(_Functions.of(samples, functions).guesses())
        yield from found


def _vacuous(formula: tree.Formula) -> Iterator[Guess]:
    """Of "there is an x such that, if x > 0, ...": any other x."""
    while isinstance(formula, tree.Forall | tree.Imply):
        formula = formula.child if isinstance(formula, tree.Forall) else formula.right
    match formula:
        case tree.Exists(name, tree.Imply(left, _)) if free_variables(left) == frozenset({name}):
            yield {formula.span: (tree.Compare("=", tree.Variable(name), ZERO),)}
        case _:
            pass


@dataclass(frozen=True, slots=True)
class _Functions:
    """A function for each mode, and what samples say of them one by one and of all."""

    samples: Samples
    terms: tuple[tree.Term, ...]
    found: tuple[Estimate, ...]
    worst: Estimate

    @classmethod
    def of(cls, samples: Samples, terms: tuple[tree.Term, ...]) -> "_Functions":
        found = tuple(map(samples.estimate, terms, samples.claim.system.modes))
        return cls(samples, terms, found, Estimate.of_all(found))

    @property
    def claim(self) -> Claim:
        return self.samples.claim

    def guesses(self) -> Iterator[Guess]:
        """What they suggest."""
        worst = self.worst
        if not worst.norms.size or worst.norms.min() <= 0 or worst.least.min() <= 0:
            return
        slower = self.claim.clock is not None and worst.decay[0] < SLOW * worst.decay.max()
        falls = worst.decay >= (STEADY if self.claim.clock is None else FALLING)
        if self.claim.system.timer is not None:
            yield from self._lasting()
        if slower and worst.drop.min() > 0:
            yield self._slow()
        if worst.proportional and falls.all():
            same = Weight(Fraction(1), Fraction(0), 0)
            yield self._proportional([same] * len(self.terms), below(worst.decay.min() / 2))
        elif falls[worst.norms < NEAR].all():
            yield from self._bounded(falls)

    def _lasting(self) -> Iterator[Guess]:
        """With weights that depend on how long modes have lasted."""
        pairs = list(product(range(len(self.terms)), repeat=2))
        ratios = {
            (p, q): 1.0 if p == q else self.samples.ratio(self.terms[q], self.terms[p]) for p, q in pairs
        }
        rates = [float(e.decay.min()) for e in self.found]
        if not (np.isfinite(rates).all() and all(0 < r < inf for r in ratios.values())):
            return
        for margin, slack in product(MARGINS, (Fraction(0),) if self.claim.clock is None else SLACKS):
            decays = [r - (1 - margin) * abs(r) - float(slack) for r in rates]
            chosen = weights(self.claim.system, decays, {k: r / margin for k, r in ratios.items()})
            if chosen is not None:
                yield self._proportional(chosen, slack)
                return

    def _proportional(self, chosen: Sequence[Weight], decay: Fraction) -> Guess:
        """With functions of the degree of the norm; all fall like exp(-decay*t)."""
        claim = self.claim
        pairs = list(zip(self.found, chosen, strict=True))
        smallest = min(float((e.least / e.norms).min() * w.scale) * w.least() for e, w in pairs)
        greatest = max(float((e.most / e.norms).max() * w.scale) * w.at(0.0) for e, w in pairs)
        least, most = below(MARGIN * smallest), above(greatest / MARGIN)
        weighted = [w.times(f, claim.system.timer) for w, f in zip(chosen, self.terms, strict=True)]
        level = tree.Times(tree.Number(least), claim.outer.bound)
        if claim.clock is None:
            ratio = below(MARGIN * float(least / most) ** (1 / claim.inner.power))
            witness = tree.Times(tree.Number(ratio), claim.outer.base)
            return _guess(claim, witness, [_less(f, level) for f in weighted])
        limit = tree.Times(tree.Number(most), claim.inner.bound)
        witness = tree.Divide(limit, tree.Times(tree.Number(decay), level))
        ends = [_less(f, level) for f in weighted] if claim.system.timer else ()
        return _guess(claim, witness, [_falling(claim, f, decay, limit) for f in weighted], ends)

    def _bounded(self, falls: Truths) -> Iterator[Guess]:
        """With functions of other degrees than the norm, or that fall near the origin only."""
        claim = self.claim
        end = falls.size if falls.all() else int(np.argmin(falls))
        near = self.worst.within(end)
        if claim.clock is None:
            cap = Fraction(1) if falls.all() else below(float(near.norms[-1]))
            yield _near(claim, self.terms, near, cap)
        elif falls.all():
            lower, degree = _least(near, Fraction(1))
            decay, most = below(near.decay.min() / 2), _most(claim, near)
            level = tree.Times(tree.Number(lower), _power(_capped(claim), degree))
            witness = tree.Divide(most, tree.Times(tree.Number(decay), level))
            small = [_falling(claim, f, decay, most) for f in self.terms]
            yield _guess(claim, witness, small, [_less(f, level) for f in self.terms])

    def _slow(self) -> Guess:
        """Attractivity with functions that fall ever slower, by r*min(1, V)^k at least: at any time either
        V is small enough or V + r*min(1, L)^k*t, for the least V that is too great, is what it was at most.
        """
        claim, worst = self.claim, self.worst
        lower, degree = _least(worst, Fraction(1))
        rises = max(1, ceil(_slope(worst.most, worst.drop) - 0.1))
        speed = below(MARGIN * float((worst.drop / np.minimum(1.0, worst.most) ** rises).min()))
        level = tree.Times(tree.Number(lower), _power(_capped(claim), degree))
        slowest = tree.Times(
            tree.Number(speed * min(lower, Fraction(1)) ** rises), _power(_capped(claim), degree * rises)
        )
        most = _most(claim, worst)
        assert claim.clock is not None
        gone = tree.Times(slowest, tree.Variable(claim.clock))
        small = [tree.Or(_less(f, level), _less(tree.Plus(f, gone), most)) for f in self.terms]
        return _guess(claim, tree.Divide(most, slowest), small, [_less(f, level) for f in self.terms])


def _least(found: Estimate, cap: Fraction) -> tuple[Fraction, int]:
    """r and j such that V >= r*min(cap, N)^j."""
    degree = max(1, ceil(_slope(found.norms, found.least) - 0.1))
    return below(MARGIN * float((found.least / np.minimum(float(cap), found.norms) ** degree).min())), degree


def _most(claim: Claim, found: Estimate) -> tree.Term:
    """A bound of V where the norm is below the inner one."""
    fewest = max(1, floor(_slope(found.norms, found.most) + 0.1))
    largest = max(fewest, ceil(_slope(found.norms[::-1], found.most[::-1]) - 0.1))
    degrees = sorted({fewest, largest})
    factor = above(float((found.most / sum(found.norms**k for k in degrees)).max()) / MARGIN)
    return tree.Times(tree.Number(factor), reduce(tree.Plus, (_power(claim.inner.bound, k) for k in degrees)))


def _slope(norms: Numbers, found: Numbers) -> float:
    """The exponent with which numbers grow at the first norms."""
    return float(log(found[1] / found[0]) / log(norms[1] / norms[0]))


def _near(claim: Claim, functions: Sequence[tree.Term], found: Estimate, cap: Fraction) -> Guess:
    """Stability: the norm stays below min(cap, e^2), since V is too small to reach that."""
    lower, degree = _least(found, cap)
    fewest = max(1, floor(_slope(found.norms, found.most) + 0.1))
    small = found.norms <= float(cap) * 1.0001
    upper = float((found.most / found.norms**fewest)[small].max()) / MARGIN
    rises = ceil(degree / fewest)
    share = (float(lower) / upper * float(cap) ** (degree - rises * fewest)) ** (1 / fewest)
    ratio = below(min(MARGIN * share, 1.0) ** (1 / claim.inner.power))
    radius = below(float(cap) ** (1 / claim.outer.power))
    base = tree.FuncOf("min", (tree.Number(radius), claim.outer.base))
    limit = Radius(base, claim.outer.power).bound
    level = tree.Times(tree.Number(lower), _power(limit, degree))
    inside = [tree.And(_less(f, level), _less(claim.norm, limit)) for f in functions]
    return _guess(claim, tree.Times(tree.Number(ratio), _power(base, rises)), inside)


# Formulas -------------------------------------------------------------------------------


def _guess(
    claim: Claim, witness: tree.Term, small: Sequence[tree.Formula], ends: Sequence[tree.Formula] = ()
) -> Guess:
    """What holds in the modes; `ends` hold once the clock has reached the witness."""
    system = claim.system
    clocks = [tree.Variable(name) for name in (claim.clock, system.timer) if name is not None]
    late = tree.Compare(">=", tree.Variable(claim.clock or ""), tree.Variable(claim.witness.variable))
    begun: list[tree.Formula] = [*(tree.Compare(">=", clock, ZERO) for clock in clocks), *claim.kept]
    parts = list(begun)
    if all(mode.tests for mode in system.modes):
        parts.append(reduce(tree.Or, dict.fromkeys(reduce(tree.And, mode.tests) for mode in system.modes)))
    found: dict[Span, tuple[tree.Formula, ...]] = {}
    for number, mode in enumerate(system.modes):
        condition = reduce(tree.And, mode.tests) if mode.tests else mode.system.domain
        found[mode.system.span] = (*begun, small[number])
        parts.append(_where(condition, small[number]))
        if ends:
            parts.append(_where(condition, tree.Imply(late, ends[number])))
        if mode.longest is not None and system.timer is not None:
            time = tree.Compare("<=", tree.Variable(system.timer), tree.Number(mode.longest))
            parts.append(_where(condition, time))
    equation = tree.Compare("=", tree.Variable(claim.witness.variable), witness)
    if isinstance(claim.place, tree.Loop):
        span = claim.place.span
        found[span] = tuple(replace(p, span=span) for p in dict.fromkeys(parts))
    return {**found, claim.witness.span: (equation,)}


def _falling(claim: Claim, function: tree.Term, decay: Fraction, limit: tree.Term) -> tree.Formula:
    """V*(1 + c*t) < U."""
    assert claim.clock is not None
    grown = tree.Plus(ONE, tree.Times(tree.Number(decay), tree.Variable(claim.clock)))
    return _less(tree.Times(function, grown), limit)


def _capped(claim: Claim) -> tree.Term:
    return tree.FuncOf("min", (ONE, claim.outer.bound))


def _less(left: tree.Term, right: tree.Term) -> tree.Formula:
    return tree.Compare("<", left, right)


def _power(base: tree.Term, exponent: int) -> tree.Term:
    return base if exponent == 1 else tree.Power(base, tree.Number(Fraction(exponent)))


def _where(condition: tree.Formula, part: tree.Formula) -> tree.Formula:
    return part if condition == tree.Truth(True) else tree.Imply(condition, part)
