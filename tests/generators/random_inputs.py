"""Random models whose inputs are tested in every way that can be resolved: squares, disjunctions,
equalities, kinks, several inputs together."""

from dataclasses import replace
from fractions import Fraction
from random import Random

from generators.random_models import CLOCK, ORDERS, Builder, finished, grid, variable

from dl2c.ir.logic import conjunction, disjunction
from dl2c.ir.model import (
    ONE,
    Add,
    Alternative,
    Assign,
    AssignAny,
    Call,
    Choice,
    Compare,
    Div,
    Formula,
    Model,
    Mul,
    Number,
    Pow,
    Role,
    Statement,
    Sub,
    Symbol,
    Term,
    Test,
)
from dl2c.lower.leading import leading

NAMES = ("u", "z", "y")


def input_term(rng: Random, name: str, others: tuple[str, ...]) -> Term:
    """A term of degree 1 or 2 in an input, with others as coefficients."""
    u, s = variable(name), rng.choice([*map(variable, others), Symbol("c", "constant"), Number(grid(rng))])
    return rng.choice(
        (
            *(u, u, Add(u, s), Sub(s, u), Mul(s, u), Mul(u, s), Add(Mul(Number(Fraction(3)), u), s)),
            *(Pow(u, 2), Add(Mul(u, u), Mul(s, u)), Sub(Pow(u, 2), Pow(s, 2)), Pow(Sub(u, s), 2)),
            *(Call("abs", (Sub(u, s),)), Call("max", (u, s)), Call("min", (Mul(u, s), s))),
            *(Div(u, s), Div(s, u), Mul(u, Call("abs", (s,)))),
        )
    )


def input_test(rng: Random, name: str, others: tuple[str, ...], depth: int = 2) -> Formula:
    """Comparisons of such terms, joined."""
    r = rng.random()
    if depth > 0 and r < 0.55:
        parts = [input_test(rng, name, others, depth - 1) for _ in range(2)]
        return conjunction(parts) if r < 0.3 else disjunction(parts)
    right: Term = rng.choice(
        (Number(grid(rng)), Number(grid(rng)), *map(variable, others), Symbol("c", "constant"))
    )
    op = rng.choice(ORDERS) if rng.random() < 0.75 else rng.choice(("=", "=", "!="))
    return Compare(op, input_term(rng, name, others), right)


def random_unions(seed: int) -> Model:
    """Model number `seed`: one to three inputs, in an alternative of a choice or not, then perhaps a flow."""
    rng = Random(f"unions {seed}")
    builder = Builder(rng)
    given: list[Statement] = []
    for k, name in enumerate(NAMES[: rng.choice((1, 1, 1, 2, 2, 3))]):
        role: Role = "env" if rng.random() < 0.2 else "agent"
        given.append(AssignAny(name, f"assign_{name}", role))
        earlier = NAMES[:k] if rng.random() < 0.6 else ()
        given.append(Test(input_test(rng, name, ("x", *earlier), rng.choice((0, 1, 2)))))
        if rng.random() < 0.3:
            given.append(Assign("x", Add(variable("x"), variable(name))))
    flow = [builder.flow()] if rng.random() < 0.4 else []
    body: tuple[Statement, ...] = (Assign(CLOCK, Number(Fraction(0))), *given, *flow)
    if rng.random() < 0.6:
        other = Alternative((Test(builder.compare(0, ORDERS)), Assign("x", Sub(variable("x"), ONE))), False)
        body = (Choice("choice_0", (Alternative(body, False), other)),)
    lead, rest = leading(body)
    return replace(finished(builder, f"unions{seed}", rest), lead=lead)
