"""Traps of the shape of problems: quantifiers, definitions, implications, modalities, diamonds and games."""

from fractions import Fraction

from verify.trap import STOP, L, R, Trap, once, times

NAMES = (
    Trap(
        "a quantified variable in P",
        "y = 0 & (\\exists x x = 2) -> [y := x;] y = 2",
        "the x of the quantifier is not the x of the program",
        state={"x": 1},
    ),
    Trap(
        "a quantified variable in P, for all",
        "y = 0 & (\\forall x x^2 >= 0) -> [y := x;] y >= 0",
        "what holds of all squares says nothing of x",
        state={"x": -1},
    ),
    Trap(
        "a quantified variable in a test",
        "x = 1 & y = 0 -> [?\\exists x (x = 5); y := x;] y = 5",
        "the test is about no state",
        state={"x": 1},
    ),
    Trap(
        "a universal test where its premise is false",
        "x = 0 & y = 0 -> [?\\forall z (z^5 + z > 2 -> z + y > 1);] x + y > 1",
        "the test says nothing of numbers up to 1",
        argument="above 1, z + 0 > 1, so that the test is passed, and 0 + 0 > 1 is false",
        polynomial=False,
    ),
    Trap(
        "a universal test about values that change after it",
        "x = 0 & y = 0 -> [?\\forall z (z^5 + z >= 2 -> z + y >= 1); x := 1; y := -7;] x + y >= 1",
        "the test is about the first y",
        argument="where z is at least 1, z + 0 >= 1, so that the test is passed, and 1 - 7 >= 1 is false",
        polynomial=False,
    ),
    Trap(
        "a universal test over a name of the program",
        "x = 0 & y = 0 -> [?\\forall x (x^5 + x > 2 -> x + y > 1); ?y^5 + y <= 2;] x + y > 1",
        "the x of the test is not the x of the program",
        argument="the tests are passed as above, and 0 + 0 > 1 is false",
        polynomial=False,
    ),
    Trap(
        "an old value in a loop",
        "true -> [y := x; {x := x - 1;}*@invariant(x >= old(x) - 1)] x >= y - 1",
        "old(x) is x before the loop, not before an iteration",
        decisions=times(2),
    ),
    Trap(
        "an old value in a loop inside a loop",
        "x = 0 & z = 0 -> [{z := x; {x := x + 1;}*@invariant(x >= old(x) & z = old(z))"
        "}*@invariant(z >= 0 & x >= z)] x <= z + 1",
        "nothing limits how often the loop inside runs",
        decisions=once(*times(2)),
    ),
    Trap(
        "an assumption about a motion that leaves its domain and comes back",
        "x = 1 & y = -2 & [{x' = y, y' = 1 & x >= 0}] x^3 <= 125 -> [{x' = y, y' = 1}] x <= 5",
        "x(t) >= 0 at both ends does not say that the domain holds between them",
        argument="x = 1 - 2t + t^2/2 is negative from 0.6 to 3.4 and 7 at t = 6; in the domain x <= 1",
        polynomial=False,
    ),
    Trap(
        "an assumption about a motion that cannot begin",
        "x = 5 & y = 0 & [{x' = -1 & x <= 0}] (x^5 + x > 1 | y = 1) -> [{x' = -1}] (x > 0 | y = 1)",
        "where the domain is false at first there is no run, and nothing is assumed",
        argument="at x = 5 the domain is false, so the assumption is true, and after 6 s x = -1 and y = 0",
        polynomial=False,
    ),
    Trap(
        "an assumption about a loop",
        "x = 0 & [{x := x + 1; ?x < 3;}*] x^5 + x <= 34 -> [{x := x + 1;}*@invariant(x^5 + x <= 34)] x <= 2",
        "the loop of the assumption stops at 2",
        argument="the assumption is true, as x is 0, 1 or 2 after its loop; the other loop comes to 3",
        polynomial=False,
    ),
    Trap(
        "a quantified variable in a domain",
        "x = 0 -> [{x' = 1 & \\exists y (y > x)}] x <= y",
        "the domain is always true",
        argument="every number is below another one, so that x is 1 after a second, while y may be 0",
        polynomial=False,
    ),
    Trap(
        "a quantified variable in Q",
        "x = 0 & y = 3 -> [x := 1;] \\forall y (y > x)",
        "the y of the quantifier is any number",
        state={"y": 3},
    ),
    Trap(
        "some value instead of every value",
        "x = 0 -> [x := 1;] \\forall y (y^2 >= x)",
        "y may be 0",
    ),
    Trap(
        "a quantifier around the program",
        "x = 0 -> \\forall y [x := y;] x <= 1",
        "y is any number",
        state={"y": 2},
    ),
    Trap(
        "a quantified name of a constant",
        "c = 1 & (\\forall c c^2 >= 0) -> [x := c;] x = 0",
        "the constant keeps its value",
        state={"c": 1},
        definitions="Real c;",
    ),
    Trap(
        "a parameter with the name of a variable",
        "x = 5 & y = 0 -> [z := f(y);] z = 6",
        "f(y) is y + 1, whatever x is",
        state={"x": 5},
        definitions="Real f(Real x) = x + 1;",
    ),
    Trap(
        "parameters in another order",
        "x = 1 & y = 2 -> [z := g(y, x);] z = 0",
        "g(y, x) is y - x; one substitution after the other gives x - x",
        state={"x": 1, "y": 2},
        definitions="Real g(Real x, Real y) = x - y;",
    ),
    Trap(
        "a predicate with the name of a variable as parameter",
        "x = 1 & y = -1 -> [z := 0;] p(y)",
        "p(y) is about y",
        state={"x": 1, "y": -1},
        definitions="Bool p(Real x) <-> x >= 0;",
    ),
    Trap(
        "a definition in a definition",
        "x = 2 & y = 3 -> [z := h(x, y);] z = 5",
        "h(x, y) is x + 2*y",
        state={"x": 2, "y": 3},
        definitions="Real g(Real y) = 2*y; Real h(Real x, Real y) = x + g(y);",
    ),
    Trap(
        "a quantified variable and an argument",
        "x = 1 -> [z := 0;] below(x)",
        "the argument is x of the program, not x of the quantifier",
        state={"x": 1},
        definitions="Bool below(Real y) <-> \\forall x (x^2 >= y);",
    ),
)

IMPLICATIONS = (
    Trap(
        "an implication as assumption",
        "(x = 1 -> y = 1) -> [z := y;] z = 1",
        "the assumption holds where x is not 1",
    ),
    Trap(
        "a chain of implications",
        "x = 1 -> y = 2 -> [z := x;] z = 2",
        "x is 1",
        state={"x": 1, "y": 2},
    ),
    Trap(
        "a chain without its middle",
        "x >= 1 -> (y >= 0 -> [x := x + y;] x >= 2)",
        "y may be 0",
        state={"x": 1},
    ),
    Trap(
        "an equivalence as assumption",
        "(x = 1 <-> y = 1) -> [x := y;] x = 1",
        "both sides may be false",
    ),
    Trap(
        "an equivalence as Q",
        "x = 1 -> [{x := x;}*] (x >= 0 <-> x >= 2)",
        "one side holds, the other one does not",
        state={"x": 1},
        decisions=[STOP],
    ),
    Trap(
        "an equivalence of false sides",
        "x = 1 -> [{x := x + 1;}*] (x = 1 <-> x <= 1.5 & x >= 1.2)",
        "at first one side holds",
        state={"x": 1},
        decisions=[STOP],
    ),
    Trap(
        "a negated conjunction",
        "!(x = 0 & y = 0) -> [z := x;] z != 0",
        "y may be the one that is not 0",
        state={"y": 1},
    ),
    Trap(
        "a disjunctive assumption",
        "(x = 0 | y = 0) -> [z := x*y; x := x + y;] x = 0",
        "the product is 0, the sum is not",
        state={"x": 1},
    ),
    Trap(
        "a weaker P",
        "v >= 0 & ep > 0 -> [{t := 0; {x' = v, t' = 1 & t <= ep}}*@invariant(x >= 0)] x >= 0",
        "P does not say where x begins",
        state={"x": -1, "ep": 1},
        decisions=[STOP],
        variables="Real x; Real v; Real t;",
        definitions="Real ep;",
    ),
    Trap(
        "true as P",
        "true -> [{x := x;}*@invariant(x = x)] x >= 0",
        "x is any number",
        state={"x": -1},
        decisions=[STOP],
    ),
)

MODALITIES = (
    Trap(
        "two boxes",
        "x = 0 -> [x := 1;][y := x;] y = 0",
        "the second box is about the state after the first",
    ),
    Trap(
        "two boxes that add",
        "x = 0 -> [x := x + 1;][x := x + 1;] x = 1",
        "both are executed",
    ),
    Trap(
        "two boxes with loops",
        "x = 0 -> [{x := x + 1;}*@invariant(x >= 0)][{x := x - 1;}*@invariant(x <= 0)] x >= 0",
        "the second loop goes below 0",
        decisions=[STOP, *times(1)],
    ),
    Trap(
        "an implication between boxes",
        "x = 0 -> [x := x + 1;](x = 1 -> [x := x + 1;] x = 1)",
        "the premise is about the state in between",
    ),
    Trap(
        "a box beside a box",
        "x = 0 -> ([x := 1;] x = 1) & ([x := 2;] x = 1)",
        "the second box is false",
        polynomial=False,
    ),
    Trap(
        "a formula beside a box",
        "x = 0 -> ([x := 1;] x = 1) & x = 1",
        "x = 1 is about the state before",
        polynomial=False,
    ),
    Trap(
        "Q without parentheses",
        "x = 0 -> [x := 1;] x = 1 & x = 1",
        "the box ends before `&`",
        polynomial=False,
    ),
    Trap(
        "a box in P",
        "y = 0 & ([x := 5;] x = 5) -> [y := x;] y = 5",
        "the box in P changes nothing",
    ),
    Trap(
        "a box in P that holds elsewhere",
        "([x := x + 1;] x >= 1) -> [y := x;] y >= 1",
        "the box says that x is at least 0",
    ),
    Trap(
        "a box in P without runs",
        "([?x > 0; x := 1;] x = 1) -> [y := x;] y > 0",
        "where the test fails the box is true",
    ),
    Trap(
        "a flow in P",
        "([{x' = 1}] x >= 0) -> [y := x;] y >= 1",
        "the box says that x is at least 0",
        argument="at x = 0 the flow keeps x at 0 or above, and y is 0",
        polynomial=False,
    ),
    Trap(
        "a diamond in P",
        "(<x := x + 1; ++ x := x - 1;> x = 1) -> [y := x;] y = 0",
        "x may be 2: the right side makes it 1",
        state={"x": 2},
    ),
    Trap(
        "a box in Q",
        "x = 0 -> [x := 1;] [y := 2;] y = x",
        "y is 2 and x is 1",
    ),
    Trap(
        "a box in a test",
        "x = 0 -> [?[x := 1;] x = 1; y := x;] y = 1",
        "the test changes nothing",
    ),
    Trap(
        "a diamond",
        "x = 0 -> <x := 1;> x = 2",
        "its only run ends with 1",
        polynomial=False,
    ),
    Trap(
        "a diamond without runs",
        "x = 0 -> <?x = 1;> x = 0",
        "it has no run",
        polynomial=False,
    ),
    Trap(
        "a diamond beside a box",
        "x = 0 -> ([x := 1;] x = 1) & (<x := 1;> x = 2)",
        "the box is true, the diamond is not",
        polynomial=False,
    ),
    Trap(
        "a diamond of a loop",
        "x = 0 -> <{x := x + 1;}*> x = -1",
        "the loop only adds",
        argument="x is at least 0 after every number of iterations",
        polynomial=False,
    ),
    Trap(
        "a diamond of a flow",
        "x = 0 -> <{x' = 1}> x = -1",
        "the flow only grows",
        argument="x is t, and t is at least 0",
        polynomial=False,
    ),
    Trap(
        "a diamond of a flow without a domain",
        "x = 0 -> <{x' = 1 & x >= 1}> x = 1",
        "the domain fails where the flow begins",
        polynomial=False,
    ),
)

GAMES = (
    Trap(
        "a test of the other player",
        "x = 0 -> [{?false;}^@] x = 1",
        "the other player fails the test and loses; a run that fails a test proves nothing",
        polynomial=False,
    ),
    Trap(
        "a test of the other player, later",
        "x = 0 -> [{y := 2; ?x = 1;}^@] y = 2",
        "the other player fails the test and loses",
        polynomial=False,
    ),
    Trap(
        "a choice of the other player",
        "x = 0 -> [{x := 1; ++ x := 2;}^@] x = 3",
        "neither side makes x 3",
        polynomial=False,
    ),
    Trap(
        "a demonic choice",
        "x = 0 -> [x := 1; -- x := 2;] x = 0",
        "neither side makes x 0",
        polynomial=False,
    ),
    Trap(
        "a choice of either player",
        "x = 0 -> [{x := 1; ++ x := 2;} {y := 1; -- y := 3;}] x + y = 3",
        "if the one chooses 1, the other one needs 2",
        polynomial=False,
    ),
    Trap(
        "a choice inside the game of the other",
        "x = 0 -> [{{x := 1; ++ x := 2;}^@}^@] x = 1",
        "twice the other player is the first one",
        polynomial=False,
    ),
    Trap(
        "a flow of the other player",
        "x = 0 -> [{x' = 1 & x >= 1}^@] x = 0",
        "the other player has no flow and loses",
        polynomial=False,
    ),
    Trap(
        "an input of the other player",
        "x = 0 -> [{x := *;}^@ y := *;] x = y",
        "y is chosen last, by the other side",
        argument="whatever x is, y may be x + 1",
        polynomial=False,
    ),
    Trap(
        "an iteration of the other player",
        "x = 0 -> [{x := x + 1;}×] x = -1",
        "no number of iterations makes x negative",
        argument="x is the number of iterations, which is at least 0",
        polynomial=False,
    ),
)

CONTROL = (
    Trap(
        "an if without else",
        "y = 0 -> [if (x > 0) {y := 1;}] y = 1",
        "where x is 0 nothing happens",
        decisions=[R],
    ),
    Trap(
        "an else of the inner if",
        "x = 1 & y = 0 & z = 0 -> [if (x > 0) {if (z > 0) {y := 1;} else {y := 2;}}] y = 1",
        "the inner condition is false",
        state={"x": 1},
        decisions=[L, R],
    ),
    Trap(
        "a guard that is too weak",
        "x >= 0 -> [{{?x >= 0; x := x - 1; ++ x := x + 1;}}*@invariant(x >= 0)] x >= 0",
        "from 0 it goes to -1",
        decisions=once(L),
    ),
    Trap(
        "a guard about another variable",
        "x = 0 & y = 5 -> [{?y >= 1; x := x - 1;}*@invariant(x >= 0)] x >= 0",
        "y stays 5",
        state={"y": 5},
        decisions=once(),
    ),
    Trap(
        "a test after the change",
        "x = 0 -> [{x := x + 1; ?x <= 3;}*@invariant(x <= 3)] x < 3",
        "three iterations pass",
        decisions=times(3),
    ),
    Trap(
        "an input between two tests",
        "x = 1 -> [?x >= 1; x := *; ?x >= 0;] x >= 1",
        "the first test is about the old x",
        state={"x": 1},
        decisions=[Fraction(1, 2)],
    ),
    Trap(
        "a program that is called twice",
        "x = 1 -> [double; double;] x = 2",
        "it is executed twice",
        state={"x": 1},
        definitions="HP double ::= { x := 2*x; };",
    ),
)

BOUND = (
    Trap(
        "a bound value under a quantifier of the same name",
        "(\\forall x [y := x;] \\exists x (x > y)) -> [z := 1;] z = 2",
        "y is the x of the outer quantifier, the greater one that of the inner",
        argument="for every number there is a greater one, so that the assumption is true",
        polynomial=False,
    ),
    Trap(
        "a bound value under a quantifier of the same name, in a test",
        "x = 0 -> [z := 1; ?\\forall x [y := x;] \\exists x (x > y);] z = 2",
        "the test is passed: there is no greatest number",
        argument="for every number there is a greater one, so that the test is passed, and z is 1",
        polynomial=False,
    ),
    Trap(
        "an assignment to a differential in P",
        "x = 0 & !([x' := 5;] x = 5) -> [y := 1;] y = 2",
        "`x' := 5` does not change x",
        argument="x is 0 after x' := 5, so that the assumption is true, and y is 1",
        polynomial=False,
    ),
    Trap(
        "a quantified domain of an assumption about runs",
        "x = 0 & y = 1 & z >= 0 & z = 100 & [{x' = 1 & \\exists t (t/y = 1 & x <= 1)}] x <= 3"
        " -> [x := 10;] x = 11",
        "the assumption is about runs inside of its domain, up to x = 1",
        argument="t = 1 satisfies t/1 = 1, so that the domain is x <= 1, and 1 <= 3",
        polynomial=False,
    ),
)

CALLS = (
    Trap(
        "the earlier value of a loop that is called twice",
        "x = 0 -> [a; x := -1; a;] 2*x >= -1",
        "the second loop begins at -1",
        decisions=[STOP, STOP],
        definitions="HP a ::= { {x := x + 1;}*@invariant(x >= old(x)) };",
    ),
    Trap(
        "the earlier value of a loop that is called in a loop",
        "x = 0 -> [{a; x := x - 1;}*@invariant(x >= old(x))] x >= 0",
        "the loop inside may run not at all",
        decisions=once(STOP),
        definitions="HP a ::= { {x := x + 1;}*@invariant(x >= old(x)) };",
    ),
    Trap(
        "an argument under a quantifier of the same name",
        "x = 5 -> [x := 1;] p(x)",
        "the argument is 1",
        argument="the only number that is 1 is not above 2",
        polynomial=False,
        definitions="Bool p(Real y) <-> \\exists x (x = y & x > 2);",
    ),
    Trap(
        "a condition or a program",
        "x = 1 -> (!(x = 1) | [x := 2;] x = 1)",
        "the condition is false, and the program ends at 2",
        argument="x is 1, then 2",
        polynomial=False,
    ),
    Trap(
        "programs on both sides of an equivalence",
        "x = 0 -> ([x := 1;] x = 1 <-> [x := 2;] x = 1)",
        "the left side is true, the right one is not",
        argument="x is 1 after the left program, 2 after the right one",
        polynomial=False,
    ),
    Trap(
        "a state that some run reaches",
        "(<{x' = 1 & x <= 2}> x = 2) -> [y := x;] y = 2",
        "the assumption is about the end of a run",
        argument="from x = 0 a run reaches 2, and y is 0",
        polynomial=False,
    ),
)

TRAPS = CALLS + BOUND + NAMES + IMPLICATIONS + MODALITIES + GAMES + CONTROL
