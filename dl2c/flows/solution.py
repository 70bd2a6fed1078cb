"""Closed-form solutions of polynomial ODEs, as terms.

An ODE is solvable here when its dependency graph is acyclic and every right-hand side
is a polynomial of the variables that flow (dL rule for solvable ODEs: x' = v, v' = a,
t' = 1). Then each variable is a polynomial in the time since the flow began, whose
coefficients are terms over the state at its start. Interpreter and compiled code
evaluate these same coefficients in the same order.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

from dl2c.ir.logic import folded, number
from dl2c.ir.model import ZERO, Add, Call, Div, Flow, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.ir.polynomial import Coefficients, polynomial, trimmed

MAX_DEGREE = 12
"""Polynomials of higher degree in time count as not solvable."""


@dataclass(frozen=True, slots=True)
class NotPolynomial:
    """Why a flow has no polynomial solution: the variable that stands in the way, and how."""

    variable: str
    reason: str


@dataclass(frozen=True, slots=True)
class Solution:
    """`variables[x]` are the coefficients of x(tau) for every variable of the ODE."""

    variables: Mapping[str, Coefficients]

    @property
    def curves(self) -> Mapping[Symbol, Coefficients]:
        return _curves(self.variables)

    def compose(self, term: Term) -> Coefficients | None:
        """The coefficients of `term` along the flow; None if it is not a polynomial in time."""
        return polynomial(term, self.curves)


def solve(flow: Flow) -> Solution | NotPolynomial:
    """The polynomial solution of the flow's ODE, by repeated integration."""
    rates = dict(flow.equations)
    solved: dict[str, Coefficients] = {}
    waiting = list(rates)
    while waiting:
        progress = [x for x in waiting if not moving(rates[x], rates) - solved.keys()]
        if not progress:
            x = _circular(waiting[0], {x: moving(rates[x], rates) - solved.keys() for x in waiting})
            return NotPolynomial(x, f"{x}' depends on itself, directly or through other variables")
        for x in progress:
            rate = polynomial(rates[x], _curves(solved))
            if rate is None:
                return NotPolynomial(x, f"{x}' is not a polynomial in the variables that evolve")
            solved[x] = _integrated(x, rate)
            if len(solved[x]) > MAX_DEGREE + 1:
                return NotPolynomial(x, f"{x} would be a polynomial of degree {len(solved[x]) - 1} in time")
            waiting.remove(x)
    return Solution({x: solved[x] for x in rates})


def _circular(start: str, needs: Mapping[str, set[str]]) -> str:
    """A variable that needs itself, found from one where every variable needs another."""
    seen: list[str] = []
    x = start
    while x not in seen:
        seen.append(x)
        x = min(needs[x])
    return x


def moving(term: Term, rates: Mapping[str, Term]) -> set[str]:
    """The variables in the term that evolve at a rate not structurally zero."""
    match term:
        case Symbol(name, "variable") if name in rates and rates[name] != ZERO:
            return {name}
        case Number() | Symbol():
            return set()
        case Neg(child) | Pow(child, _):
            return moving(child, rates)
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            return moving(left, rates) | moving(right, rates)
        case Call(_, args):
            return set[str]().union(*(moving(a, rates) for a in args))
        case _:
            assert_never(term)


def _integrated(variable: str, rate: Coefficients) -> Coefficients:
    """x(tau) = x + integral of the rate."""
    start: Term = Symbol(variable, "variable")
    return trimmed((start, *(c if k == 1 else folded(Div(c, number(k))) for k, c in enumerate(rate, 1))))


def _curves(variables: Mapping[str, Coefficients]) -> dict[Symbol, Coefficients]:
    return {Symbol(x, "variable"): c for x, c in variables.items()}
