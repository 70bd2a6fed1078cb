"""Terms and formulas of the syntax tree as IR: exact numbers, negation normal form.

Assumes an expanded, executable tree. Subterms made of numbers alone are folded exactly, quantifiers
eliminated. Raises `CompileError` for numbers beyond the doubles, for quantifiers that cannot be
eliminated and for distances that do not exist.
"""

import sys
from dataclasses import dataclass
from fractions import Fraction
from itertools import count
from typing import assert_never

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.ir import model as ir
from dl2c.ir.logic import NEGATED, always_defined, conjunction, delta, disjunction, folded, mapped, symbols
from dl2c.ir.slack import Slacks, settled
from dl2c.lower.modal import Modality, Scope
from dl2c.parse import tree
from dl2c.parse.errors import beyond_doubles
from dl2c.resolve.symbols import nodes
from dl2c.source import Span
from dl2c.work import spend

PI = Fraction(884279719003555, 281474976710656)
E = Fraction(6121026514868073, 2251799813685248)
"""The doubles nearest to pi and e, as exact numbers."""

OPERATIONS = {tree.Plus: ir.Add, tree.Minus: ir.Sub, tree.Times: ir.Mul, tree.Divide: ir.Div}

MAX_EXPONENT = 64
"""A literal exponent up to this is repeated multiplication, above it a call of pow."""

LARGEST = Fraction(sys.float_info.max)


def lower_term(term: tree.Term, scope: Scope) -> ir.Term:
    """The IR of a term; operations on numbers fold. Raises `CompileError` for numbers beyond doubles."""
    lowered = _lowered(term, scope)
    if isinstance(lowered, ir.Number) and abs(lowered.value) > LARGEST:
        raise CompileError(beyond_doubles(term.span))
    return lowered


def _lowered(term: tree.Term, scope: Scope) -> ir.Term:
    spend()
    match term:
        case tree.Number(value):
            return ir.Number(value)
        case tree.Variable(name):
            return scope[name]
        case tree.FuncOf("pi", ()):
            return ir.Number(PI)
        case tree.FuncOf("e", ()):
            return ir.Number(E)
        case tree.FuncOf(name, args):
            return folded(ir.Call(name, tuple(lower_term(a, scope) for a in args)))
        case tree.Neg(child):
            return folded(ir.Neg(lower_term(child, scope)))
        case tree.Power(left, right):
            return _power(lower_term(left, scope), lower_term(right, scope))
        case tree.BinaryTerm():
            operation = OPERATIONS[type(term)]
            return folded(operation(lower_term(term.left, scope), lower_term(term.right, scope)))
        case tree.DifferentialSymbol() | tree.Differential() | tree.UnitFunctional():
            raise AssertionError("check_executable refuses these")
        case _:
            assert_never(term)


def _power(base: ir.Term, exponent: ir.Term) -> ir.Term:
    match exponent:
        case ir.Number(value) if value.denominator == 1 and abs(value) <= MAX_EXPONENT:
            n = int(value)
            if n == 0 and always_defined(base):
                return ir.ONE
            if n == 0:
                return ir.Call("pow", (base, exponent))
            power = folded(ir.Pow(base, abs(n)))
            return power if n > 0 else folded(ir.Div(ir.ONE, power))
        case ir.Number(value) if value == Fraction(1, 2):
            return ir.Call("sqrt", (base,))
        case _:
            return ir.Call("pow", (base, exponent))


STRICT = Slacks("", Fraction(0), {})
"""Relaxes nothing."""


def lower_formula(formula: tree.Formula, scope: Scope) -> ir.Formula:
    """The negation normal form of a formula, quantifiers eliminated; atoms between numbers are decided.

    Raises `CompileError` for quantifiers that cannot be eliminated.
    """
    return _decided(_Lowering(STRICT).formula(formula, scope))


def lower_predicate(
    name: str, category: ir.Category, formula: tree.Formula, scope: Scope, tolerance: Fraction
) -> ir.Predicate:
    """A predicate without rewards and triggers: as it is, with every atom of the source relaxed, and as it
    is watched along flows (semantics 5).
    """
    slacks = Slacks(name, tolerance, {})
    along = _decided(_Lowering(slacks).formula(formula, scope))
    relaxed = settled(along, slacks.starts)
    exact = lower_formula(formula, scope)
    return ir.Predicate(name, category, exact, relaxed, along=along, slacks=slacks.starts, span=formula.span)


def _decided(formula: ir.Formula) -> ir.Formula:
    return mapped(formula, lambda term: term)


@dataclass(frozen=True, slots=True)
class _Lowering:
    """Formulas in negation normal form, with every atom of the source relaxed."""

    slacks: Slacks

    def formula(self, formula: tree.Formula, scope: Scope, negated: bool = False) -> ir.Formula:
        """The formula or, `negated`, its negation; an undefined atom is false in both."""
        both, either = (disjunction, conjunction) if negated else (conjunction, disjunction)
        match formula:
            case tree.Truth(value):
                return ir.Truth(value != negated)
            case tree.Compare(op, left, right):
                sides = lower_term(left, scope), lower_term(right, scope)
                atom = ir.Compare(NEGATED[op] if negated else op, *sides, span=formula.span)
                return self.slacks.relaxed(atom)
            case tree.Not(child):
                return self.formula(child, scope, not negated)
            case tree.And(left, right):
                return both((self.formula(left, scope, negated), self.formula(right, scope, negated)))
            case tree.Or(left, right):
                return either((self.formula(left, scope, negated), self.formula(right, scope, negated)))
            case tree.Imply(left, right):
                return either((self.formula(left, scope, not negated), self.formula(right, scope, negated)))
            case tree.Equiv(left, right):
                one = self.formula(tree.Imply(left, right), scope, negated)
                return both((one, self.formula(tree.Imply(right, left), scope, negated)))
            case tree.Quantified():
                return self._quantified(formula, scope, negated)
            case tree.Modal():
                everything = isinstance(formula, tree.Box) != negated
                runs = Modality(everything, negated, formula.child, formula.span, self.formula, lower_term)
                return runs.after((formula.program,), scope)
            case (
                tree.PredOf() | tree.UnitPredicational() | tree.PredicationalOf() | tree.DifferentialFormula()
            ):
                raise AssertionError("expansion and check_executable leave none of these")
            case _:
                assert_never(formula)

    def _quantified(self, formula: tree.Quantified, scope: Scope, negated: bool) -> ir.Formula:
        from dl2c.quantifiers.eliminate import Quantifier, eliminated

        name, child = formula.variable, formula.child
        bound = _bound(name, scope)
        body = self.formula(child, {**scope, name: bound}, negated)
        everything = isinstance(formula, tree.Forall) != negated
        nested = any(isinstance(n, tree.Quantified) for n in nodes(child))
        return eliminated(Quantifier(everything, name, bound, nested, formula.span), body)


def _bound(name: str, scope: Scope) -> ir.Symbol:
    """A symbol for what a quantifier binds, which no value mentions: programs inside of quantifiers may give
    a name the value of another one that is bound.
    """
    taken = symbols(*scope.values())
    names = (f"bound {name}{' again' * k}" for k in count())
    return next(s for n in names if (s := ir.Symbol(n, "variable")) not in taken)


def lower_delta(formula: tree.Formula, scope: Scope) -> ir.Term:
    """The distance to satisfaction of a formula (paper eq. 4-5)."""
    for node in nodes(formula):
        if isinstance(node, tree.Quantified):
            raise CompileError(_no_distance(node.span, "a quantifier compares no terms"))
        if isinstance(node, tree.Modal):
            raise CompileError(_no_distance(node.span, "a program compares no terms"))
    term = delta(_Lowering(STRICT).formula(formula, scope))
    if term is None:
        raise CompileError(_no_distance(formula.span, "it is always true or always false"))
    return term


def _no_distance(span: Span, why: str) -> Diagnostic:
    return error(
        "no-distance",
        "this formula has no distance to satisfaction",
        span,
        why,
        "a predicate used as a value must compare terms",
    )
