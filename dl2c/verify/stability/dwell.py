"""Weights of modes, by how long they have lasted.

A mode whose function V falls like exp(-a*s) has the weight w(s) = 1 + a*s + ... + (a*s)^n/n!, with which w*V
still falls. A mode in which V grows like exp(a*s) and that ends at the time T has w(s) = 1 + b*(T - s) + ...
+ (b*(T - s))^n/n! with b > a so large that w*V does not grow. Scales of modes are found such that no jump
makes the greatest of all scale*w*V greater: a shortest path through the logarithms.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import exp, inf, log

from dl2c.parse import tree
from dl2c.verify.stability.lyapunov import above, below
from dl2c.verify.stability.switching import ONE, Mode, Switching

ORDERS = (1, 2, 3, 4, 6, 8, 12)
"""Degrees of weights, the simplest first."""

SPARE = 0.02
"""By which logarithms are better than needed, since scales are rounded."""


@dataclass(frozen=True, slots=True)
class Weight:
    """Of one mode: its `scale`, and a truncated exponential of `rate` times the timer, or times what is left
    until the timer is `until`.
    """

    scale: Fraction
    rate: Fraction
    order: int
    until: Fraction | None = None

    def at(self, time: float) -> float:
        """Without the scale."""
        lasted = time if self.until is None else float(self.until) - time
        return truncated(float(self.rate) * lasted, self.order)

    def least(self, since: float = 0.0) -> float:
        """The least value from a time on, without the scale."""
        return self.at(since) if self.until is None else 1.0

    def times(self, function: tree.Term, timer: str | None) -> tree.Term:
        """The weighted function."""
        product = function if self.scale == 1 else tree.Times(tree.Number(self.scale), function)
        if timer is None or not self.rate:
            return product
        time: tree.Term = tree.Variable(timer)
        if self.until is not None:
            time = tree.Minus(tree.Number(self.until), time)
        weight: tree.Term | None = None
        for k in range(self.order, 0, -1):
            part = tree.Times(tree.Number(self.rate / k), time)
            weight = tree.Plus(ONE, part if weight is None else tree.Times(part, weight))
        return product if weight is None else tree.Times(product, weight)


def truncated(x: float, order: int) -> float:
    """The sum of x^k/k! up to an order."""
    total = term = 1.0
    for k in range(1, order + 1):
        term *= x / k
        total += term
    return total


def weights(
    system: Switching, decays: Sequence[float], ratios: Mapping[tuple[int, int], float]
) -> tuple[Weight, ...] | None:
    """A weight for each mode, the simplest that do; `ratios[p, q]` is the greatest of V_q/V_p."""
    for order in ORDERS:
        plain = [_weight(mode, decay, order) for mode, decay in zip(system.modes, decays, strict=True)]
        if any(w is None for w in plain):
            continue
        found = _scaled(system, [w for w in plain if w is not None], ratios)
        if found is not None:
            return found
    return None


def _weight(mode: Mode, decay: float, order: int) -> Weight | None:
    if decay >= 0:
        return Weight(Fraction(1), below(decay), order)
    if mode.longest is None:
        return None
    rate = -decay
    for _ in range(30):
        x = rate * float(mode.longest)
        needed = -decay * truncated(x, order) / truncated(x, order - 1)
        if needed <= rate:
            return Weight(Fraction(1), above(rate), order, mode.longest)
        rate = needed * 1.01
    return None


def _scaled(
    system: Switching, plain: Sequence[Weight], ratios: Mapping[tuple[int, int], float]
) -> tuple[Weight, ...] | None:
    """The weights with scales; None where jumps gain more than modes lose."""
    gains: dict[tuple[int, int], float] = {}
    for jump in system.jumps:
        if jump.source == jump.target and not jump.reset:
            continue
        if not jump.reset:
            return None
        p, q = plain[jump.source], plain[jump.target]
        gain = log(ratios[jump.source, jump.target] * q.at(0.0) / p.least(float(jump.waited))) + SPARE
        if jump.source == jump.target and gain <= 2 * SPARE:
            continue
        pair = jump.source, jump.target
        gains[pair] = max(gain, gains.get(pair, -inf))
    scales = [0.0] * len(plain)
    for _ in range(len(plain) + 1):
        changed = False
        for (source, target), gain in gains.items():
            if scales[target] > scales[source] - gain + 1e-9:
                scales[target], changed = scales[source] - gain, True
        if not changed:
            greatest = max(scales)
            return tuple(
                Weight(below(exp(s - greatest)), w.rate, w.order, w.until)
                for s, w in zip(scales, plain, strict=True)
            )
    return None
