"""Traps of numbers and terms: what is undefined, irrational, or read in another order than written."""

from fractions import Fraction

from verify.trap import Trap, lasting

HALF = Fraction(1, 2)
IMPORTS = "import kyx.math.pi; import kyx.math.e;"
PI = "3.141592653589793115997963468544185161590576171875"
"""The double nearest to pi, which is smaller."""
E = "2.718281828459045090795598298427648842334747314453125"
"""The double nearest to e, which is smaller."""

UNDEFINED = (
    Trap(
        "a quotient of itself",
        "x = 0 -> [y := x;] y/y = 1",
        "0/0 has no value",
        polynomial=False,
    ),
    Trap(
        "a quotient equal to itself",
        "x = 0 -> [y := 1;] y/x = y/x",
        "an atom with an undefined part is false",
        polynomial=False,
    ),
    Trap(
        "a quotient times its divisor",
        "y = 1 -> [z := y;] z/x*x = z",
        "x may be 0",
        state={"y": 1},
        polynomial=False,
    ),
    Trap(
        "either an atom or its negation",
        "x = 0 -> [y := 1;] (y/x > 0 | !(y/x > 0))",
        "both atoms are false where y/x has no value",
        polynomial=False,
    ),
    Trap(
        "a square root of a negative number",
        "x <= 1 -> [y := x;] sqrt(y)^2 = y",
        "sqrt(-1) has no value",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "a square root that is at least 0",
        "x <= 1 -> [y := x;] sqrt(y) >= 0",
        "sqrt(-1) has no value",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "a negated root",
        "x <= 1 -> [y := x;] !(sqrt(y) < 0)",
        "sqrt(-1) >= 0 is not true",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "division by zero as 0",
        "x = 0 -> [y := 1/x;] y = 0",
        "the value may be any number",
        argument="1/0 may be 1",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "division by zero as something fixed",
        "x = 0 -> [y := 1/x; z := 2/x;] y = z",
        "the values may be any numbers",
        argument="1/0 may be 1 and 2/0 may be 2",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "an assignment without a value",
        "x = 0 & y = 1 -> [y := 1/x;] false",
        "the run may go on with any value",
        argument="1/0 may be 1, and then the program has a run",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "a condition without a truth",
        "x = 0 & y = 0 -> [if (1/x > 0) {y := 1;} else {y := 0;}] y = 1",
        "the condition may be false",
        argument="1/0 may be -1, and then the other side runs",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "a rate without a value",
        "x = 0 & y = 0 -> [{x' = 1/y}] x = 0",
        "the rate may be any number",
        argument="1/0 may be 1, and then x moves",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "a rate that loses its value",
        "x = 1 -> [{x' = x*(-1/x)}] x > 0",
        "the rate is -1 until x is 0, where it has no value",
        state={"x": 1},
        argument="1/0 may be any number, so that 1 - t is a solution on [0, 1] but for the rate at its end",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "an odd root of a negative number",
        "x = -8 -> [y := x^(1/3);] y = -2",
        "powers that are not whole have no value for negative numbers",
        argument="(-8)^(1/3) may be any real number",
        polynomial=False,
        undefined=True,
    ),
    Trap(
        "zero to the power of zero as 0",
        "x = 0 -> [y := x^0;] y = 0",
        "x^0 is 1",
        polynomial=False,
    ),
    Trap(
        "a negative power of zero",
        "x = 0 -> [y := x;] y^(-1) = 0",
        "1/0 has no value",
        polynomial=False,
    ),
    Trap(
        "a domain without a truth",
        "x = -1 -> [{x' = 1 & (1/y > 0 | y = 0)}] x = -1",
        "y = 0 suffices for the domain",
        state={"x": -1},
        decisions=[lasting(1)],
        polynomial=False,
    ),
)

FUNCTIONS = (
    Trap(
        "pi as a double",
        f"x = {PI} -> [y := pi;] y = x",
        "pi is irrational",
        state={"x": Fraction(PI)},
        polynomial=False,
        definitions=IMPORTS,
    ),
    Trap(
        "pi below a double",
        f"x = 0 -> [x := pi;] x <= {PI}",
        "the nearest double is smaller than pi",
        polynomial=False,
        definitions=IMPORTS,
    ),
    Trap(
        "a multiple of pi",
        "x = 10^16 -> [x := x*pi;] x <= 31415926535897932",
        "with the nearest double the product would be smaller by more than 1",
        state={"x": 10**16},
        polynomial=False,
        definitions=IMPORTS,
    ),
    Trap(
        "e as a double",
        f"x = {E} -> [y := e;] y = x",
        "e is irrational",
        state={"x": Fraction(E)},
        polynomial=False,
        definitions=IMPORTS,
    ),
    Trap(
        "a root as a double",
        "x = 2 -> [y := sqrt(x);] y <= 1.41421356237309504",
        "the root is larger",
        state={"x": 2},
        polynomial=False,
    ),
    Trap(
        "a root of a square",
        "y = 0 -> [y := x^2; z := sqrt(y);] z = x",
        "the root of the square of -1 is 1",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "a power of one half",
        "y = 0 -> [y := x^2; z := y^(1/2);] z = x",
        "the root of the square of -1 is 1",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "a root that is smaller",
        "x >= 0 -> [y := sqrt(x);] y <= x",
        "the root of 1/4 is 1/2",
        state={"x": Fraction(1, 4)},
        polynomial=False,
    ),
    Trap(
        "both roots",
        "x = 4 -> [y := sqrt(x);] y = -2",
        "y^2 = x has two solutions, the root is the one that is not negative",
        state={"x": 4},
        polynomial=False,
    ),
    Trap(
        "abs without its sign",
        "abs(x) >= 1 -> [y := x;] y >= 1",
        "x may be -1",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "min as its first argument",
        "min(x, y) <= 0 -> [z := x;] z <= 0",
        "y may be the smaller one",
        state={"x": 1, "y": -1},
        polynomial=False,
    ),
    Trap(
        "max as its first argument",
        "max(x, y) >= 1 -> [z := x;] z >= 1",
        "y may be the larger one",
        state={"x": -1, "y": 1},
        polynomial=False,
    ),
    Trap(
        "a negative divisor",
        "x/y >= 1 -> [z := x;] z >= y",
        "multiplication with a negative number turns the inequality",
        state={"x": -2, "y": -1},
        polynomial=False,
    ),
    Trap(
        "a reciprocal of a negative number",
        "x <= 1 & x != 0 -> [y := 1/x;] y >= 1",
        "1/-1 is -1",
        state={"x": -1},
        polynomial=False,
    ),
    Trap(
        "a negative power",
        "x = 2 -> [y := x^(-1);] y = 2",
        "it is 1/2",
        state={"x": 2},
        polynomial=False,
    ),
    Trap(
        "the range of the sine",
        "x = 0 -> [{x' = 1}] sin(x) <= 0.5",
        "sin(2) is above 0.9",
        decisions=[lasting(2)],
        polynomial=False,
    ),
    Trap(
        "the sign of the cosine",
        "x = 0 -> [{x' = 1}] cos(x) >= 0",
        "cos(2) is negative",
        decisions=[lasting(2)],
        polynomial=False,
    ),
    Trap(
        "sines of different arguments",
        "x = 0 & y = 0 -> [{x' = 1, y' = 2}] sin(x) = sin(y)",
        "sin(1) is not sin(2)",
        decisions=[lasting(1)],
        polynomial=False,
    ),
    Trap(
        "sine and cosine without their identity",
        "x = 0 -> [{x' = 1}] sin(x) + cos(x) <= 1",
        "it is above 1.3 at 1",
        decisions=[lasting(1)],
        polynomial=False,
    ),
    Trap(
        "the growth of exp",
        "x = 0 -> [{x' = 1}] exp(x) <= 1 + 2*x",
        "exp(2) is above 7",
        decisions=[lasting(2)],
        polynomial=False,
    ),
    Trap(
        "exp as a constant",
        "x = 0 & y = exp(x) -> [x := x + 1;] y = exp(x)",
        "equal arguments are equal at one instant",
        polynomial=False,
        state={"y": 1},
    ),
    Trap(
        "a tangent without poles",
        "x = 0 -> [{x' = 1}] tan(x) >= 0",
        "tan(2) is negative",
        decisions=[lasting(2)],
        polynomial=False,
    ),
)

READING = (
    Trap(
        "a minus before a power",
        "x = 1 -> [y := -x^2;] y = 1",
        "-x^2 is -(x^2)",
        state={"x": 1},
    ),
    Trap(
        "powers from the left",
        "x = 0 -> [x := 2^3^2;] x = 64",
        "2^3^2 is 2^9",
    ),
    Trap(
        "differences from the right",
        "x = 8 -> [x := x - 4 - 2;] x = 6",
        "8 - 4 - 2 is 2",
        state={"x": 8},
    ),
    Trap(
        "quotients from the right",
        "x = 8 -> [x := x/4/2;] x = 4",
        "8/4/2 is 1",
        state={"x": 8},
        polynomial=False,
    ),
    Trap(
        "`|` before `&`",
        "x = 1 | y = 1 & z = 1 -> [t := z;] t = 1",
        "x = 1 suffices for P",
        state={"x": 1},
    ),
    Trap(
        "a wide negation",
        "!x = 1 & y = 1 -> [z := y;] z = 0",
        "`!` is about x = 1 only",
        state={"y": 1},
    ),
    Trap(
        "a wide choice",
        "x = 0 & y = 0 -> [x := 1; ++ x := 2; y := 1;] y = 1",
        "the left side ends before `y := 1`",
        decisions=[True],
    ),
    Trap(
        "statements at once",
        "x = 0 & y = 1 -> [x := y; y := x;] y = 0",
        "y takes the new value of x",
        state={"y": 1},
    ),
)

TRAPS = UNDEFINED + FUNCTIONS + READING
