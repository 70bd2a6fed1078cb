"""Units that do not fit together, where `unit=` gives them.

A unit is its base units with exponents; None where it is not known, which fits everything. In a sum
or comparison a number fits everything too; in a product it has no unit. Definitions are looked into
with the units of their arguments. What `x` and its rate imply of time must agree in the whole model.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeAlias

from dl2c.diagnostics import Diagnostic, warning
from dl2c.ir.functions import FUNCTIONS
from dl2c.parse import tree
from dl2c.resolve.problem import Problem
from dl2c.resolve.symbols import Node, Symbols, children
from dl2c.source import Span

Unit: TypeAlias = Mapping[str, Fraction]
Scope: TypeAlias = Mapping[str, "Unit | None"]

_FACTOR = re.compile(r"\s*([*/ ]?)\s*([A-Za-z%]+|1)(?:\^(-?[0-9]+))?")
WITHOUT = ("1", "rad", "sr")
"""Units of quantities that have none."""


def unit_of(text: str) -> Unit | None:
    """`m/s^2` as `{m: 1, s: -2}`; None for what is not written so."""
    found: dict[str, Fraction] = {}
    at = 0
    text = text.strip()
    while at < len(text):
        factor = _FACTOR.match(text, at)
        if factor is None:
            return None
        sign = -1 if factor[1] == "/" else 1
        if factor[2] not in WITHOUT:
            found[factor[2]] = found.get(factor[2], Fraction(0)) + sign * int(factor[3] or 1)
        at = factor.end()
    return _clean(found) if text else None


def shown(unit: Unit) -> str:
    """A unit as text."""
    over = "*".join(_power(n, e) for n, e in sorted(unit.items()) if e > 0) or "1"
    under = [_power(n, -e) for n, e in sorted(unit.items()) if e < 0]
    return "/".join((over, *under)) if unit else "no unit"


def _power(name: str, exponent: Fraction) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"


def _clean(unit: Unit) -> Unit:
    return {name: exponent for name, exponent in unit.items() if exponent}


def _times(a: Unit | None, b: Unit | None, sign: int = 1) -> Unit | None:
    if a is None or b is None:
        return None
    return _clean({n: a.get(n, Fraction(0)) + sign * b.get(n, Fraction(0)) for n in {**a, **b}})


@dataclass(slots=True)
class _Units:
    """One model being looked at. `seen` holds definitions by the units of their arguments."""

    symbols: Symbols
    given: Scope
    time: Unit | None = None
    found: list[Diagnostic] = field(default_factory=list[Diagnostic])
    seen: dict[tuple[object, ...], Unit | None] = field(
        default_factory=dict[tuple[object, ...], "Unit | None"]
    )

    def node(self, node: Node, scope: Scope) -> None:
        """Everything in a formula or program."""
        match node:
            case tree.Compare(_, left, right):
                self.equal(left, right, node.span, scope)
            case tree.PredOf(name, args):
                self.called(name, args, scope)
            case tree.ProgramConst(name):
                self.called(name, (), scope)
            case tree.Assign(name, term, False):
                self.same(scope.get(name), self.term(term, scope), name, term.span.text, node.span)
            case tree.ODESystem(equations, domain):
                for equation in equations:
                    if isinstance(equation, tree.AtomicODE):
                        self.rate(equation, scope)
                self.node(domain, scope)
            case tree.Quantified(name, child):
                self.node(child, {**scope, name: None})
            case _:
                for child in children(node):
                    self.node(child, scope)

    def rate(self, equation: tree.AtomicODE, scope: Scope) -> None:
        """`x' = f` says that time has the unit of x / f."""
        own = scope.get(equation.name)
        clock = equation.term == tree.Number(Fraction(1))
        time = own if clock else _times(own, self.term(equation.term, scope), -1)
        if self.time is None:
            self.time = time
        expected = _times(own, self.time, -1)
        if time is not None and time != self.time and expected is not None and own is not None:
            rate = _times(own, time, -1) or {}
            self.found.append(
                warning(
                    "unit-mismatch",
                    f"the rate of `{equation.name}` has another unit",
                    equation.span,
                    f"in {shown(rate)}, but with time in {shown(self.time or {})} it is {shown(expected)}",
                    "correct the equation, or the units",
                )
            )

    def called(self, name: str, args: tuple[tree.Term, ...], scope: Scope) -> Unit | None:
        """A definition with these arguments; its unit if it is a term."""
        units = [self.term(a, scope) for a in args]
        declaration = self.symbols.declarations.get(name)
        if declaration is None or declaration.body is None:
            return None
        key = (name, *(None if u is None else tuple(sorted(u.items())) for u in units))
        if key in self.seen:
            return self.seen[key]
        parameters = [p.name for p in declaration.parameters or ()]
        inner = {**self.given, **dict(zip(parameters, units, strict=False))}
        self.seen[key] = None
        if isinstance(declaration.body, tree.Term):
            self.seen[key] = self.given.get(name) or self.term(declaration.body, inner)
        else:
            self.node(declaration.body, inner)
        return self.seen[key]

    def term(self, term: tree.Term, scope: Scope) -> Unit | None:
        if _is_number(term):
            return None
        match term:
            case tree.Variable(name):
                return scope[name] if name in scope else self.called(name, (), scope)
            case tree.FuncOf(name, args) if name in FUNCTIONS:
                return self.builtin(name, args, scope)
            case tree.FuncOf(name, ()) if name in scope:
                return scope[name]
            case tree.FuncOf(name, args):
                return self.called(name, args, scope)
            case tree.Neg(child):
                return self.term(child, scope)
            case tree.Plus(left, right) | tree.Minus(left, right):
                return self.equal(left, right, term.span, scope)
            case tree.Times(left, right):
                return _times(self.factor(left, scope), self.factor(right, scope))
            case tree.Divide(left, right):
                return _times(self.factor(left, scope), self.factor(right, scope), -1)
            case tree.Power(left, tree.Number(value)):
                base = self.factor(left, scope)
                return None if base is None else _clean({n: e * value for n, e in base.items()})
            case _:
                return None

    def factor(self, term: tree.Term, scope: Scope) -> Unit | None:
        """In a product a number has no unit."""
        return {} if _is_number(term) else self.term(term, scope)

    def builtin(self, name: str, args: tuple[tree.Term, ...], scope: Scope) -> Unit | None:
        unit_is = FUNCTIONS[name].unit
        if unit_is == "none":
            for unit, arg in ((self.term(a, scope), a) for a in args):
                self.same({}, unit, f"the argument of {name}", arg.span.text, arg.span)
            return {}
        if unit_is == "root":
            unit = self.term(args[0], scope)
            return None if unit is None else {n: e / 2 for n, e in unit.items()}
        if len(args) == 1:
            return self.term(args[0], scope)
        return self.equal(args[0], args[1], args[0].span.to(args[1].span), scope)

    def equal(self, left: tree.Term, right: tree.Term, span: Span, scope: Scope) -> Unit | None:
        """Both sides of a sum or comparison; their unit."""
        a, b = self.term(left, scope), self.term(right, scope)
        self.same(a, b, left.span.text, right.span.text, span)
        return b if a is None else a

    def same(self, a: Unit | None, b: Unit | None, first: str, second: str, span: Span) -> None:
        if a is not None and b is not None and a != b:
            label = f"`{_short(first)}` is in {shown(a)}, `{_short(second)}` in {shown(b)}"
            advice = "correct the expression, or the units"
            self.found.append(warning("unit-mismatch", "units do not fit together", span, label, advice))


def unit_mismatches(problem: Problem) -> Iterator[Diagnostic]:
    """`unit-mismatch`, in the problem and in annotated predicates."""
    declared = (*problem.entry.definitions, *problem.entry.variables)
    given = {d.name: unit for d in declared if (unit := _annotated(d)) is not None}
    if not given:
        return
    names = {d.name: given.get(d.name) for d, _ in (*problem.variables, *problem.constants)}
    units = _Units(problem.symbols, {**names, **given})
    units.node(problem.entry.problem, units.given)
    for predicate in problem.predicates:
        parameters = predicate.declaration.parameters or ()
        namesakes = tuple(tree.Variable(p.name) for p in parameters)
        scope = {**dict.fromkeys((p.name for p in parameters), None), **units.given}
        units.called(predicate.declaration.name, namesakes, scope)
    yield from {d.span: d for d in units.found}.values()


def _annotated(declaration: tree.Declaration) -> Unit | None:
    texts = [v for a in declaration.annotations for name, v, _ in a.attributes if name == "unit"]
    return unit_of(texts[0].strip('"')) if texts else None


def _is_number(term: tree.Term) -> bool:
    match term:
        case tree.Number():
            return True
        case tree.Neg(child):
            return _is_number(child)
        case tree.BinaryTerm():
            return _is_number(term.left) and _is_number(term.right)
        case _:
            return False


def _short(text: str) -> str:
    words = " ".join(text.split())
    return words if len(words) <= 40 else words[:37] + "..."
