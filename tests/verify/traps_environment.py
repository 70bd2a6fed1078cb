"""Traps that the environment hides: what it assumes, limits, skips, rounds or snaps."""

from fractions import Fraction

from verify.trap import AGAIN, STOP, L, R, Trap, lasting, once, times

BOUNDED = "/* @var: bound=[0:10] */ Real x; Real y; Real z; Real t;"
WHILE = "{?y < 2000; y := y + 1;}* ?y >= 2000;"

ASSUMED = (
    Trap(
        "bound of a variable",
        "y = 0 -> [y := x;] y <= 10",
        "x may be any real number: its bound is where the environment draws it",
        state={"x": 11},
        variables=BOUNDED,
    ),
    Trap(
        "bound of a variable that is written",
        "x = 0 -> [{x := x + 1;}*] x <= 10",
        "a bound limits initial states only, and those of the environment",
        decisions=times(11),
        variables=BOUNDED,
    ),
    Trap(
        "bound of a variable that is never written",
        "x = 0 -> [{x' = v}] x >= 0",
        "v may be negative",
        state={"v": -1},
        decisions=[lasting(1)],
        variables="Real x;\n  /* @var: bound=[0:5] */ Real v;",
    ),
    Trap(
        "bound of a constant",
        "x = 0 -> [x := c;] x >= 1",
        "the theorem is about every c",
        definitions="/* @const: bound=[1:2] */ Real c;",
    ),
    Trap(
        "bound of a constant in a rate",
        "x = 0 -> [{{x' = c}}*@invariant(x >= 0)] x >= 0",
        "c may be negative",
        state={"c": -1},
        decisions=once(lasting(1)),
        definitions="/* @const: bound=[0.5:2] */ Real c;",
    ),
    Trap(
        "bound of a name under a quantifier",
        "y = 0 -> \\forall x [y := x;] y <= 10",
        "the quantifier is about every number",
        state={"x": 11},
        variables=BOUNDED,
    ),
    Trap(
        "bound of an input",
        "y = 0 -> [{x := *; y := x;}*] y <= 10",
        "`x := *` takes any real number",
        decisions=once(11),
        variables=BOUNDED,
    ),
    Trap(
        "bound of an input with a test",
        "y = 0 -> [{x := *; ?x >= 0; y := x;}*@invariant(0 <= y & y <= 10)] y <= 10",
        "the test leaves the upper side open",
        decisions=once(11),
        variables=BOUNDED,
    ),
    Trap(
        "bound of a clock",
        "t = 0 -> [{t' = 1}] t <= 1",
        "no domain limits the flow",
        decisions=[lasting(2)],
        variables="/* @var: bound=[0:1] */ Real t;",
    ),
    Trap(
        "ceiling from an annotation",
        "1 <= h & v = 0 -> [{if (h <= 0) {v := 0;} {h' = v, v' = -10 & h >= 0}}*] (0 <= h & h <= 10)",
        "P leaves the height without a limit, as that of the bouncing ball once did",
        state={"h": 1000},
        decisions=[STOP],
        variables="/* @var: bound=[0:10] */ Real h;\n  /* @var: bound=[-15:15] */ Real v;",
    ),
    Trap(
        "a variable that starts at 0",
        "y = 1 -> [{x := y;}*] (x = 0 | x = 1)",
        "x is any number where the loop does not run, though the environment starts it at 0",
        state={"x": 5, "y": 1},
        decisions=[STOP],
    ),
    Trap(
        "a variable of the prefix that starts at 0",
        "y = 0 -> [{?y = 1; x := 0; ++ ?y = 0;} {z := y;}*] x = 0",
        "on the second way the prefix does not write x",
        state={"x": 3},
        decisions=[R, STOP],
    ),
    Trap(
        "the thin part of P",
        "x = 1 | (2 <= x & x <= 3) -> [y := x;] y >= 2",
        "x = 1 satisfies P, though it is never drawn beside an interval",
        state={"x": 1},
    ),
    Trap(
        "the boundary of P",
        "x^2 + y^2 <= 1 -> [z := x;] z < 1",
        "the boundary has no area, and belongs to P",
        state={"x": 1},
    ),
    Trap(
        "almost all states",
        "y = 0 -> [y := x;] y != 5",
        "one number is enough",
        state={"x": 5},
    ),
    Trap(
        "an equality that determines a constant",
        "c*c = 1 & x = 0 -> [x := c;] x = 1",
        "c = -1 satisfies the equality too",
        state={"c": -1},
        definitions="Real c;",
    ),
    Trap(
        "an equality about what the loop changes",
        "c = x & x = 1 -> [{x := x + 1;}*@invariant(c = 1)] c = x",
        "the equality that determines c holds in the initial state only",
        state={"c": 1, "x": 1},
        decisions=once(),
        definitions="Real c;",
    ),
    Trap(
        "some value that does not exist",
        "\\exists d (d > 1 & d < 0 & [x := d;] x = d)",
        "there is no such d; as `C -> F` about all d it holds",
        argument="no number is above 1 and below 0, so the conjunction is false for every d",
        polynomial=False,
    ),
    Trap(
        "some value is not every value",
        "(\\exists d (d > 0 & x = d^2)) -> [y := x;] y = 1",
        "x may be the square of any positive number",
        state={"x": 4},
    ),
)

LIMITED = (
    Trap(
        "eight iterations",
        "x = 0 -> [{x := x + 1;}*] x <= 8",
        "a loop has no limit",
        decisions=times(9),
    ),
    Trap(
        "eight iterations of a loop inside",
        "x = 0 & y = 0 -> [{x := 0; {x := x + 1;}* y := x;}*] y <= 8",
        "max_repeat is a limit of the environment",
        decisions=once(*times(9)),
    ),
    Trap(
        "a loop of the prefix",
        "x = 0 -> [{x := x + 1;}* y := x; {z := y;}*] y <= 8",
        "the prefix may repeat as often as it likes",
        decisions=[*times(9), STOP],
    ),
    Trap(
        "an exact number of iterations",
        "x = 0 -> [{x := x + 1;}*] (x != 10)",
        "ten iterations",
        decisions=times(10),
    ),
    Trap(
        "a long while loop",
        f"x = 0 & y = 0 -> [{{y := 0; {WHILE} x := 1;}}*] x = 0",
        "2000 iterations, more than max_loop",
        decisions=once(*times(2000)),
        polynomial=False,
    ),
    Trap(
        "a thousand iterations",
        "x = 0 -> [{x := x + 1;}*@invariant(x >= 0)] x < 1000",
        "no search of few iterations finds it",
        decisions=times(1000),
        polynomial=False,
    ),
    Trap(
        "one choice for all iterations",
        "x = 0 & y = 0 -> [{x := 0; y := 0; {x := x + 1; ++ y := y + 1;}*}*] (x = 0 | y = 0)",
        "each iteration of the inner loop chooses again",
        decisions=once(AGAIN, L, AGAIN, R, STOP),
    ),
    Trap(
        "one input for all iterations",
        "x = 0 & y = 0 -> [{x := 0; y := 0; {x := y; y := *;}*}*] (x = 0 | x = y)",
        "each iteration of the inner loop takes a value of its own",
        decisions=once(AGAIN, 1, AGAIN, 2, STOP),
    ),
    Trap(
        "one duration for all iterations",
        "x = 0 & y = 0 -> [{x := 0; y := 0; {y := x; x := 0; {x' = 1}}*}*] (y = 0 | x = y)",
        "each iteration of the inner loop flows as long as it likes",
        decisions=once(AGAIN, lasting(1), AGAIN, lasting(2), STOP),
    ),
    Trap(
        "one value for two inputs",
        "x = 0 -> [x := *; y := x; x := *;] x = y",
        "the second input of the same variable is another decision",
        decisions=[1, 2],
    ),
    Trap(
        "one value for two calls",
        "x = 0 -> [draw; y := x; draw;] x = y",
        "both calls are the same text and different decisions",
        decisions=[1, 2],
        definitions="HP draw ::= { x := *; };",
    ),
    Trap(
        "one choice for two calls",
        "x = 0 -> [pick; y := x; pick;] x = y",
        "both calls are the same text and different decisions",
        decisions=[L, R],
        definitions="HP pick ::= { x := 1; ++ x := 2; };",
    ),
    Trap(
        "one duration for two calls",
        "x = 0 -> [x := 0; go; y := x; x := 0; go;] x = y",
        "both calls are the same text and different durations",
        decisions=[lasting(1), lasting(2)],
        definitions="HP go ::= { {x' = 1} };",
    ),
    Trap(
        "one number of iterations for two loops",
        "x = 0 & y = 0 -> [{x := 0; y := 0; {x := x + 1;}* {y := y + 1;}*}*] x = y",
        "each inner loop runs as often as it likes",
        decisions=once(*times(1), *times(2)),
    ),
    Trap(
        "the longest duration",
        "x = 0 & t = 0 -> [{t := 0; {x' = 1, t' = 1 & t <= 1}}*] (t = 1 | x = 0)",
        "a flow may end before its clock does",
        decisions=once(lasting(Fraction(1, 2))),
    ),
    Trap(
        "dt",
        "x = 0 -> [{x := 0; {x' = 1}}*] x <= 0.1",
        "without a clock a flow lasts as long as it likes, not 0.1 seconds",
        decisions=once(lasting(1)),
    ),
    Trap(
        "the longest flow without a loop",
        "x = 0 -> [{x' = 1}] x <= 1000000",
        "max_flow is a limit of the environment",
        decisions=[lasting(1000001)],
    ),
    Trap(
        "a strict clock",
        "x = 0 & t = 0 -> [{x' = 1, t' = 1 & t < 2}] x <= 0.1",
        "`t < 2` is a domain like any other",
        decisions=[lasting(1)],
    ),
    Trap(
        "no duration",
        "x = 0 -> [{x' = 1}] x > 0",
        "a flow may last no time",
        decisions=[lasting(0)],
    ),
    Trap(
        "no iteration",
        "x = 0 -> [{x := 1;}*] x = 1",
        "a loop may run not at all",
        decisions=[STOP],
    ),
)

SKIPPED = (
    Trap(
        "a statement before the loop",
        "x = 0 -> [x := 1; {x := x;}*@invariant(x = 0)] x = 0",
        "the prefix is part of every run",
        decisions=[STOP],
    ),
    Trap(
        "a choice before the loop",
        "x = 0 -> [{x := 1; ++ x := 2;} {x := x;}*] x = 1",
        "the prefix may choose the other side",
        decisions=[R, STOP],
    ),
    Trap(
        "a flow before the loop",
        "x = 0 -> [{x' = 1} {y := x;}*] x <= 1",
        "the prefix flows as long as it likes",
        decisions=[lasting(2), STOP],
    ),
    Trap(
        "an input before the loop",
        "x = 0 -> [x := *; ?x >= 0; {x := x;}*@invariant(x >= 0)] x = 0",
        "the value of P is overwritten",
        decisions=[1, STOP],
    ),
    Trap(
        "a statement after the loop",
        "x = 0 -> [{x := x;}* x := 1;] x = 0",
        "the suffix is never executed by the environment, and part of every run",
        decisions=[STOP],
    ),
    Trap(
        "a flow after the loop",
        "x = 0 -> [{x := x;}*@invariant(x = 0) {x' = -1}] x >= 0",
        "the suffix flows",
        decisions=[STOP, lasting(1)],
    ),
    Trap(
        "a test after the loop",
        "x = 0 -> [{x := x + 1;}*@invariant(x >= 0) ?x >= 3;] x = 3",
        "the suffix tests, it does not stop the loop at the first success",
        decisions=times(4),
    ),
    Trap(
        "the second of two loops",
        "x = 0 & y = 0 -> [{x := x + 1;}* {y := y + 1;}*] y = 0",
        "both loops are part of every run, whichever an episode is made of",
        decisions=[STOP, *times(1)],
    ),
    Trap(
        "the first of two loops",
        "x = 0 -> [{x := x + 1;}*@invariant(x >= 0) {x := x - 1;}*@invariant(x >= 0)] x >= 0",
        "the second loop goes on below 0",
        decisions=[STOP, *times(1)],
    ),
    Trap(
        "a loop under a choice",
        "x = 0 -> [{{x := x + 1;}* ++ x := 0;}] x = 0",
        "the left side counts",
        decisions=[L, *times(1)],
    ),
    Trap(
        "a fallback",
        'a = 0 -> [{/* @choice: name="c" */ {a := *; ?a >= 0; ++ /* @fallback */ a := -1;}}*] a >= 0',
        "what the environment takes only when blocked is a choice like others",
        decisions=once(R),
        variables="Real a;",
    ),
    Trap(
        "a choice that looks like an if",
        "x = 0 -> [{?x >= 0; y := 1; ++ ?x <= 0; y := 2;}] y = 1",
        "at 0 both tests pass",
        decisions=[R],
    ),
    Trap(
        "a while loop that need not go on",
        "x = 0 -> [{?x < 3; x := x + 1;}*] x = 3",
        "without the test of its end the loop may stop earlier",
        decisions=[STOP],
    ),
    Trap(
        "a predicate instead of Q",
        "x = 0 -> [{x := x + 1;}*@invariant(x >= 0)] (ok(x) & x <= 3)",
        "the annotated predicate holds, Q does not",
        decisions=times(4),
        definitions="/* @safety: penalty=-1 */ Bool ok(Real x) <-> x >= 0;",
    ),
)

ROUNDED = (
    Trap(
        "snapping",
        "x = 0 -> [{x' = 1 & x <= 1}] !(0.9999999999 <= x & x < 1)",
        "a flow may end just before its bound, and is not moved onto it",
        decisions=[lasting(1 - Fraction(1, 10**11))],
    ),
    Trap(
        "the tolerance of predicates",
        "x = 1 -> [{x := x + 0.0000000001; ?x <= 1.0000000001;}*] ok(x)",
        "there is no tolerance in dL",
        decisions=once(),
        state={"x": 1},
        definitions="/* @safety: penalty=-1 */ Bool ok(Real x) <-> x <= 1;",
    ),
    Trap(
        "the tolerance of an equality",
        "0 <= x & x <= 0.000000000000001 -> [y := x;] y = 0",
        "a small number is not 0",
        state={"x": Fraction(1, 10**16)},
    ),
    Trap(
        "a sum in doubles",
        "x = 1 -> [y := x + 0.0000000000000000001;] y = x",
        "the sum is larger",
        state={"x": 1},
    ),
    Trap(
        "cancellation in doubles",
        "x = 10^20 -> [y := x + 1 - x;] y = 0",
        "y = 1",
        state={"x": 10**20},
    ),
    Trap(
        "decimals as doubles",
        "x = 0.1 -> [x := x + 0.2;] x != 0.3",
        "decimals are exact",
        state={"x": Fraction(1, 10)},
    ),
    Trap(
        "underflow",
        "x*10^30 = 1 -> [y := x^20;] y = 0",
        "y is positive",
        state={"x": Fraction(1, 10**30)},
    ),
    Trap(
        "overflow",
        "x = 10^200 -> [y := x^2; z := y + 1;] z <= y",
        "z is larger than y; as infinities they are equal",
        state={"x": 10**200},
    ),
    Trap(
        "a strict bound in doubles",
        "x < 1 -> [y := x;] y <= 0.99999999999999999",
        "there are numbers between",
        state={"x": 1 - Fraction(1, 10**20)},
    ),
)

TRAPS = ASSUMED + LIMITED + SKIPPED + ROUNDED
