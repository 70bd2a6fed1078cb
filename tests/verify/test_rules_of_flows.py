"""Rules for differential equations one by one: what they prove, and what they must not."""

import time
from collections.abc import Generator
from fractions import Fraction

import pytest
from selection import quick_among

from dl2c.ir.logic import conjuncts, negation
from dl2c.ir.model import ONE, TRUE, ZERO, Compare, Formula, Symbol, Term, Truth
from dl2c.lower.terms import lower_formula, lower_term
from dl2c.options import Options
from dl2c.parse.parser import parse_archive, parse_formula, parse_program, parse_term
from dl2c.parse.printer import print_formula as print_tree
from dl2c.parse.printer import print_program
from dl2c.parse.tree import And, Box, Diamond, ODESystem
from dl2c.smt.portfolio import Portfolio
from dl2c.source import Source
from dl2c.verify.arithmetic.cases import Signs
from dl2c.verify.arithmetic.polynomials import Ring, reduced
from dl2c.verify.arithmetic.products import scripts
from dl2c.verify.arithmetic.prover import Prover
from dl2c.verify.arithmetic.quotients import cleared, positive_symbols
from dl2c.verify.arithmetic.total import totalised, without_cases
from dl2c.verify.field import Field
from dl2c.verify.flows import Flows
from dl2c.verify.invariance import Chains, Invariance
from dl2c.verify.invention import invented
from dl2c.verify.motion import facts_until_now
from dl2c.verify.prove import Limits, prove
from dl2c.verify.states import Names, State, evaluated
from dl2c.verify.theorem import loops_of, theorem_of

SCOPE = {name: Symbol(name, "variable") for name in ("x", "y", "z", "u", "a", "b")}


@pytest.fixture(scope="module")
def portfolio() -> Generator[Portfolio]:
    with Portfolio(2) as found:
        yield found


@pytest.fixture
def prover(portfolio: Portfolio) -> Prover:
    return Prover(portfolio, 5.0, time.monotonic() + 60.0)


def formula(text: str) -> Formula:
    return lower_formula(parse_formula(text), SCOPE)


def term(text: str) -> Term:
    return lower_term(parse_term(text), SCOPE)


def field_of(**rates: str) -> Field:
    return Field({SCOPE[x]: term(rate) for x, rate in rates.items()}, Names(), lambda _: False)


KEPT = [
    ("dI", {"x": "1"}, "true", "x >= 0"),
    ("dI", {"x": "-y", "y": "x"}, "true", "x^2 + y^2 = 1"),
    ("dI", {"x": "x^2"}, "true", "x > 3"),
    ("dbx", {"x": "-x"}, "true", "x > 0"),
    ("dbx", {"x": "x*y", "y": "1"}, "true", "x = 0"),
    ("dbx", {"x": "y - x", "y": "0"}, "y >= 0", "x >= 0"),
    ("barrier", {"x": "y", "y": "1"}, "x != 0 | y >= 1", "x > 0"),
    ("sAI", {"x": "y", "y": "1"}, "x != 0 | y >= 0", "x >= 0"),
    ("sAI", {"x": "-y", "y": "x"}, "true", "x^2 + y^2 = 1 & x^2 >= 0 | x^2 + y^2 = 4"),
]

NOT_KEPT = [
    ({"x": "1"}, "true", "x <= 0"),
    ({"x": "1"}, "true", "x = 0"),
    ({"x": "1"}, "true", "x^2 <= 0"),
    ({"x": "1"}, "true", "x != 1"),
    ({"x": "-1"}, "true", "x > 0"),
    ({"x": "-y", "y": "x"}, "true", "x >= 0"),
    ({"x": "-x + y", "y": "0"}, "true", "x > 0"),
    ({"x": "y", "y": "-1"}, "true", "x >= 0 & y <= 5"),
    ({"x": "-1"}, "x >= 0 | y > 0", "x >= 0"),
    ({"x": "1", "y": "1"}, "true", "x <= 0 & y <= 0"),
    ({"x": "x - 1"}, "true", "x <= 1 & x >= 0"),
]


@pytest.mark.parametrize(("rule", "rates", "domain", "text"), KEPT)
def test_what_stays_true(rule: str, rates: dict[str, str], domain: str, text: str, prover: Prover) -> None:
    one = Invariance(field_of(**rates), formula(domain), prover)
    assert one.keeps(formula(text), [formula(domain)])
    assert rule in one.rules


@pytest.mark.parametrize(("rates", "domain", "text"), NOT_KEPT)
def test_what_does_not(rates: dict[str, str], domain: str, text: str, prover: Prover) -> None:
    assert not Invariance(field_of(**rates), formula(domain), prover).keeps(formula(text), [formula(domain)])


def test_a_root_has_no_chains(prover: Prover) -> None:
    """x' = sqrt(x) leaves x = 0, though sqrt(0) is 0."""
    vectors = field_of(x="sqrt(x)")
    assert not vectors.smooth
    assert not Invariance(vectors, TRUE, prover).keeps(formula("x = 0"), [])
    assert Invariance(vectors, formula("x >= 0"), prover).keeps(formula("x >= 0"), [formula("x >= 0")])


def test_a_divisor_must_be_nonzero(prover: Prover) -> None:
    open_field = field_of(x="1/y", y="0")
    assert not open_field.smooth
    closed = Field({SCOPE["x"]: term("1/y"), SCOPE["y"]: ZERO}, Names(), lambda _: True)
    assert closed.smooth
    assert Invariance(closed, TRUE, prover).keeps(formula("x >= 0"), [formula("y > 0")])


def test_functions_of_what_moves_are_tied(prover: Prover) -> None:
    vectors = field_of(x="y", y="-sin(x)")
    assert Invariance(vectors, TRUE, prover).keeps(formula("y^2/2 - cos(x) <= z"), [])
    assert not Invariance(vectors, TRUE, prover).keeps(formula("y^2/2 + cos(x) <= z"), [])


def test_chains_say_where_a_motion_enters() -> None:
    """Of x' = 1, y' = 2*x at the origin: y >= x^2 holds ahead, y > x^2 does not, x < 0 holds behind."""
    vectors = field_of(x="1", y="2*x")
    origin = {SCOPE[n]: ZERO for n in ("x", "y")}
    for text, direction, expected in (
        ("y >= x^2", 1, True),
        ("y > x^2", 1, False),
        ("x < 0", -1, True),
        ("x < 0", 1, False),
        ("x != 0", 1, True),
        ("y = 0", 1, False),
    ):
        plain = vectors.formula(formula(text))
        for over in (False, True):
            entered = Chains(vectors, vectors.ring(plain)).entered(plain, direction, over)
            assert evaluated(entered, origin) == Truth(expected), text


def test_conserved_forms_are_invented() -> None:
    vectors = field_of(x="y", y="-a*x")
    clock = Symbol("time", "variable")
    vectors.rates[clock] = ONE
    start = {SCOPE["x"]: SCOPE["u"], SCOPE["y"]: SCOPE["z"], clock: ZERO}
    found = [f for f in invented(vectors, start, clock, {}) if f == TRUE or "=" in str(f)]
    ring = Ring(tuple(SCOPE.values()))
    energies = [f for f in found if getattr(f, "op", "") == "=" and getattr(f, "right", ZERO) != ZERO]
    forms = {str(ring.polynomial(f.left)) for f in energies if not isinstance(f, Truth)}  # type: ignore[union-attr]
    energy = ring.polynomial(term("a*x^2 + y^2"))
    assert str(energy) in forms or str(-energy) in forms


def test_divisions_end_where_numbers_become_too_long() -> None:
    ring = Ring((SCOPE["x"],))
    x = ring.polynomial(term("x"))
    divisor = 2 * x - 1
    assert reduced(x**100, [divisor]) == ring.number(Fraction(1, 2**100))
    assert reduced(x**20000, [divisor]) is None
    assert not ring.in_ideal(x**20000, [divisor])
    assert ring.in_ideal(x**20000 * divisor, [divisor])


MOTIONS = {
    "a direction": (
        "v >= 0 & a >= 0 & dx^2 + dy^2 = 1 & x = 0 & t = 0 & u > v*k + a/2*k^2 ->"
        " [{x' = v*dx, v' = a, dx' = -w*dy, dy' = w*dx, t' = 1 & t <= k}] x < u"
    ),
    "no faster than its source": (
        "x >= 0 & a >= 0 & u > x + a*k & t = 0 -> [{x' = a - w^2*x^3, t' = 1 & x >= 0 & t <= k}] x < u"
    ),
    "at least as fast": (
        "x >= 0 & a >= 0 & u < x + a*k & t = 0 -> [{x' = a + x^3, t' = 1 & x >= 0}] (t >= k -> x > u)"
    ),
}
FALSE_MOTIONS = {
    "too little": MOTIONS["a direction"].replace("a/2*k^2", "a/3*k^2"),
    "no direction": MOTIONS["a direction"].replace("dx^2 + dy^2 = 1", "dx^2 + dy^2 = 2"),
    "a negative speed": MOTIONS["a direction"].replace("v >= 0 & ", ""),
    "the other side": MOTIONS["no faster than its source"].replace("- w^2*x^3", "+ w^2*x^3"),
    "no domain": MOTIONS["at least as fast"].replace(" & x >= 0}", "}").replace("x >= 0 & ", ""),
}


def motion_answer(problem: str, seconds: float) -> str:
    names = "Real x, v, a, dx, dy, w, t, u, k;"
    text = f'ArchiveEntry "M" ProgramVariables {names} End. Problem {problem} End. End.'
    return prove(Source("m.kyx", text), Options(), Limits(5.0, seconds, 1)).answer


@pytest.mark.parametrize("which", quick_among(MOTIONS, MOTIONS.keys() - {"a direction"}))
def test_how_far_a_motion_may_come(which: str) -> None:
    assert motion_answer(MOTIONS[which], 40.0) == "proved"


@pytest.mark.parametrize("which", quick_among(FALSE_MOTIONS, ("a negative speed", "no domain")))
def test_a_motion_may_come_further(which: str) -> None:
    assert motion_answer(FALSE_MOTIONS[which], 6.0) not in ("proved", "proved-if-defined")


def test_undefined_terms_are_any_number_and_make_goals_false(prover: Prover) -> None:
    assert not prover.valid([], formula("1/x = 1/x"))
    assert prover.valid([formula("x > 0")], formula("1/x > 0"))
    assert not prover.valid([formula("1/x > 0")], formula("x > 0"))
    prover.if_defined = True
    assert prover.valid([formula("1/x > 0")], formula("x > 0"))


def test_facts_of_functions_are_true() -> None:
    """Each fact holds of the functions at some arguments."""
    import math

    functions = {"sin": math.sin, "cos": math.cos, "exp": math.exp, "tanh": math.tanh, "arctan": math.atan}
    for name in functions:
        for value in (-3, -1, 0, 1, 2):
            given, _ = totalised([formula(f"{name}({value}) = y")], TRUE, if_defined=False)
            text = " ".join(map(str, given))
            assert name in text


def test_divisors_are_cleared_only_where_positive() -> None:
    plain = formula("x/a >= y")
    assert cleared(plain, positive_symbols([formula("a >= 0")])) == plain
    assert cleared(plain, positive_symbols([formula("a > 0")])) == formula("(-1)*a*y + x >= 0")


def test_terms_without_values_do_not_cancel() -> None:
    roots = formula("(sqrt(x) - sqrt(x) + y)/a >= 0")
    assert cleared(roots, positive_symbols([formula("a > 0")])) == roots
    partial, total = formula("max(1/x, y) >= y"), formula("max(x, y) >= y")
    assert without_cases(partial) == partial
    assert without_cases(total) != total


def test_a_case_that_does_not_move_is_assumed_away(prover: Prover) -> None:
    one = Invariance(field_of(x="a"), TRUE, prover)
    assert one.keeps(formula("a < 0 | x >= 0"), [])
    assert not one.keeps(formula("a > 0 | x >= 0"), [])


@pytest.mark.slow
def test_values_that_double_do_not_take_for_ever() -> None:
    text = "x := x*x + 1;" * 60
    model = f'ArchiveEntry "H"\nProgramVariables Real x; End.\nProblem x = 0 -> [{text}] x >= 0 End.\nEnd.\n'
    begun = time.monotonic()
    assert prove(Source("h.kyx", model), Options(), Limits(total=10.0)).answer in ("proved", "unknown")
    assert time.monotonic() - begun < 30


def test_a_universal_test_is_used_for_values_that_other_tests_name() -> None:
    def answer(problem: str) -> str:
        text = f'ArchiveEntry "U"\nProgramVariables Real x, y; End.\nProblem {problem} End.\nEnd.\n'
        return prove(Source("u.kyx", text), Options(), Limits(total=10.0)).answer

    test = "?\\forall z (z^5 + z > y -> z^3 + y > 1);"
    assert answer(f"true -> [{test} ?x^5 + x > y;] x^3 + y > 1") == "proved"
    assert answer(f"true -> [{test} ?x^5 + x > y; x := x - 1;] x^3 + y > 1") != "proved"


def test_a_sum_of_products_of_facts_shows_an_inequality() -> None:
    facts = "a + b >= 0 & b > 0 & y >= 0 & x >= y & u + a*x >= 0 & u + a*y >= 0 & z >= 0"
    goal = formula("(a + b)*(a*x^2/2 + x*(u + z)) >= (a + b)*(a*y^2/2 + y*(u + z))")
    known = [f for f in conjuncts(formula(facts)) if isinstance(f, Compare)]
    wrong = [*known, negation(goal)]
    names = set(SCOPE.values())

    def contradict(given: list[Formula]) -> bool:
        with Portfolio(1) as solvers:
            asked = scripts(given, names, 4, time.monotonic() + 20)
            return any(solvers.ask(text, 5.0, only="z3").verdict == "unsat" for text in asked)

    assert contradict(wrong)
    assert not contradict(known)
    assert not contradict([f for f in wrong if f != formula("x >= y")])


def test_cases_are_dropped_only_where_signs_decide_them() -> None:
    names = sorted(SCOPE.values(), key=str)
    facts = [formula(f) for f in ("x > 0", "x <= 0 | y >= 1", "2*x - 2 >= 0 | z = 0")]
    assert Signs(names).settled(facts) == [facts[0], formula("y >= 1"), facts[2]]
    assert Signs(names).settled([formula("x > y"), formula("2*y >= 2*x")]) is None
    assert Signs(names).settled([formula("x >= y"), formula("y >= x")]) is not None


def test_a_question_is_translated_once(prover: Prover, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Formula] = []

    def counted(hypotheses: list[Formula], goal: Formula, if_defined: bool) -> tuple[list[Formula], Formula]:
        seen.append(goal)
        return totalised(hypotheses, goal, if_defined)

    monkeypatch.setattr("dl2c.verify.arithmetic.prover.totalised", counted)
    assert prover.valid([formula("x > 1")], formula("x > 0")) and len(seen) == 1


def test_an_old_value_in_the_invariant_of_a_loop_is_that_before_it() -> None:
    text = (
        'ArchiveEntry "O"\nProgramVariables Real x, y; End.\n'
        "Problem x >= 0 -> [{y := x; {x := x + 2;}*@invariant(x >= old(x) & y = old(y))"
        "}*@invariant(x >= 0)] x >= 0\n"
        "End.\nEnd.\n"
    )
    assert prove(Source("o.kyx", text), Options(), Limits(total=10.0)).answer == "proved"
    changed = text.replace("x + 2", "x - 2")
    assert prove(Source("o.kyx", changed), Options(), Limits(total=10.0)).answer == "refuted"


def test_an_assumption_about_all_runs_is_used_for_a_run_of_the_same_shape() -> None:
    def answer(problem: str) -> str:
        text = f'ArchiveEntry "R"\nProgramVariables Real x, y, z, t; End.\nProblem {problem} End.\nEnd.\n'
        return prove(Source("r.kyx", text), Options(), Limits(total=10.0)).answer

    assert answer("true -> [?[y := *; ?y^5 + y > x;] y^3 > 1; z := *; ?z^5 + z > x;] z^3 > 1") == "proved"
    assert answer("true -> [?[y := *; ?y^5 + y > x;] y^3 > 1; z := *; ?z^5 + z > x - 1;] z^3 > 1") != "proved"
    motion = "{x' = z, t' = 1 & t <= 2}"
    assert answer(f"t = 0 -> [?[{motion}] x^5 + x <= y; {motion}] x^5 + x <= y") == "proved"
    longer = motion.replace("t <= 2", "t <= 3")
    assert answer(f"t = 0 -> [?[{motion}] x^5 + x <= y; {longer}] x^5 + x <= y") != "proved"


def test_a_guard_for_the_worst_case_is_used_at_every_instant() -> None:
    """The guard speaks of ep; a proof along a motion that is not solved needs the same of t."""

    def answer(guard: str, total: float) -> str:
        text = (
            'ArchiveEntry "G"\n'
            "Definitions Real ep; Real b; Real A; End.\n"
            "ProgramVariables Real x, y, v, dx, dy, w, t, o; End.\n"
            "Problem ep > 0 & b > 0 & A >= 0 & v >= 0 & dx^2 + dy^2 = 1 & abs(x - o) > v^2/(2*b)\n"
            f"  -> [?abs(x - o) > v^2/(2*b) + {guard}; w := *; t := 0;\n"
            "      {x' = v*dx, y' = v*dy, v' = A, dx' = -w*dy, dy' = w*dx, t' = 1 & t <= ep & v >= 0}\n"
            "        @invariant(dx^2 + dy^2 = 1, v = old(v) + A*t,\n"
            "        -t*(v - A/2*t) <= x - old(x) & x - old(x) <= t*(v - A/2*t))]\n"
            "     abs(x - o) > v^2/(2*b) End.\nEnd.\n"
        )
        return prove(Source("g.kyx", text), Options(), Limits(total=total)).answer

    assert answer("(A/b + 1)*(A/2*ep^2 + ep*v)", 40.0) == "proved"
    assert answer("(A/b + 1)*(A/2*ep^2)", 8.0) != "proved"


def test_facts_of_the_whole_time_are_said_of_the_time_that_has_passed(prover: Prover) -> None:
    box = parse_formula("[{x' = y, z' = 1 & z <= a & u >= b}] true")
    assert isinstance(box, Box) and isinstance(box.program, ODESystem)
    facts = [formula(f) for f in ("a > 0", "x + a*y + a^2 <= b | x > 2*a", "x <= y")]
    motion = Flows(prover).motion(box.program, State(SCOPE, tuple(facts)), Names())
    assert motion is not None
    clock = motion.moved["z"]
    wanted = lower_formula(parse_formula("x + t*y + t^2 <= b | x > 2*t"), SCOPE | {"t": clock})
    assert facts_until_now(motion) == [wanted]


def test_a_tactic_may_say_that_something_keeps_its_value() -> None:
    text = (
        'ArchiveEntry "C"\nProgramVariables Real x, y, u; End.\n'
        "Problem x^2 + y^2 = u -> [{x' = -y*(x + u), y' = x*(x + u)}] x^2 + y^2 = u End.\n"
        'Tactic "T" implyR(1); dC("x^2 + y^2 = const()", 1) End.\nEnd.\n'
    )
    theorem = theorem_of(parse_archive(Source("c.kyx", text))[0].entries[0], {})
    assert [print_tree(f) for f in theorem.hints.flows] == ["x^2 + y^2 = old(x^2 + y^2)"]


def test_loops_of_diamonds_need_no_invariant_unless_they_are_negated() -> None:
    found = loops_of(parse_formula("[{x := 1;}*](<{x := 2;}*> x > 0 & !<{x := 3;}*> x < 0)"))
    assert [print_program(loop.child) for loop in found] == ["x := 1;", "x := 3;"]


def test_a_loop_in_a_box_and_in_a_diamond_needs_an_invariant() -> None:
    loop, condition = parse_program("{x := x + 1;}*@invariant(x >= 0)"), parse_formula("x >= 0")
    assert list(loops_of(And(Box(loop, condition), Diamond(loop, condition)))) == [loop]
