"""Witnesses and invariants for theorems about the stability of switched systems.

Of a norm N with functions V of the modes for which L*N <= V <= U*N and V' <= -c*V:

- stability has the witness d = r*e with r^2 <= L/U, and the invariant V < L*e^2;
- attractivity has the witness T = U*d^2 / (c*L*e^2), and the invariant V*(1 + c*t) < U*d^2.

Where V and N are not of one degree, or V falls near the origin only, L*e^2 is the least V on the sphere N = e^2,
bounded by r*min(b, e^2)^j, and N < min(b, e^2) is an invariant too. Where modes last for some time, each V has
a weight. The numbers are estimated from samples. Nothing here proves anything.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from itertools import product
from math import ceil, floor, inf, log
from typing import TypeAlias

import numpy as np

from dl2c.diagnostics import CompileError
from dl2c.parse import tree
from dl2c.resolve.symbols import free_variables
from dl2c.source import Span
from dl2c.verify.arithmetic.polynomials import NotPolynomial, TooLarge
from dl2c.verify.stability.claim import Claim, Radius, claim_of
from dl2c.verify.stability.dwell import Weight, weights
from dl2c.verify.stability.lyapunov import MARGIN, RADII, Estimate, Samples, above, below, candidates
from dl2c.verify.theorem import Theorem

SLACKS = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
"""Rates of decay that are tried for attractivity where modes last for some time."""

MARGINS = (0.9, 0.99)
"""By which rates are made slower, and quotients of functions greater, where modes last for some time."""

FLAT = 1.5
"""How much V/N may differ between spheres where both are said to be of one degree."""

Guess: TypeAlias = Mapping[Span, tuple[tree.Formula, ...]]
"""Invariants of loops and differential equations, and an equation for each existential quantifier, by their
places.
"""

ONE = tree.Number(Fraction(1))
ZERO = tree.Number(Fraction(0))


def guesses(theorem: Theorem) -> Iterator[Guess]:
    """Witnesses and invariants that may prove a theorem about stability; none for other theorems."""
    yield from _vacuous(theorem.formula)
    claim = claim_of(theorem.formula)
    if claim is None:
        return
    try:
        samples = Samples.of(claim)
    except (CompileError, KeyError):
        return
    if samples is None:
        return
    for functions in candidates(samples, theorem.hints.functions):
        try:
            yield from _of(samples, functions)
        except (CompileError, NotPolynomial, TooLarge, KeyError):
            continue


def _vacuous(formula: tree.Formula) -> Iterator[Guess]:
    """Of "there is an x such that, if x > 0, ...": any other x."""
    while isinstance(formula, tree.Forall | tree.Imply):
        formula = formula.child if isinstance(formula, tree.Forall) else formula.right
    match formula:
        case tree.Exists(name, tree.Imply(left, _)) if free_variables(left) == {name}:
            yield {formula.span: (tree.Compare("=", tree.Variable(name), ZERO),)}
        case _:
            pass


def _of(samples: Samples, functions: Sequence[tree.Term]) -> Iterator[Guess]:
    """The guesses with these functions of the modes."""
    claim = samples.claim
    modes = claim.system.modes
    found = [samples.estimate(f, mode) for f, mode in zip(functions, modes, strict=True)]
    least = np.min([e.least / e.norms for e in found], axis=0)
    most = np.max([e.most / e.norms for e in found], axis=0)
    decay = np.min([e.decay for e in found], axis=0)
    if least.min() <= 0 or not np.isfinite(most).all():
        return
    flat = least.max() < FLAT * least.min() and most.max() < FLAT * most.min()
    slowest = -1e-9 if claim.clock is None else 1e-6
    if claim.system.timer is not None:
        yield from _lasting(samples, functions, found)
    if flat and decay.min() >= slowest:
        yield _proportional(
            claim, functions, found, (Weight(Fraction(1), Fraction(0), 0),) * len(modes), decay.min()
        )
    elif (decay[: np.searchsorted(RADII, 0.1)] >= slowest).all():
        yield from _bounded(claim, functions, found, decay >= slowest)


def _lasting(samples: Samples, functions: Sequence[tree.Term], found: Sequence[Estimate]) -> Iterator[Guess]:
    """With weights that depend on how long modes have lasted."""
    claim = samples.claim
    pairs = list(product(range(len(functions)), repeat=2))
    ratios = {(p, q): samples.ratio(functions[q], functions[p]) if p != q else 1.0 for p, q in pairs}
    rates = [float(e.decay.min()) for e in found]
    if not (np.isfinite(rates).all() and all(0 < r < inf for r in ratios.values())):
        return
    for margin, slack in product(MARGINS, (0.0,) if claim.clock is None else SLACKS):
        decays = [r - (1 - margin) * abs(r) - slack for r in rates]
        chosen = weights(claim.system, decays, {k: r / margin for k, r in ratios.items()})
        if chosen is not None:
            yield _proportional(claim, functions, found, chosen, 2 * slack)
            return


def _proportional(
    claim: Claim,
    functions: Sequence[tree.Term],
    found: Sequence[Estimate],
    chosen: Sequence[Weight],
    decay: float,
) -> Guess:
    """With functions of the degree of the norm."""
    least = below(
        MARGIN
        * min(
            float((e.least / e.norms).min() * w.scale) * w.least() for e, w in zip(found, chosen, strict=True)
        )
    )
    most = above(
        max(float((e.most / e.norms).max() * w.scale) * w.at(0.0) for e, w in zip(found, chosen, strict=True))
        / MARGIN
    )
    weighted = [w.times(f, claim.system.timer) for w, f in zip(chosen, functions, strict=True)]
    if claim.clock is None:
        ratio = below(MARGIN * float(least / most) ** (1 / claim.inner.power))
        limit = tree.Times(tree.Number(least), claim.outer.bound)
        return _guess(claim, tree.Times(tree.Number(ratio), claim.outer.base), weighted, limit)
    rate = below(decay / 2)
    limit = tree.Times(tree.Number(most), claim.inner.bound)
    level = tree.Times(tree.Number(least), claim.outer.bound)
    witness = tree.Divide(limit, tree.Times(tree.Number(rate), level))
    last = level if claim.system.timer is not None else None
    return _guess(claim, witness, weighted, limit, last, decay=rate)


def _bounded(
    claim: Claim, functions: Sequence[tree.Term], found: Sequence[Estimate], falls: np.ndarray
) -> Iterator[Guess]:
    """With functions of other degrees than the norm, or that fall near the origin only."""
    end = len(RADII) if falls.all() else int(np.argmin(falls))
    cap = Fraction(1) if falls.all() else below(float(RADII[end - 1])) ** 2
    norms = found[0].norms[:end]
    least = np.min([e.least for e in found], axis=0)[:end]
    most = np.max([e.most for e in found], axis=0)[:end]
    degree = max(1, ceil(_slope(norms, least) - 0.1))
    lower = below(MARGIN * float((least / np.minimum(float(cap), norms) ** degree).min()))
    near = norms <= float(cap) * 1.0001
    fewest = max(1, floor(_slope(norms, most) + 0.1))
    upper = above(float((most / norms**fewest)[near].max()) / MARGIN)
    rises = ceil(degree / fewest)
    share = (float(lower / upper) * float(cap) ** (degree - rises * fewest)) ** (1 / fewest)
    if claim.clock is None:
        yield _near(claim, functions, cap, (lower, degree), (min(MARGIN * share, 1.0), rises))
    elif falls.all():
        decay = below(min(float(e.decay.min()) for e in found) / 2)
        largest = max(fewest, ceil(_slope(norms[::-1], most[::-1]) - 0.1))
        yield _far(claim, functions, (lower, degree), (upper, fewest, largest), decay)


def _slope(norms: np.ndarray, found: np.ndarray) -> float:
    """The exponent with which numbers grow at the first norms."""
    return float(log(found[1] / found[0]) / log(norms[1] / norms[0]))


def _near(
    claim: Claim,
    functions: Sequence[tree.Term],
    cap: Fraction,
    lower: tuple[Fraction, int],
    share: tuple[float, int],
) -> Guess:
    """Stability: the norm stays below min(cap, e^2), since V is too small to reach that."""
    radius = cap if claim.outer.power == 1 else below(float(cap) ** 0.5)
    base = tree.FuncOf("min", (tree.Number(radius), claim.outer.base))
    limit = Radius(base, claim.outer.power).bound
    ratio = below(share[0] ** (1 / claim.inner.power))
    witness = tree.Times(tree.Number(ratio), _power(base, share[1]))
    level = tree.Times(tree.Number(lower[0]), _power(limit, lower[1]))
    return _guess(claim, witness, functions, level, others=[tree.Compare("<", claim.norm, limit)])


def _far(
    claim: Claim,
    functions: Sequence[tree.Term],
    lower: tuple[Fraction, int],
    upper: tuple[Fraction, int, int],
    decay: Fraction,
) -> Guess:
    """Attractivity."""
    one = tree.Number(Fraction(1))
    factor, fewest, largest = upper
    powers = [_power(claim.inner.bound, k) for k in {fewest, largest}]
    most = tree.Times(tree.Number(factor), reduce(tree.Plus, powers))
    capped = _power(tree.FuncOf("min", (one, claim.outer.bound)), lower[1])
    level = tree.Times(tree.Number(lower[0]), capped)
    witness = tree.Divide(most, tree.Times(tree.Number(decay), level))
    return _guess(claim, witness, functions, most, level, decay=decay)


def _power(base: tree.Term, exponent: int) -> tree.Term:
    return base if exponent == 1 else tree.Power(base, tree.Number(Fraction(exponent)))


def _guess(
    claim: Claim,
    witness: tree.Term,
    functions: Sequence[tree.Term],
    limit: tree.Term,
    level: tree.Term | None = None,
    others: Sequence[tree.Formula] = (),
    decay: Fraction | None = None,
) -> Guess:
    """Functions below a limit in their modes; with a `decay` ever more so, and below a `level` at the end."""
    system = claim.system
    clocks = [tree.Variable(name) for name in (claim.clock, system.timer) if name is not None]
    late = tree.Compare(">=", tree.Variable(claim.clock or ""), tree.Variable(claim.witness.variable))
    parts: list[tree.Formula] = [tree.Compare(">=", clock, ZERO) for clock in clocks]
    kept = list(parts)
    if all(mode.tests for mode in system.modes):
        parts.append(reduce(tree.Or, dict.fromkeys(reduce(tree.And, mode.tests) for mode in system.modes)))
    found: dict[Span, tuple[tree.Formula, ...]] = {}
    for mode, function in zip(system.modes, functions, strict=True):
        condition = reduce(tree.And, mode.tests) if mode.tests else mode.system.domain
        grown = function if decay is None else tree.Times(function, _grown(claim, decay))
        small = reduce(tree.And, others, tree.Compare("<", grown, limit))
        found[mode.system.span] = (*kept, small)
        parts.append(_where(condition, small))
        if level is not None:
            parts.append(_where(condition, tree.Imply(late, tree.Compare("<", function, level))))
        if mode.longest is not None and system.timer is not None:
            time = tree.Compare("<=", tree.Variable(system.timer), tree.Number(mode.longest))
            parts.append(_where(condition, time))
    equation = tree.Compare("=", tree.Variable(claim.witness.variable), witness)
    if isinstance(claim.place, tree.Loop):
        span = claim.place.span
        found[span] = tuple(replace(p, span=span) for p in dict.fromkeys(parts))
    return {**found, claim.witness.span: (equation,)}


def _grown(claim: Claim, decay: Fraction) -> tree.Term:
    """1 + c*t."""
    assert claim.clock is not None
    return tree.Plus(ONE, tree.Times(tree.Number(decay), tree.Variable(claim.clock)))


def _where(condition: tree.Formula, part: tree.Formula) -> tree.Formula:
    return part if condition == tree.Truth(True) else tree.Imply(condition, part)
