"""Conditions on x that fail on a narrow interval around c, in many ways of writing it, and nothing else.

Each is known in three ways that share no code with dl2c: its text, the open interval on which it fails in
closed form, and its two sides as written, which mpmath evaluates at forty digits or in intervals of doubles.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import mpmath
from mpmath import mpf
from mpmath.ctx_iv import MPIntervalContext

high: Any = mpmath.mp.clone()
high.dps = 40
rounded: Any = MPIntervalContext()
"""Intervals that contain whatever doubles make of a term, in any order of rounding."""
rounded.prec = 53

Sides = Callable[[Any, Any, Any, Any], tuple[Any, Any]]
Interval = tuple[mpf, mpf]


@dataclass(frozen=True)
class Form:
    """`text` holds iff the first of `sides(x, c, w, arithmetic)` is at least (or above) the second."""

    name: str
    text: str
    sides: Sides
    fails: Callable[[mpf, mpf], Interval]

    def margin(self, x: mpf, c: mpf, w: mpf) -> mpf:
        """Over the reals; negative where it fails."""
        left, right = self.sides(x, c, w, high)
        return cast("mpf", left - right)

    def surely(self, x: float | mpf, c: float, w: float, noise: float = 0) -> bool | None:
        """What doubles make of it at all x no further off than `noise`; None where that is not one answer."""
        near = rounded.mpf(float(x)) + rounded.mpf([-1, 1]) * noise
        left, right = self.sides(near, rounded.mpf(c), rounded.mpf(w), rounded)
        difference = left - right
        return True if difference.a > 0 else False if difference.b < 0 else None


def larger(a: Any, b: Any, arithmetic: Any) -> Any:
    if arithmetic is rounded:
        a, b = rounded.convert(a), rounded.convert(b)
        return rounded.mpf([max(a.a, b.a), max(a.b, b.b)])
    return max(a, b)


def smaller(a: Any, b: Any, arithmetic: Any) -> Any:
    return -larger(-a, -b, arithmetic)


def around(scale: Any = 1) -> Callable[[mpf, mpf], Interval]:
    """Fails within `scale*w` of c, at both sides alike."""
    return lambda c, w: (c - scale * w, c + scale * w)


def power(degree: int) -> tuple[Form, Form]:
    def divided(x: Any, c: Any, w: Any, _: Any) -> tuple[Any, Any]:
        return ((x - c) / w) ** degree, 1

    def plain(x: Any, c: Any, w: Any, _: Any) -> tuple[Any, Any]:
        return (x - c) ** degree, w**degree

    return (
        Form(f"power {degree}", f"((x-c)/w)^{degree} >= 1", divided, around()),
        Form(f"plain power {degree}", f"(x-c)^{degree} >= w^{degree}", plain, around()),
    )


def relative(c: mpf, w: mpf) -> Interval:
    """Where (x-c)^2 < w^2*(1+x^2)."""
    a, b, d = 1 - w**2, -2 * c, c**2 - w**2
    root = high.sqrt(b**2 - 4 * a * d)
    return (-b - root) / (2 * a), (-b + root) / (2 * a)


def outside(x: Any, c: Any, w: Any, arithmetic: Any) -> tuple[Any, Any]:
    return larger((c - w) - x, x - (c + w), arithmetic), 0


POLYNOMIAL: tuple[Form, ...] = (
    *power(2),
    *power(4),
    *power(6),
    *power(8),
    Form(
        "product",
        "((x-c)^2-w^2)*(1+x^2) >= 0",
        lambda x, c, w, _: (((x - c) ** 2 - w**2) * (1 + x**2), 0),
        around(),
    ),
    Form("expanded", "x^2-2*c*x+c^2 >= w^2", lambda x, c, w, _: (x**2 - 2 * c * x + c**2, w**2), around()),
    Form("apart", "(x <= c-w | x >= c+w)", outside, around()),
)

OTHERS: tuple[Form, ...] = (
    Form(
        "rational",
        "1/(1+((x-c)/w)^2) <= 1/2",
        lambda x, c, w, _: (0.5, 1 / (1 + ((x - c) / w) ** 2)),
        around(),
    ),
    Form(
        "rational 4",
        "1/(1+((x-c)/w)^4) < 1/2",
        lambda x, c, w, _: (0.5, 1 / (1 + ((x - c) / w) ** 4)),
        around(),
    ),
    Form(
        "share", "w^2/((x-c)^2+w^2) <= 1/2", lambda x, c, w, _: (0.5, w**2 / ((x - c) ** 2 + w**2)), around()
    ),
    Form(
        "root",
        "sqrt((x-c)^2+w^2) >= 2*w",
        lambda x, c, w, m: (m.sqrt((x - c) ** 2 + w**2), 2 * w),
        around(high.sqrt(3)),
    ),
    Form(
        "root of quotient",
        "sqrt(1+((x-c)/w)^2)-1 > 1",
        lambda x, c, w, m: (m.sqrt(1 + ((x - c) / w) ** 2) - 1, 1),
        around(high.sqrt(3)),
    ),
    Form(
        "quotient of root",
        "1/sqrt(1+((x-c)/w)^4) <= 1/2",
        lambda x, c, w, m: (0.5, 1 / m.sqrt(1 + ((x - c) / w) ** 4)),
        around(high.root(3, 4)),
    ),
    Form(
        "quotient", "(x-c)^2/(1+x^2) >= w^2", lambda x, c, w, _: ((x - c) ** 2 / (1 + x**2), w**2), relative
    ),
    Form("abs", "abs(x-c) > w", lambda x, c, w, _: (abs(x - c), w), around()),
    Form(
        "abs in quotient",
        "abs(x-c)/(w+abs(x-c)) >= 1/2",
        lambda x, c, w, _: (abs(x - c) / (w + abs(x - c)), 0.5),
        around(),
    ),
    Form(
        "max", "max(abs(x-c)/w, 1/2) >= 1", lambda x, c, w, m: (larger(abs(x - c) / w, 0.5, m), 1), around()
    ),
    Form(
        "min of root",
        "min(2, sqrt(abs(x-c)/w)) >= 1",
        lambda x, c, w, m: (smaller(2, m.sqrt(abs(x - c) / w), m), 1),
        around(),
    ),
    Form(
        "nested",
        "max(1/(1+sqrt(abs(x-c)/w)), 1/4) <= 1/2",
        lambda x, c, w, m: (0.5, larger(1 / (1 + m.sqrt(abs(x - c) / w)), 0.25, m)),
        around(),
    ),
)

FORMS = (*POLYNOMIAL, *OTHERS)
