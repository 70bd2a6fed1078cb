"""Traps of what cannot be expressed exactly: domains without elimination, equations without definition."""

from verify.trap import Trap

ONLY_AT_ZERO = "(\\forall w (x - {0}) * (w^3 + w + 1) <= 0)"
"""True only where x has this value, and no elimination of quantifiers says so."""


def _never(name: str, problem: str, why: str, argument: str) -> Trap:
    return Trap(name, problem, why, argument=argument, polynomial=False)


TRAPS = (
    _never(
        "an assumption about a motion that its domain stops at once",
        f"[x := 0; {{x' = 1 & {ONLY_AT_ZERO.format(0)}}}] x <= 0 & z >= 0 -> z <= 0",
        "a domain that cannot be expressed is no domain that is always true",
        "the motion has no duration, so that the assumption says nothing of z",
    ),
    _never(
        "the same before another program",
        f"[x := 0; {{x' = 1 & {ONLY_AT_ZERO.format(0)}}}] x <= 0 & z >= 0 -> [x := 1;] z <= 0",
        "a domain that cannot be expressed is no domain that is always true",
        "the motion has no duration, so that the assumption says nothing of z",
    ),
    _never(
        "an assumption about a motion from a symbol",
        f"x = 0 & [y := x; {{x' = 1 & {ONLY_AT_ZERO.format('y')}}}] x <= y & z >= 0 -> [y := 1;] z <= 0",
        "a domain that cannot be expressed is no domain that is always true",
        "the motion has no duration, so that the assumption says nothing of z",
    ),
    _never(
        "a box of an equation without definition fails",
        "!([{c{|x|}}] y > 0) -> [z := 1;] y <= 0",
        "the equation is not empty: it may change y",
        "c may be y' = -1: the box is false at y = 1",
    ),
    _never(
        "an equation without definition may end first",
        "[{x' = 1, c{|x|}}] x <= 3 -> [y := 1;] x >= 10",
        "with it the solution of x may not exist for all times",
        "c may be y' = y^2: from x = 0, y = 1 all solutions end before x is 1",
    ),
    _never(
        "a test about an equation without definition",
        "[?<{c{|x|}}> y = 1; z := y;] z = 1",
        "the equation is not empty: it may change y",
        "c may be y' = 1: from y = 0 the test passes, and z is 0",
    ),
    _never(
        "a domain about an equation without definition",
        "x = 1 -> [{y' = 1 & <{c{|x|}}> y = 1}] y = 1",
        "the equation is not empty: it may change y",
        "c may be y' = 1: from y = 0 the domain is true at the start, where y is 0",
    ),
)
