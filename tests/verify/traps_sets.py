"""Traps of Darboux inequalities, barriers, invariance of whole sets, and of what solvers abstract from."""

from fractions import Fraction

from verify.trap import AGAIN, MOMENT, STOP, L, R, Trap, lasting, once

HALF = Fraction(1, 2)

DARBOUX = (
    Trap(
        "a cofactor with a pole",
        "x = 1 -> [{x' = -1}] x > 0",
        "x' = (-1/x)*x, and 1/x is no polynomial",
        state={"x": 1},
        decisions=[lasting(2)],
    ),
    Trap(
        "a cofactor with a root",
        "x = 1 -> [{x' = -2*sqrt(x)}] x > 0",
        "x' = (-2/sqrt(x))*x; x = (1-t)^2 reaches 0",
        state={"x": 1},
        decisions=[lasting(1, x=(1, -2, 1))],
        polynomial=False,
    ),
    Trap(
        "a root that leaves 0",
        "x = 0 -> [{x' = sqrt(x)}] x = 0",
        "x = t^2/4 is another solution beside x = 0",
        decisions=[lasting(2, x=(0, 0, Fraction(1, 4)))],
        polynomial=False,
    ),
    Trap(
        "a root that leaves 0 upwards",
        "x = 0 -> [{x' = 2*sqrt(x)}@invariant(x <= 0)] x <= 0",
        "x = t^2 is another solution beside x = 0",
        decisions=[lasting(1, x=(0, 0, 1))],
        polynomial=False,
    ),
    Trap(
        "a root that leaves 0 downwards",
        "x = 0 -> [{x' = -2*sqrt(abs(x))}] x >= 0",
        "x = -t^2 is another solution beside x = 0",
        decisions=[lasting(1, x=(0, 0, -1))],
        polynomial=False,
    ),
    Trap(
        "a root beside a square",
        "x = 0 & y = 0 -> [{x' = y, y' = sqrt(abs(y))}] x <= 0",
        "y = t^2/4 is a solution, and x = t^3/12",
        decisions=[lasting(1, y=(0, 0, Fraction(1, 4)), x=(0, 0, 0, Fraction(1, 12)))],
        polynomial=False,
    ),
    Trap(
        "a power that leaves 0",
        "x = 0 -> [{x' = 3*abs(x)^(2/3)}] x = 0",
        "x = t^3 leaves 0",
        argument="where 0^(2/3) counts as undefined, it may be any real number, and 1 moves x at once",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "an equality by an inequality",
        "x = 0 -> [{x' = x^2 + x + 1}] x = 0",
        "p' - g*p >= 0 keeps p >= 0, not p = 0",
        decisions=[MOMENT],
    ),
    Trap(
        "the wrong direction",
        "x = 1 & y = 0 -> [{x' = -x - 1, y' = 1}] x >= 0",
        "p' - g*p <= 0 with g = -1: x falls below 0",
        state={"x": 1},
        argument="x = 2*exp(-t) - 1 is negative at t = 1",
        polynomial=False,
    ),
    Trap(
        "a remainder that is forgotten",
        "x = 0 & y = 0 -> [{x' = x*y - 1, y' = 1}@invariant(x >= 0)] x >= 0",
        "x' = y*x leaves the remainder -1",
        decisions=[MOMENT],
    ),
    Trap(
        "a factor that changes its sign",
        "x = 1 & y = 1 -> [{x' = -y, y' = -1}] x >= 1",
        "x falls while y is positive",
        state={"x": 1, "y": 1},
        decisions=[lasting(1)],
    ),
    Trap(
        "a factor that may be negative",
        "x < 0 & y = 0 -> [{x' = x*y, y' = 1}] x >= 0",
        "x keeps its sign, which is negative",
        state={"x": -1},
        decisions=[lasting(0)],
    ),
)

BARRIERS = (
    Trap(
        "a barrier with a derivative of 0",
        "x = 0 -> [{x' = -1}] x^3 >= 0",
        "where x^3 = 0 its derivative is 0, which is not positive",
        decisions=[lasting(1)],
    ),
    Trap(
        "a strict barrier with a derivative of 0",
        "x = 1 -> [{x' = -1}] x^3 > 0",
        "where x^3 = 0 its derivative is 0, which is not positive",
        state={"x": 1},
        decisions=[lasting(2)],
    ),
    Trap(
        "a barrier that is nowhere negative inside",
        "x = 0 -> [{x' = 1}] -x^2 >= 0",
        "where -x^2 = 0 its derivative is 0",
        decisions=[lasting(1)],
    ),
    Trap(
        "a barrier of even order",
        "x = 0 & y = 0 -> [{x' = 1, y' = 0}@invariant(y^2 + x^2 <= 0)] x <= 0",
        "the derivative 2*x is 0 where the sum of squares is",
        decisions=[lasting(1)],
    ),
    Trap(
        "a barrier with siblings on their boundary",
        "x = 1 & y = 1 -> [{x' = -1, y' = -1}@invariant(x^3 >= 0 & y^3 >= 0)] (x >= 0 & y >= 0)",
        "both leave together",
        state={"x": 1, "y": 1},
        decisions=[lasting(2)],
    ),
    Trap(
        "a barrier across the domain",
        "x = 0 & y = 0 -> [{x' = -1, y' = 1 & y >= 0}] x >= -1",
        "the domain keeps y, not x",
        decisions=[lasting(2)],
    ),
    Trap(
        "a barrier that holds outside",
        "x = -1 -> [{x' = 1 + x^2}@invariant(x >= 0)] x >= 0",
        "the boundary pushes inwards, the flow begins outside",
        state={"x": -1},
        decisions=[lasting(0)],
    ),
)

SETS = (
    Trap(
        "an open set",
        "x = 0 -> [{x' = 1}] x < 1",
        "the half about the complement is needed for open sets",
        decisions=[lasting(1)],
    ),
    Trap(
        "a closed set",
        "x = 0 -> [{x' = 1}] x <= 0",
        "the half about the set is needed for closed sets",
        decisions=[lasting(1)],
    ),
    Trap(
        "an open set with a domain",
        "x = 0 -> [{x' = 1 & x <= 1}] x < 1",
        "the domain includes the boundary of the set",
        decisions=[lasting(1)],
    ),
    Trap(
        "a closed set beside an open domain",
        "x = 0 -> [{x' = 1 & x < 1}] x <= 0.5",
        "the domain ends later",
        decisions=[lasting("3/4")],
    ),
    Trap(
        "two closed sets",
        "x = 0 -> [{x' = 1}] (x <= 0 | x >= 1)",
        "there is a gap between them",
        decisions=[lasting(HALF)],
    ),
    Trap(
        "two open sets",
        "x = 0 -> [{x' = 1}] (x < 1 | x > 1)",
        "the gap is a point",
        decisions=[lasting(1)],
    ),
    Trap(
        "an open and a closed set",
        "x = 0 & y = 0 -> [{x' = 1, y' = 1}] (x < 1 | y <= 0 | y > 1)",
        "x and y are 1 together",
        decisions=[lasting(1)],
    ),
    Trap(
        "a set that is left later in order",
        "x = 0 & y = 0 -> [{x' = 1, y' = x}] y <= 0",
        "the first derivative is 0, the second is not",
        decisions=[lasting(1)],
    ),
    Trap(
        "a set that is left by the fifth derivative",
        "x = 0 & y = 0 -> [{x' = 1, y' = x^4}] y <= 0",
        "four derivatives are 0 at the start",
        decisions=[lasting(1)],
    ),
    Trap(
        "a set that is left by the third derivative, nonlinear",
        "x = 0 & y = 0 -> [{x' = 1 + y^2, y' = x^2}] y <= 0",
        "two derivatives are 0 at the start",
        decisions=[MOMENT],
    ),
    Trap(
        "a point of a curve",
        "x = 0 & y = 0 -> [{x' = 1, y' = 0}] (x*y = 0 & x^2 + y^2 = 0)",
        "the flow stays on the one set, not on the other",
        decisions=[lasting(1)],
    ),
    Trap(
        "a set that is not convex",
        "x = 0 & y = 1 -> [{x' = 1}] (x <= 1 | x >= 2 | y < 1)",
        "x passes the gap while y = 1",
        state={"y": 1},
        decisions=[lasting("3/2")],
    ),
    Trap(
        "a rotation",
        "x = 1 & y = 0 -> [{x' = -y, y' = x}] x >= 0",
        "half a turn later x is -1",
        state={"x": 1},
        argument="x = cos(t), which is -1 at t = pi",
        polynomial=False,
    ),
    Trap(
        "a rotation, at once",
        "x = 1 & y = 0 -> [{x' = -y, y' = x}] x = 1",
        "x^2 + y^2 is conserved, x is not",
        state={"x": 1},
        decisions=[MOMENT],
    ),
    Trap(
        "growth without a bound",
        "x = 1 -> [{x' = x}] x <= 2",
        "x doubles in less than a second, and again",
        state={"x": 1},
        argument="x = exp(t), which is above 2 at t = 1",
        polynomial=False,
    ),
    Trap(
        "growth at once",
        "x = 1 -> [{x' = x}@invariant(x <= 1)] x <= 1",
        "the rate is 1 at the boundary",
        state={"x": 1},
        decisions=[MOMENT],
    ),
)

LOOPS = (
    Trap(
        "an invariant that does not hold at first",
        "x = 5 -> [{x := x;}*@invariant(x = 0)] x = 0",
        "P does not imply the invariant",
        state={"x": 5},
        decisions=[STOP],
    ),
    Trap(
        "an invariant that a step breaks",
        "x = 0 -> [{x := x + 1;}*@invariant(x <= 3)] x <= 3",
        "it holds for three iterations",
        decisions=[AGAIN] * 4 + [STOP],
    ),
    Trap(
        "an invariant that does not imply Q",
        "x = 0 -> [{x := x;}*@invariant(x >= 0)] x > 0",
        "x is 0",
        decisions=[STOP],
    ),
    Trap(
        "false as invariant",
        "x = 0 -> [{x := x + 1;}*@invariant(false)] x = 0",
        "false is kept by every step, and holds nowhere",
        decisions=once(),
    ),
    Trap(
        "P in later iterations",
        "v = 0 & x = 0 -> [{x := x + v; v := 1;}*@invariant(x = 0)] x = 0",
        "v = 0 holds at first only",
        decisions=[AGAIN, AGAIN, STOP],
        variables="Real x; Real v;",
    ),
    Trap(
        "P about what a flow writes",
        "v = 0 & x = 0 -> [{{x' = v, v' = 1}}*@invariant(x = 0)] x = 0",
        "v = 0 holds where the flow begins, once",
        decisions=once(lasting(1)),
        variables="Real x; Real v;",
    ),
    Trap(
        "P about what one side writes",
        "y = 1 & x = 0 -> [{{?y = 1; ++ y := 2;} x := y - 1;}*@invariant(x = 0)] x = 0",
        "the right side writes y",
        state={"y": 1},
        decisions=once(R),
    ),
    Trap(
        "P about what the suffix writes",
        "y = 1 -> [{x := y;}*@invariant(true) y := 2;] y = 1",
        "the suffix writes y",
        state={"y": 1},
        decisions=[STOP],
    ),
    Trap(
        "P about what the prefix writes",
        "y = 1 & x = 1 -> [y := *; {x := x*y;}*@invariant(x >= 0)] x >= 0",
        "y is any number after the prefix",
        state={"y": 1, "x": 1},
        decisions=[-1, *once()],
    ),
    Trap(
        "the state before the loop",
        "x = 0 & y = 1 -> [{y := y - 1; x := y;}*@invariant(true)] x >= 0",
        "in the second iteration x is -1",
        state={"y": 1},
        decisions=[AGAIN, AGAIN, STOP],
    ),
    Trap(
        "the invariant of the other loop",
        "x = 0 -> [{x := x + 1;}*@invariant(x >= 0) {x := x + 2;}*@invariant(x >= 0)] x != 1",
        "one iteration of the first loop",
        decisions=[*once(), STOP],
    ),
    Trap(
        "the invariant of the inner loop",
        "x = 0 -> [{x := x - 1; {x := x + 1;}*@invariant(x >= -1)}*@invariant(x >= 0)] x >= 0",
        "the inner loop may run not at all",
        decisions=once(STOP),
    ),
    Trap(
        "an invariant under a choice",
        "x = 0 -> [{{x := x + 1;}*@invariant(x >= 0) ++ {x := x - 1;}*@invariant(x <= 0)}] x >= 0",
        "the loop on the right goes down",
        decisions=[R, *once()],
    ),
    Trap(
        "a loop inside a loop that resets",
        "x = 0 & y = 0 -> [{y := 0; {y := y + 1; x := x + y;}*@invariant(x >= 0)}*] x <= 1",
        "the inner loop adds 1 and 2",
        decisions=once(AGAIN, AGAIN, STOP),
    ),
    Trap(
        "both sides of a choice",
        "x = 0 -> [{x := x + 1; ++ x := 0;}*@invariant(x >= 0 & x <= 1)] x <= 1",
        "the left side twice",
        decisions=[AGAIN, L, AGAIN, L, STOP],
    ),
)

EARLIER = (
    Trap(
        "the earlier value of an inner loop",
        "x = 0 -> [{{y := y;}*@invariant(x = old(x)) x := x + 1;}*@invariant(x <= old(x) + 1)] x <= 1",
        "`old(x)` of the outer loop is x before all of its iterations, wherever an inner loop begins",
        decisions=[AGAIN, STOP, AGAIN, STOP, STOP],
    ),
    Trap(
        "the earlier value of an inner loop after a flow",
        "x = 0 -> [{{x' = 1} {x := x;}*@invariant(x = old(x))}*@invariant(x <= old(x))] x <= 0",
        "the inner loop begins after the flow, the outer one before it",
        decisions=[AGAIN, lasting(1), STOP, STOP],
    ),
)

TRAPS = DARBOUX + BARRIERS + SETS + LOOPS + EARLIER
