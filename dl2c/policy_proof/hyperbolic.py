"""tanh in the arithmetic of the checker: enclosures of its values, and lines around it.

Numbers are whole numbers over 2^SCALE, as in `fixed_point`. Shares no code with the search.
"""

from dl2c.policy_proof.fixed_point import ONE, SCALE, Ends

WIDE = SCALE + 32
UNIT = 1 << WIDE
"""Inside, numbers are over 2^WIDE."""

SATURATED = 40 * ONE
"""From here on 1 - tanh(z) < 2 e^-80 < 2^-114."""


def tanh_at(z: int) -> Ends:
    """Numbers below and above tanh(z). With E = e^(-2z), tanh(z) = (1 - E) / (1 + E) falls as E grows."""
    if z < 0:
        low, high = tanh_at(-z)
        return -high, -low
    if z >= SATURATED:
        return ONE - 1, ONE
    least, most = _decayed(2 * z)
    below = ((UNIT - most) << SCALE) // (UNIT + most)
    above = -((-(UNIT - least) << SCALE) // (UNIT + least))
    return below, above


def _decayed(y: int) -> Ends:
    """Numbers over 2^WIDE between 0 and 1, below and above e^-y, for y from 0 to 2 SATURATED.

    y is halved until it is less than 2^-8, which is exact: 2 SATURATED < 2^7 takes 15 of the 32 bits that
    numbers have more here. Then e^-y = 1 - y + y^2/2 - ..., and what follows a sum is smaller than the next
    term. A term is rounded down: it is less than 2 units too small, since the error of the one before
    counts less than 2^-8. The last one is 0 here, so what follows is less than 2 units too. Squares are
    rounded outwards.
    """
    halvings = max(0, y.bit_length() - SCALE + 8)
    y <<= WIDE - SCALE - halvings
    total, term, n = 0, UNIT, 0
    while term:
        total += -term if n % 2 else term
        n += 1
        term = term * y // (n << WIDE)
    error = 2 * n + 2
    low, high = max(0, total - error), min(UNIT, total + error)
    for _ in range(halvings):
        low, high = low * low >> WIDE, -(-high * high >> WIDE)
    return low, high


def lines_around(low: int, high: int) -> tuple[int, int, int]:
    """A slope, and offsets below and above: for z between `low` and `high`, slope * z + offset is not above,
    and not below, tanh(z).

    The derivative 1 - tanh(z)^2 is smallest at one of the ends. Where the slope is no larger than that,
    tanh(z) - slope * z grows with z, so it is between its values at both ends.
    """
    first, last = tanh_at(low), tanh_at(high)
    flattest = max(-first[0], last[1])
    slope = max(0, ONE - (-(-flattest * flattest >> SCALE)))
    return slope, first[0] - (-(-slope * low >> SCALE)), last[1] - (slope * high >> SCALE)
