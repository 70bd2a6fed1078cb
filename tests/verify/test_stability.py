"""Theorems about stability: witnesses are found, and nothing false is proved with them."""

from random import Random

import pytest
from selection import few_and_many, quick_among, quick_rows

from dl2c.options import Options
from dl2c.parse.printer import print_formula
from dl2c.source import Source
from dl2c.verify.prove import Limits, prove
from dl2c.verify.report import Report
from dl2c.verify.stability.guesses import guesses
from dl2c.verify.theorem import theorem_in

STABLE = (
    r"\forall eps (eps > 0 -> \exists del (del > 0 & \forall x \forall y"
    r" (x^2 + y^2 < del^2 -> [{%s}*] x^2 + y^2 < eps^2)))"
)
ATTRACTED = (
    r"\forall del (del > 0 -> \forall eps (eps > 0 -> \exists T (T >= 0 & \forall x \forall y"
    r" (x^2 + y^2 < del^2 -> [t := 0; {%s}*] (t >= T -> x^2 + y^2 < eps^2)))))"
)
LOOP, ATTRACTED_LOOP = (claim.replace("{%s}*", "%s") for claim in (STABLE, ATTRACTED))
FALLING = "{x' = -x + y, y' = -x - 2*y, t' = 1} ++ {x' = -3*x, y' = -y, t' = 1}"
TURNING = "{x' = -y, y' = x, t' = 1}"
HALVES = (
    "{x' = -x/8 - y, y' = 2*x - y/8, t' = 1 & x >= 0} ++ {x' = -x/8 - 2*y, y' = x - y/8, t' = 1 & x <= 0}"
)
GROWING = "{x' = x/9, y' = -y, t' = 1}"
SPIRALS = """
  {s := 0; {u := 1; ++ u := 2;}}
  {
    {?u = 1; {?s >= %s; s := 0; u := 2; ++ u := u;} ++ ?u = 2; {?s >= %s; s := 0; u := 1; ++ u := u;}}
    {?u = 1; {x' = -x/10 - y, y' = 4*x - y/10, s' = 1, t' = 1}
     ++ ?u = 2; {x' = -x/10 - 4*y, y' = x - y/10, s' = 1, t' = 1}}
  }*
"""
"""Both modes fall, but switched too fast they grow: ellipses of 1:2 and 2:1, each factor 4 of V."""

PULSES = """
  {s := 0; {u := 1; ++ u := 2;}}
  {
    {?u = 1; {s := 0; u := 2; ++ u := u;} ++ ?u = 2; {?s >= %s; s := 0; u := 1; ++ u := u;}}
    {?u = 1; {x' = y, y' = x, s' = 1, t' = 1 & s <= %s}
     ++ ?u = 2; {x' = -x, y' = -y, s' = 1, t' = 1}}
  }*
"""
"""A mode that grows, for some time at most, and one that falls, for some time at least."""

CURVED = "{x' = -x + y^3, y' = -x - y, t' = 1}"
QUARTIC = "Real f(Real x, Real y) = x^2/2 + y^4/4;"
SLOW = "{x' = -x^3, y' = -y, t' = 1} ++ {x' = -x, y' = -y^3, t' = 1}"
NEARBY = "{x' = -x + x^3, y' = -y + x*y^2, t' = 1}"
ELLIPSES = "Real f(Real x, Real y) = 2*x^2 + y^2; Real g(Real x, Real y) = x^2/2 + y^2;"


def answer(problem: str, definitions: str = "", seconds: float = 60.0) -> Report:
    text = f'ArchiveEntry "S"\nDefinitions {definitions} End.\nProgramVariables Real x, y, t; End.\n'
    return prove(
        Source("s.kyx", f"{text}Problem {problem} End.\nEnd.\n"), Options(), Limits(10.0, seconds, 1)
    )


FOUND = [
    (STABLE % FALLING, ""),
    (ATTRACTED % FALLING, ""),
    (STABLE % TURNING, ""),
    (STABLE % HALVES, ELLIPSES),
    (ATTRACTED % HALVES, ELLIPSES),
    (STABLE.replace("{%s}*", "%s") % TURNING, ""),
    (LOOP % SPIRALS % (12, 12), ""),
    (ATTRACTED_LOOP % SPIRALS % (15, 15), ""),
    (LOOP % PULSES % ("1/2", "1/4"), ""),
    (ATTRACTED_LOOP % PULSES % ("1/2", "1/4"), ""),
    (STABLE % CURVED, QUARTIC),
    (ATTRACTED % CURVED, QUARTIC),
    (STABLE.replace("eps^2", "eps").replace("del^2", "del") % CURVED, QUARTIC),
    (ATTRACTED % SLOW, ""),
    (STABLE % NEARBY, ""),
    (r"\exists del (del > 0 -> \forall x (x < del -> [{x' = 1}] x < del))", ""),
]


@pytest.mark.parametrize(
    ("problem", "definitions"), quick_rows(FOUND, [*FOUND[:6], FOUND[8], FOUND[10], *FOUND[12:]])
)
def test_witnesses_are_found(problem: str, definitions: str) -> None:
    found = answer(problem, definitions)
    assert found.answer == "proved" and found.invented
    assert any(text.startswith(("del = ", "T = ")) for text in found.invariants)


def test_what_is_assumed_of_the_state_may_be_kept() -> None:
    inside = ATTRACTED.replace("< del^2 ->", "< del^2 & x >= abs(y) ->")
    found = answer(inside % "{x' = -x, y' = -3*y, t' = 1 & x >= 0}")
    assert found.answer == "proved"


def test_functions_stand_in_cuts_of_tactics() -> None:
    tactic = 'Tactic "T" cut("\\exists k (k>0&\\forall x \\forall y (x^2+y^2=eps^2->x^2/2+y^4/4>=k))") End.\n'
    text = 'ArchiveEntry "S"\nProgramVariables Real x, y, t; End.\n'
    source = Source("s.kyx", f"{text}Problem {STABLE % CURVED} End.\n{tactic}End.\n")
    assert prove(source, Options(), Limits(10.0, 60.0, 1)).answer == "proved"


def test_a_tactic_may_name_the_functions() -> None:
    listed = 'Tactic "T" stabilityStateMLF("2*x^2+y^2::x^2/2+y^2::nil") End.\n'
    text = 'ArchiveEntry "S"\nProgramVariables Real x, y, t; End.\n'
    source = Source("s.kyx", f"{text}Problem {STABLE % HALVES} End.\n{listed}End.\n")
    assert prove(source, Options(), Limits(10.0, 60.0, 1)).answer == "proved"


FALSE = [
    (STABLE % GROWING, ""),
    (ATTRACTED % GROWING, ""),
    (ATTRACTED % TURNING, ""),
    (STABLE % f"{FALLING} ++ {GROWING}", ""),
    (ATTRACTED % f"{FALLING} ++ {TURNING}", ""),
    (STABLE % HALVES.replace(" & x >= 0", "").replace(" & x <= 0", ""), ELLIPSES),  # switched at will
    (STABLE % f"{FALLING}; x := 2*x", ""),
    (
        ATTRACTED.replace("[t := 0;", "[t := 0; T := t - 1;") % FALLING,
        "",
    ),  # T is not the witness any more
    (ATTRACTED.replace("{%s}*", "{?t < 1; %s}*; x := x + 1") % FALLING, ""),
    (STABLE.replace("del > 0 &", "del > 2*eps &") % FALLING, ""),
    (STABLE.replace("eps > 0 ->", "eps >= 0 ->") % FALLING, ""),
    (ATTRACTED.replace("eps > 0 ->", "eps^2 >= 0 ->") % FALLING, ""),  # the witness divides by eps
    (LOOP % SPIRALS % (0, 0), ""),
    (LOOP % SPIRALS % (12, "0.3"), ""),
    (ATTRACTED_LOOP % SPIRALS % ("0.3", "0.3"), ""),
    (LOOP % PULSES % ("1/4", "1/2"), ""),
    (LOOP % PULSES.replace(" & s <= %s", "") % "1/2", ""),
    (ATTRACTED_LOOP % PULSES % ("1/4", "1/4"), ""),
    (
        LOOP % PULSES.replace("s := 0; u := 1;", "u := 1;") % ("1/2", "1/4"),
        QUARTIC,
    ),
    (STABLE % CURVED.replace("-x + y^3", "x + y^3"), QUARTIC),
    (ATTRACTED % SLOW.replace("-x^3", "x^3"), ""),
    (ATTRACTED % SLOW.replace("-x^3", "0"), ""),
    (ATTRACTED % NEARBY, ""),  # from far away it goes to infinity
    (STABLE.replace("\\exists del (del > 0 &", "\\exists del (del > 1 &") % NEARBY, ""),
    (r"\exists del (del > 0 & \forall x (x < del -> [{x' = 1}] x < del))", ""),
    (r"\exists x (x > 0 & [{x' = -1 & x >= -1}] x > 0)", ""),
    (r"\exists x \forall y (y > 0 -> [{y' = -1}] y > x)", ""),
]
"""For the slow ones, and some others, a witness is sought until the end of the time."""


@pytest.mark.parametrize(
    ("problem", "definitions"), quick_rows(FALSE, [*FALSE[:5], *FALSE[5:15:9], *FALSE[15:]])
)
def test_nothing_false_is_proved(problem: str, definitions: str) -> None:
    assert answer(problem, definitions, 4.0).answer not in ("proved", "proved-if-defined")


@pytest.mark.parametrize(
    "program",
    [
        "{x' = 1/x, y' = -y}",
        "{x' = y/(x - x), y' = -y}",
        "{x' = -x, y' = -y & x > 1 & x < 0}",
        "{x' = 1000000000000000000000000000000^11*x, y' = -y}",
        "{x' = 0, y' = 0}",
        "{x' = -x, y' = exp(x)}",
        "{?u = 1; {x' = -x, y' = -y, s' = 1 & s <= -1} ++ {x' = -x, y' = y, s' = 1} s := 0; u := 1;}",
        "{s := 0; {x' = -x, y' = -y, s' = 1 & s <= 1/0}}",
    ],
)
@pytest.mark.parametrize("claim", [STABLE, ATTRACTED])
def test_strange_systems_have_an_answer(claim: str, program: str) -> None:
    """Not one of them fails where numbers are estimated."""
    text = 'ArchiveEntry "S" ProgramVariables Real x, y, t, s, u; End.\n'
    source = Source("s.kyx", f"{text}Problem {claim % program} End.\nEnd.\n")
    assert prove(source, Options(), Limits(0.5, 1.5, 1)).answer in ("proved", "refuted", "unknown")


NORMS = ("x^2 - y^2", "x^3 + y^3", "x + y", "x^2 + y^2 - 1", "x^2*y^2", "0*x + y*0", "1", "x^4 + y^2")


@pytest.mark.parametrize("norm", quick_among(NORMS, {*NORMS} - {"x^2*y^2", "x^4 + y^2"}))
def test_strange_norms_have_an_answer(norm: str) -> None:
    for claim in (STABLE, ATTRACTED):
        problem = (claim % FALLING).replace("x^2 + y^2", norm)
        assert answer(problem, "", 1.5).answer in ("proved", "refuted", "unknown")


def random_term(rng: Random, depth: int) -> str:
    if not depth:
        return rng.choice(["x", "y", "s", "1", "2", "0", "(1/2)"])
    if rng.random() < 0.2:
        return f"({random_term(rng, depth - 1)})^{rng.choice('23')}"
    return f"({random_term(rng, depth - 1)} {rng.choice('+-**/')} {random_term(rng, depth - 1)})"


def random_claim(rng: Random) -> str:
    def mode() -> str:
        limit = rng.choice(["", " & s <= 1", " & x >= 0", " & s <= 1/0", f" & {random_term(rng, 1)} >= 0"])
        x, y = (random_term(rng, rng.randint(0, 2)) for _ in "xy")
        return f"{{x' = {x}, y' = {y}, s' = 1, t' = 1{limit}}}"

    waits = [rng.choice(["1", "0.5", "-1", "3/2"]) for _ in range(2)]
    jumps = [f"{{?s >= {w}; s := 0; u := {u}; ++ u := u;}}" for w, u in zip(waits, "21", strict=True)]
    timed = f"{{?u = 1; {jumps[0]} ++ ?u = 2; {jumps[1]}}} {{?u = 1; {mode()} ++ ?u = 2; {mode()}}}"
    norm = rng.choice(["x^2 + y^2", random_term(rng, 2), "x^4 + y^2", "x^2", "x^2 - y^2"])
    claim = rng.choice([STABLE, ATTRACTED]).replace("x^2 + y^2", norm)
    return claim % rng.choice([mode(), f"{mode()} ++ {mode()}", timed])


@pytest.mark.parametrize("claims", few_and_many(50, 200))
def test_random_claims_have_guesses_that_can_be_written(claims: int) -> None:
    """Whatever a claim is about, numbers are estimated or not, without a failure."""
    rng = Random(20261126)
    count = 0
    for _ in range(claims):
        function = random_term(rng, 2).replace("s", "x")
        head = f'ArchiveEntry "S" Definitions Real f(Real x, Real y) = {function}; End.'
        text = f"{head} ProgramVariables Real x, y, t, s, u; End. Problem {random_claim(rng)} End. End."
        for guess in guesses(theorem_in(Source("s.kyx", text), Options())):
            count += len([print_formula(f) for parts in guess.values() for f in parts])
    assert count > claims / 10
