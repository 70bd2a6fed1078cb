"""Builds IR by hand for tests: formulas from text in Python's syntax, models from bounds and such a text."""

import ast
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

from dl2c.ir.model import (
    FALSE,
    TRUE,
    UNBOUNDED,
    Add,
    And,
    Bound,
    Call,
    Compare,
    Constant,
    Div,
    Formula,
    Model,
    Mul,
    Neg,
    Number,
    Or,
    Pow,
    Sub,
    Symbol,
    Term,
    Variable,
)
from dl2c.source import Source, Span

COMPARISONS = {ast.Eq: "=", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
OPERATIONS = {ast.Add: Add, ast.Sub: Sub, ast.Mult: Mul, ast.Div: Div}


def formula(text: str, constants: frozenset[str] = frozenset()) -> Formula:
    """`x >= 0 and (y == 1 or x**2 < 2)`, with the span of every atom."""
    return _formula(ast.parse(text, mode="eval").body, Source("model.kyx", text), constants)


def term(text: str, constants: frozenset[str] = frozenset()) -> Term:
    return _term(ast.parse(text, mode="eval").body, text, constants)


def _formula(node: ast.expr, source: Source, constants: frozenset[str]) -> Formula:
    match node:
        case ast.BoolOp(op, values):
            return (And if isinstance(op, ast.And) else Or)(
                tuple(_formula(v, source, constants) for v in values)
            )
        case ast.Constant(value):
            return TRUE if value else FALSE
        case ast.Compare(left, [op], [right]):
            span = Span(source, node.col_offset, node.end_col_offset)
            sides = (_term(side, source.text, constants) for side in (left, right))
            return Compare(COMPARISONS[type(op)], *sides, span=span)
    raise AssertionError(ast.dump(node))


def _term(node: ast.expr, text: str, constants: frozenset[str]) -> Term:
    match node:
        case ast.Constant():
            return Number(Fraction(ast.get_source_segment(text, node)))
        case ast.Name(name):
            return Symbol(name, "constant" if name in constants else "variable")
        case ast.UnaryOp(ast.USub(), operand):
            return Neg(_term(operand, text, constants))
        case ast.BinOp(base, ast.Pow(), ast.Constant(exponent)):
            return Pow(_term(base, text, constants), exponent)
        case ast.BinOp(left, op, right):
            return OPERATIONS[type(op)](_term(left, text, constants), _term(right, text, constants))
        case ast.Call(ast.Name(function), args):
            return Call(function, tuple(_term(a, text, constants) for a in args))
    raise AssertionError(ast.dump(node))


def bound(text: str) -> Bound:
    """`0:10`, `:3`, `` (unbounded)."""
    if not text:
        return UNBOUNDED
    low, high = (Fraction(side) if side else None for side in text.split(":"))
    return Bound(low, high)


def model(
    precondition: str,
    variables: Mapping[str, str],
    constants: Mapping[str, str] | None = None,
    values: Mapping[str, str] | None = None,
) -> Model:
    """A model that only has initial states. Bounds as in `bound`; `values` fixes constants.

    The declarations have spans in a text of their own, one line each.
    """
    constants, values = constants or {}, values or {}
    names = frozenset(constants) | frozenset(values)
    lines = [f"{n}[{b}]" for n, b in (*variables.items(), *constants.items(), *values.items())]
    declarations = Source("declarations.kyx", "\n".join(lines))
    spans = [
        Span(declarations, s, s + len(line)) for s, line in zip(declarations.line_starts, lines, strict=True)
    ]
    declared = [
        *(Variable(n, bound(b)) for n, b in variables.items()),
        *(Constant(n, bound(b)) for n, b in constants.items()),
        *(Constant(n, value=Fraction(v)) for n, v in values.items()),
    ]
    placed = [replace(d, span=span) for d, span in zip(declared, spans, strict=True)]
    return Model(
        name="model",
        source=precondition,
        variables=tuple(d for d in placed if isinstance(d, Variable)),
        constants=tuple(d for d in placed if isinstance(d, Constant)),
        precondition=formula(precondition, names),
        prefix=(),
        body=(),
        loops=True,
        flows=(),
        predicates=(),
        postcondition=None,
    )


PAPER = model(
    "A > 0 and b > 0 and ep > 0 and Vmax >= 2*A*ep and GDelta > Vmax*ep + Vmax**2/(2*b) and vr == 0"
    " and xr < xg - GDelta and T > ep + ((xg - xr) - GDelta)/(A*ep) + ep + Vmax/b",
    {"xr": "0:100", "vr": "0:20", "ar": "-10:10", "xg": "0:100", "t": "0:1"},
    {"ep": "0.1:0.5", "b": "0.5:5", "A": "1:10", "GDelta": "1:10", "Vmax": "5:30", "T": "0:1000"},
)
"""The precondition of the robot model in the paper's Appendix B."""
