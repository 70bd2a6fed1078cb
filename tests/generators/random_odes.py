"""Random ODEs with random domains and starts, several in one model: alternative k follows flow k."""

from dataclasses import dataclass
from fractions import Fraction
from random import Random
from typing import Literal

from generators.random_models import ORDERS, variable

from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.logic import atoms, conjunction, disjunction, number, symbols
from dl2c.ir.model import (
    ONE,
    TRUE,
    Add,
    Alternative,
    Bound,
    Call,
    Choice,
    Compare,
    Constant,
    Div,
    Evolve,
    Flow,
    Formula,
    Horizon,
    Model,
    Mul,
    Neg,
    Number,
    Pow,
    Sub,
    Symbol,
    Term,
    Variable,
)

VARIABLES = ("x", "y", "z")
X, Y, Z, T = (variable(name) for name in (*VARIABLES, "t"))
A, C, D = (Symbol(name, "constant") for name in ("a", "c", "d"))

Kind = Literal["nonlinear", "linear", "polynomial"]


def _half(rng: Random, span: int = 4) -> Number:
    return Number(Fraction(rng.randint(-span, span), 2))


def _nonlinear(rng: Random) -> dict[str, Term]:
    one, two = Number(Fraction(1)), Number(Fraction(2))
    return rng.choice(
        (
            {"x": Y, "y": Neg(Call("sin", (X,)))},
            {"x": Y, "y": Sub(Neg(Mul(A, Call("sin", (X,)))), Mul(Number(Fraction(1, 10)), Y)), "z": X},
            {"x": Mul(Z, Call("cos", (Y,))), "y": _half(rng), "z": _half(rng, 2)},
            {"x": Mul(X, Sub(one, X)), "y": Mul(X, Y)},
            {"x": Sub(Mul(A, X), Mul(X, Y)), "y": Sub(Mul(X, Y), Y)},
            {"x": Div(one, Add(one, Pow(X, 2))), "y": X},
            {"x": Y, "y": Sub(Mul(Mul(Sub(one, Pow(X, 2)), A), Y), X)},
            {"x": Neg(Call("sqrt", (Add(Number(Fraction(9)), X),))), "y": Mul(X, Z), "z": one},
            {"x": Mul(Y, Z), "y": Neg(Mul(X, Z)), "z": Div(X, Number(Fraction(4)))},
            {"x": Call("exp", (Neg(Pow(X, 2)),)), "y": Call("sin", (T,))},
            {
                "x": Div(Y, Add(two, Call("cos", (X,)))),
                "y": Sub(A, Mul(Y, Call("sqrt", (Add(Pow(X, 2), one),)))),
            },
        )
    )


def _linear(rng: Random) -> dict[str, Term]:
    def entry() -> Term:
        return Mul(_half(rng, 3), rng.choice((X, Y, Z)))

    return rng.choice(
        (
            {"x": Y, "y": Neg(X)},
            {"x": Y, "y": Sub(Neg(Mul(A, X)), Div(Y, Number(Fraction(5))))},
            {"x": Neg(Mul(A, X)), "y": X},
            {"x": Mul(A, Sub(Y, X)), "y": Z},
            {"x": Mul(A, Y), "y": Neg(Mul(A, X)), "z": Mul(Number(Fraction(2)), X)},
            {"x": Add(entry(), entry()), "y": Add(entry(), _half(rng)), "z": Sub(entry(), entry())},
        )
    )


def _polynomial(rng: Random) -> dict[str, Term]:
    return rng.choice(
        (
            {"x": Y, "y": A},
            {"x": Y, "y": Z, "z": _half(rng)},
            {"x": Mul(Y, Z), "y": Z, "z": A},
            {"x": Pow(Y, 2), "y": Add(Z, A), "z": _half(rng)},
            {"x": Pow(Y, 5), "y": _half(rng, 2)},
            {"x": Sub(Mul(Y, T), Z), "y": T, "z": _half(rng)},
        )
    )


MAKERS = {"nonlinear": _nonlinear, "linear": _linear, "polynomial": _polynomial}


def _side(rng: Random) -> Term:
    return rng.choice(
        (
            *(X, X, Y, Y, Z, Add(X, Y), Sub(X, Z), Mul(X, Y), Pow(X, 2), Add(Pow(X, 2), Pow(Y, 2))),
            *(Call("abs", (X,)), Call("abs", (Sub(X, Y),)), Call("min", (X, Y)), Call("max", (Y, Z))),
            *(Add(Call("abs", (X,)), Call("abs", (Y,))), Call("sin", (X,)), Mul(Y, Call("cos", (X,)))),
            *(Div(X, Add(ONE, Pow(Y, 2))), Call("sqrt", (Add(ONE, Pow(X, 2)),)), Div(Y, Sub(X, number(3)))),
            *(Call("max", (Y, Call("sqrt", (X,)))), Call("min", (ONE, Call("sqrt", (Sub(number(2), Y),))))),
        )
    )


def _atom(rng: Random) -> Compare:
    """Most are wide enough for many starts; some have bounds that a start may be put on."""
    left = _side(rng)
    op = rng.choice(("!=", "=")) if rng.random() < 0.12 else rng.choice(ORDERS)
    r = rng.random()
    wide = Number(Fraction(rng.randint(1, 9), 2) * (1 if op in ("<", "<=") else -1))
    right: Term = wide if r < 0.6 else rng.choice((C, D)) if r < 0.95 else _half(rng)
    return Compare(op, left, right)


def _formula(rng: Random, depth: int) -> Formula:
    r = rng.random()
    if depth == 0 or r < 0.4:
        return _atom(rng)
    parts = [_formula(rng, depth - 1) for _ in range(rng.randint(2, 3))]
    return disjunction(parts) if r < 0.65 else conjunction(parts)


def random_flow(rng: Random, kind: Kind) -> Flow:
    equations = tuple(MAKERS[kind](rng).items())
    watched = _formula(rng, 2)
    if rng.random() < 0.7:
        clock = Compare("<=", T, rng.choice((number(1), number(2), number(4))))
        horizons = (Horizon("t", clock.right),)
        return Flow((*equations, ("t", ONE)), conjunction((clock, watched)), watched, horizons, None)
    cap = Fraction(rng.choice((1, 3)), 2)
    if T in symbols(*(r for _, r in equations)):
        equations = (*equations, ("t", ONE))
    return Flow(equations, watched, watched, (), cap)


def flows_model(name: str, flows: tuple[Flow, ...], moving: tuple[str, ...] = VARIABLES) -> Model:
    """A model whose alternative k is flow k."""
    alternatives = tuple(Alternative((Evolve(k),)) for k in range(len(flows)))
    bound = Bound(Fraction(-5), Fraction(5))
    return Model(
        name=name,
        source=f"{name}.kyx",
        variables=tuple(Variable(v, bound, observed=True) for v in (*moving, "t")),
        constants=tuple(Constant(c, Bound(Fraction(-99), Fraction(99))) for c in ("a", "c", "d")),
        precondition=TRUE,
        prefix=(),
        body=(Choice("choice_0", alternatives),) if len(flows) > 1 else (Evolve(0),),
        loops=True,
        flows=flows,
        predicates=(),
        postcondition=None,
    )


@dataclass(frozen=True)
class Start:
    state: dict[str, float]
    constants: dict[str, float]

    @property
    def environment(self) -> dict[Symbol, float]:
        found = {Symbol(x, "variable"): v for x, v in self.state.items()}
        return found | {Symbol(c, "constant"): v for c, v in self.constants.items()}


def random_start(rng: Random, flow: Flow, tries: int = 30) -> Start | None:
    """A start in the domain; often on a boundary, also where motion only touches it."""
    for _ in range(tries):
        coarse = rng.random() < 0.8
        state = {
            v: float(rng.choice((0, 0, *range(-6, 7)))) / 2 if coarse else rng.uniform(-3, 3)
            for v in VARIABLES
        }
        state["t"] = rng.choice((0.0, 0.0, 0.25, 0.9))
        constants = {"a": rng.choice((-1.0, 0.5, 1.0, 2.0, rng.uniform(-2, 2)))}
        constants |= {"c": rng.randint(-6, 6) / 2, "d": rng.randint(-6, 6) / 2}
        start = Start(state, constants)
        if rng.random() < 0.6:
            start = _on_a_boundary(rng, flow, start)
        if truth(flow.domain, start.environment):
            return start
    return None


def _on_a_boundary(rng: Random, flow: Flow, start: Start) -> Start:
    """The constants set so that atoms against c or d hold with equality."""
    constants = dict(start.constants)
    for atom in atoms(flow.watched):
        if atom.right in (C, D) and rng.random() < 0.7:
            try:
                constants[atom.right.name] = float(evaluate(atom.left, start.environment))
            except Undefined:
                continue
    return Start(start.state, constants)
