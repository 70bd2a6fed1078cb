"""Random models made harder to follow: domains of any form, motion of higher degree, watches along flows."""

from dataclasses import replace
from fractions import Fraction
from random import Random

from generators.random_models import ORDERS, grid, random_model, random_program, variable
from generators.random_slack import relaxations

from dl2c.ir.logic import conjunction, disjunction
from dl2c.ir.model import (
    ZERO,
    Add,
    Call,
    Compare,
    Flow,
    Formula,
    Model,
    Mul,
    Number,
    Pow,
    Predicate,
    Sub,
    Symbol,
    Term,
    Trigger,
)


def wild_model(seed: int) -> Model:
    """Model number `seed` with its flows and predicates exchanged for wilder ones."""
    rng = Random(f"wild {seed}")
    model = random_model(seed)
    flows = tuple(_flow(rng, f) for f in model.flows)
    return replace(
        replace(model, flows=flows),
        name=f"wild{seed}",
        predicates=tuple(_predicate(rng, k, model) for k in range(rng.randint(1, 3))),
        continuous=rng.random() < 0.8,
    )


def wild_program(seed: int) -> Model:
    """Program number `seed` with wild flows, durations that somebody decides, and watches."""
    rng = Random(f"wild program {seed}")
    model = random_program(seed)
    duration = rng.choice(("max", "sample", "sample", "agent", "agent"))
    flows = tuple(
        replace(_flow(rng, f), drawn=duration == "sample" or rng.random() < 0.2) for f in model.flows
    )
    return replace(
        replace(model, flows=flows),
        name=f"wildprogram{seed}",
        predicates=tuple(_predicate(rng, k, model) for k in range(rng.randint(1, 3))),
        continuous=rng.random() < 0.8,
        duration=duration,
    )


def _flow(rng: Random, flow: Flow) -> Flow:
    moves = dict(flow.equations)
    if rng.random() < 0.5 and "x" in moves and "z" not in moves:
        moves["z"] = rng.choice((Number(grid(rng)), Symbol("c", "constant"), ZERO))
        moves["y"] = rng.choice((variable("z"), Mul(variable("z"), Number(Fraction(2)))))
        moves["x"] = rng.choice((variable("y"), Mul(variable("y"), variable("z"))))
    watched = _formula(rng, 2) if rng.random() < 0.8 else flow.watched
    clocks = [Compare("<=", variable(h.clock), h.bound) for h in flow.horizons]
    return replace(
        flow, equations=tuple(moves.items()), watched=watched, domain=conjunction([*clocks, watched])
    )


def _formula(rng: Random, depth: int) -> Formula:
    r = rng.random()
    if depth == 0 or r < 0.4:
        return _atom(rng)
    parts = [_formula(rng, depth - 1) for _ in range(rng.randint(2, 3))]
    return disjunction(parts) if r < 0.75 else conjunction(parts)


def _atom(rng: Random) -> Formula:
    """Conditions that many states satisfy and that motion often leaves, also with kinks."""
    x, y, z = variable("x"), variable("y"), variable("z")
    left: Term = rng.choice(
        (
            *(x, y, z, Add(x, y), Sub(x, y), Mul(x, y), Pow(x, 2), Pow(y, 3)),
            *(Call("abs", (x,)), Call("abs", (Sub(x, y),)), Call("min", (x, y)), Call("max", (y, z))),
            *(Add(Call("abs", (x,)), Call("abs", (y,))), Mul(x, Call("abs", (y,)))),
        )
    )
    op = rng.choice(("!=", "=", *ORDERS)) if rng.random() < 0.3 else rng.choice(ORDERS)
    limit = Fraction(rng.randint(1, 12), 2) if op in ("<", "<=") else Fraction(-rng.randint(0, 12), 2)
    return Compare(op, left, Number(limit if rng.random() < 0.8 else grid(rng)))


def _predicate(rng: Random, k: int, model: Model) -> Predicate:
    formula = _formula(rng, 1)
    category = rng.choice(("safety", "safety", "progress", "stability"))
    triggers = [
        Trigger(rng.choice(("terminate", "truncate", "continue")), rng.choice(("success", "failure", "none")))
        if rng.random() < 0.7
        else None
        for _ in range(2)
    ]
    due = _formula(rng, 1) if category == "progress" and rng.random() < 0.7 else None
    kind = rng.random()
    tolerance = model.tolerance if kind < 0.4 else Fraction(1, 8) if kind < 0.7 else Fraction(0)
    return Predicate(
        f"w{k}q",
        category,
        formula,
        reward=Number(Fraction(1)),
        penalty=Number(Fraction(-2)),
        on_success=triggers[0],
        on_failure=triggers[1],
        due=due,
        **relaxations(f"w{k}q", formula, tolerance),
    )
