"""Directed rounding of `+ - * /`, powers and roots on doubles.

`*_down` gives the largest double that is not above the exact result, `*_up` the
smallest that is not below it; powers are rounded at every multiplication, roots of
degree above two to within a few units (more where their powers are subnormal). Infinite
operands are limits of interval endpoints (0 * inf is 0), so a finite lower bound never
becomes +inf.
"""

import math

INF = math.inf
MAX = math.nextafter(INF, 0.0)
"""The largest double."""


def add_down(a: float, b: float) -> float:
    s = a + b
    if math.isinf(s):
        return s if s < 0 else MAX
    t = s - a
    residue = (a - (s - t)) + (b - t)
    return s if residue >= 0 else math.nextafter(s, -INF)


def mul_down(a: float, b: float) -> float:
    if a == 0 or b == 0:
        return 0.0
    p = a * b
    if math.isinf(p):
        return p if p < 0 or math.isinf(a) or math.isinf(b) else MAX
    return p if _product_sign(a, b, p) >= 0 else math.nextafter(p, -INF)


def div_down(a: float, b: float) -> float:
    """a / b for 0 <= b, where b = 0 is the limit from above and b = inf comes with finite 0 <= a only."""
    if a == 0 or math.isinf(b):
        return 0.0
    if b == 0 or math.isinf(a):
        return math.copysign(INF, a)
    q = a / b
    if math.isinf(q):
        return q if q < 0 else MAX
    return q if _product_sign(q, b, a) <= 0 else math.nextafter(q, -INF)


def _product_sign(a: float, b: float, c: float) -> int:
    """A number with the sign of a * b - c, computed exactly."""
    (an, ad), (bn, bd), (cn, cd) = a.as_integer_ratio(), b.as_integer_ratio(), c.as_integer_ratio()
    return an * bn * cd - cn * ad * bd


def add_up(a: float, b: float) -> float:
    return -add_down(-a, -b)


def mul_up(a: float, b: float) -> float:
    return -mul_down(-a, b)


def div_up(a: float, b: float) -> float:
    return -div_down(-a, b)


def sqrt_down(a: float) -> float:
    if math.isinf(a):
        return MAX
    r = math.sqrt(a)
    return r if _product_sign(r, r, a) <= 0 else math.nextafter(r, 0.0)


def sqrt_up(a: float) -> float:
    if math.isinf(a):
        return INF
    r = math.sqrt(a)
    return r if _product_sign(r, r, a) >= 0 else math.nextafter(r, INF)


def power_down(m: float, n: int) -> float:
    result = m
    for _ in range(n - 1):
        result = mul_down(result, m)
    return result


def power_up(m: float, n: int) -> float:
    result = m
    for _ in range(n - 1):
        result = mul_up(result, m)
    return result


def root_down(value: float, n: int) -> float:
    if n == 2:
        return sqrt_down(value)
    r, step = min(value ** (1 / n), MAX), 2.0**-50
    while power_up(r, n) > value:
        r, step = (r * (1 - step), 2 * step) if r > 1e-300 and step < 1 else (0.0, step)
    return r


def root_up(value: float, n: int) -> float:
    if n == 2:
        return sqrt_up(value)
    r, step = value ** (1 / n), 2.0**-50
    while power_down(r, n) < value:
        r, step = r * (1 + step), 2 * step
    return r
