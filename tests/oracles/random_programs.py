"""Random small programs, predicates about them and options, with numbers that doubles hold exactly."""

from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Any

from oracles.run_enumeration import Rules
from oracles.small_programs import (
    TRUE,
    Assign,
    Atom,
    Both,
    Choice,
    Either,
    Ending,
    Flow,
    Formula,
    If,
    Negation,
    Predicate,
    Problem,
    Program,
    Statement,
    Term,
    Test,
    number,
    variable,
)

VARIABLES = ("x", "y", "v", "t", "n")
PLACES = ("x", "y", "v", "n")
ONE = number(1)


@dataclass(frozen=True)
class Trial:
    problem: Problem
    rules: Rules
    options: dict[str, Any]
    """What differs from the defaults, for dl2c."""

    def __str__(self) -> str:
        return f"{self.problem}options: {self.options}"


@dataclass
class Writer:
    random: Random
    choices: int = 0

    def quarter(self, low: int = -3, up: int = 3, of: int = 4) -> Fraction:
        return Fraction(self.random.randint(low * of, up * of), of)

    def pick(self, *options: Any) -> Any:
        return self.random.choice(options)

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    # Formulas --------------------------------------------------------------------

    def term(self) -> Term:
        if self.chance(0.75):
            return variable(self.pick(*PLACES))
        first, second = self.random.sample(PLACES, 2)
        return Term(
            ((Fraction(1), first, 1), (self.pick(Fraction(1), Fraction(-1), Fraction(1, 2)), second, 1))
        )

    def atom(self, *ops: str) -> Atom:
        return Atom(self.term(), self.pick(*(ops or ("<=", ">=", "<", ">"))), number(self.quarter(of=8)))

    def formula(self, depth: int = 2) -> Formula:
        if depth == 0 or self.chance(0.55):
            return self.atom("<=", ">=", "<", ">", "<=", ">=", "<", ">", "!=")
        match self.random.randrange(5):
            case 0 | 1:
                return Both((self.formula(depth - 1), self.formula(depth - 1)))
            case 2 | 3:
                return Either((self.formula(depth - 1), self.formula(depth - 1)))
            case _:
                return Negation(self.formula(depth - 1))

    # Programs --------------------------------------------------------------------

    def assign(self) -> Assign:
        name = self.pick(*PLACES)
        value = self.pick(
            number(self.quarter()),
            number(self.quarter()),
            Term(((Fraction(1), name, 1), (self.pick(Fraction(1, 2), Fraction(-1, 2), Fraction(1)), "", 0))),
            Term(((Fraction(-1), name, 1),)),
            Term(((Fraction(1, 2), self.pick(*PLACES), 1), (self.quarter(-1, 1), "", 0))),
        )
        return Assign(name, value)

    def flow(self, clocked: bool) -> Program:
        k = self.pick(*map(Fraction, ("-2", "-1", "-1/2", "1/2", "1", "2")))
        m = self.pick(*map(Fraction, ("-1", "-1/4", "1/2", "1")))
        equations = self.pick(
            (("x", variable("v")), ("v", number(k))),
            (("x", variable("v")), ("v", number(k)), ("y", number(m))),
            (("x", variable("v")), ("y", number(m))),
            (("x", number(k)), ("y", number(m))),
            (("y", number(m)),),
        )
        domain: list[Formula] = []
        if self.chance(0.5):
            domain.append(self.domain_atom())
        if self.chance(0.15):
            domain.append(Either((self.domain_atom(), self.domain_atom())))
        if not clocked:
            if not domain:
                domain.append(self.domain_atom())
            return (Flow(equations, tuple(domain)),)
        limit = self.pick(*map(Fraction, ("1/2", "1", "1", "2", "3/2")))
        domain.insert(self.random.randint(0, len(domain)), Atom(variable("t"), "<=", number(limit)))
        start = number(0) if self.chance(0.9) else number(limit / 2)
        return Assign("t", start), Flow((*equations, ("t", ONE)), tuple(domain))

    def domain_atom(self) -> Atom:
        far = self.random.randint(0, 2)
        low, up = self.quarter(-5 - far, -1), self.quarter(1, 5 + far)
        name = self.pick("x", "y", "v")
        return self.pick(
            Atom(variable(name), "<=", number(up)),
            Atom(variable(name), ">=", number(low)),
            Atom(variable(name), "<", number(up)),
            Atom(variable(name), "!=", number(up)),
            Atom(variable("v"), ">=", number(0)),
        )

    def choice(self, depth: int) -> Choice:
        place = self.choices
        self.choices += 1
        alternatives: list[Program] = []
        for _ in range(self.pick(2, 2, 3)):
            program: list[Statement] = [Test(self.atom("<=", ">="))] if self.chance(0.45) else []
            program.append(self.assign())
            if self.chance(0.35):
                program += self.flow(True)
            if depth and self.chance(0.2):
                program.append(self.choice(0))
            if self.chance(0.2):
                program.append(self.assign())
            alternatives.append(tuple(program))
        return Choice(place, tuple(alternatives))

    def branch(self) -> If:
        def inner() -> Program:
            return self.flow(True) if self.chance(0.5) else (self.assign(),)

        return If(self.formula(1), inner(), inner() if self.chance(0.6) else ())

    def body(self, loop: bool) -> Program:
        program: list[Statement] = []
        for _ in range(self.pick(1, 1, 2, 2, 3)):
            match self.random.randrange(6):
                case 0 | 1:
                    program.append(self.choice(1))
                case 2:
                    program.append(self.branch())
                case 3:
                    program.append(Test(self.atom()))
                case _:
                    program.append(self.assign())
            program += self.flow(self.chance(0.85 if loop else 0.6))
        match self.random.randrange(6):
            case 0:
                program.append(self.assign())
            case 1:
                program.append(Test(self.formula(1)))
            case 2:
                program.append(self.choice(0))
            case _:
                pass
        return tuple(program)

    # Predicates ------------------------------------------------------------------

    def ending(self, *statuses: str) -> Ending:
        return Ending(self.pick("terminate", "truncate", "continue"), self.pick(*statuses))

    def worth(self, sign: int) -> Term | None:
        if self.chance(0.2):
            return None
        size = Fraction(self.random.randint(1, 40), 8)
        return Term(((sign * size, "", 0), *(((Fraction(1, 8), "x", 1),) if self.chance(0.3) else ())))

    def predicate(self, name: str, others: list[str]) -> Predicate:
        category = self.pick("safety", "safety", "progress", "stability")
        shape: Term | str | None = None
        if self.chance(0.3):
            shape = self.pick(Term(((Fraction(-1, 4), "y", 1),)), self.pick(name, *others))
        condition = self.formula()
        if category == "safety" and self.chance(0.7):
            condition = Either((condition, self.atom("<=", ">=")))
        made = Predicate(
            name,
            category,
            condition,
            self.worth(1),
            self.worth(-1),
            shape,
            self.ending("success", "success", "none") if self.chance(0.35) else None,
        )
        if not self.chance(0.75 if category == "safety" else 0.4):
            return made
        failure = self.ending("failure", "failure", "none", "success")
        if category != "progress":
            return replaced(made, on_failure=failure)
        return self.obliged(
            replaced(made, on_failure=Ending(self.pick("terminate", "truncate"), failure.status))
        )

    def obliged(self, made: Predicate) -> Predicate:
        if self.chance(0.3):
            return made
        one = Atom(variable(self.pick("t", "x")), self.pick(">=", ">"), number(self.quarter(0, 1)))
        other = self.atom("<=", ">=")
        match self.random.randrange(3):
            case 0:
                return replaced(made, due=(one,), due_text=f"{one} -> {made.name}")
            case 1:
                return replaced(made, due=(one,), due_text=f"!({one}) | {made.name}")
            case _:
                text = f"{one} -> ({other} -> {made.name})"
                return replaced(made, due=(Both((one, other)),), due_text=text)

    def trial(self) -> Trial:
        loop = self.chance(0.75)
        body = self.body(loop)
        names = [f"p{k}_" for k in range(self.pick(0, 1, 2, 2, 3, 4))]
        predicates = tuple(self.predicate(name, names) for name in names)
        extra = self.formula() if not names or self.chance(0.2) else TRUE
        options: dict[str, Any] = {"default_bound": "-100:100"}
        rules: dict[str, Any] = {}
        if self.chance(0.5):
            options["tolerance"], rules["tolerance"] = 0, Fraction(0)
        if self.chance(0.4):
            options["safety_check"] = rules["safety_check"] = self.pick("flows", "step")
        if self.chance(0.5):
            options["on_blocked"] = rules["on_blocked"] = self.pick("terminate", "truncate")
        if self.chance(0.4):
            options["blocked_penalty"], rules["blocked_penalty"] = -0.5, Fraction(-1, 2)
        if self.chance(0.2):
            options["dt"], rules["dt"] = 0.75, Fraction(3, 4)
        if self.chance(0.3):
            options["max_episode_steps"] = rules["max_episode_steps"] = self.pick(2, 3)
        return Trial(Problem(VARIABLES, body, loop, predicates, extra), Rules(**rules), options)


def replaced(made: Predicate, **changes: Any) -> Predicate:
    return Predicate(**(vars(made) | changes))


def draw_trial(seed: int, place: int) -> Trial:
    return Writer(Random(f"{seed} {place}")).trial()


def draw_state(random: Random) -> dict[str, Fraction]:
    return {name: Fraction(random.randint(-12, 12), 4) for name in VARIABLES}
