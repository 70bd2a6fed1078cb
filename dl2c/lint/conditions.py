"""Tests, conditions and domains that do not depend on the state.

A step is followed once through all its branches. What each branch changes is unknown after it;
tests passed and domains kept before are known. So a verdict holds on every run.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from dl2c.diagnostics import Diagnostic, warning
from dl2c.ir.liveness import written
from dl2c.ir.logic import domain_at_end, mapped, negation, operands, substituted
from dl2c.ir.model import (
    Assign,
    AssignAny,
    Block,
    Choice,
    Evolve,
    Formula,
    If,
    Model,
    Repeat,
    Symbol,
    Term,
    Test,
    Truth,
    While,
)
from dl2c.lint.world import rigid_facts
from dl2c.smt.precondition import span_of
from dl2c.smt.query import Oracle
from dl2c.source import NOWHERE, Span

MAX_SIZE = 2000
"""Symbols in the value of a variable; a larger one is forgotten."""


@dataclass(frozen=True, slots=True)
class _Known:
    """Values of variables over the start of the step and fresh symbols, their sizes, and what holds."""

    values: Mapping[Symbol, Term]
    sizes: Mapping[Symbol, int]
    facts: tuple[Formula, ...]

    def of(self, formula: Formula) -> Formula:
        return mapped(formula, lambda term: substituted(term, self.values))

    def knowing(self, formula: Formula) -> "_Known":
        return replace(self, facts=(*self.facts, self.of(formula)))


@dataclass(slots=True)
class _Walk:
    model: Model
    oracle: Oracle
    fresh: int = 0

    def block(self, block: Block, known: _Known | None) -> Iterator[Diagnostic | _Known]:
        """Diagnostics, then what is known after the block; nothing after a test that is never true."""
        for statement in block:
            if known is None:
                return
            state, known = known, None
            for found in self.statement(statement, state):
                if isinstance(found, _Known):
                    known = found
                else:
                    yield found
        if known is not None:
            yield known

    def statement(self, statement: object, known: _Known) -> Iterator[Diagnostic | _Known]:
        match statement:
            case Assign(name, term):
                yield self.assigned(known, Symbol(name, "variable"), term)
            case AssignAny(name):
                yield self.forgotten(known, frozenset({name}))
            case Test(formula):
                yield from self.test(formula, statement.span, "test", known)
            case Evolve(k):
                flow = self.model.flows[k]
                moving = frozenset(name for name, _ in flow.equations)
                for found in self.test(flow.domain, flow.span, "domain", known):
                    if isinstance(found, _Known):
                        yield self.forgotten(found, moving).knowing(domain_at_end(flow))
                    else:
                        yield found
            case If(condition, otherwise, then, orelse):
                verdict = self.verdict(condition, known)
                if verdict is not None:
                    yield _constant(condition, statement.span, "condition", verdict)
                for guard, body, taken in ((condition, then, True), (otherwise, orelse, False)):
                    if verdict in (None, taken):
                        yield from _only_found(self.block(body, known.knowing(guard)))
                yield self.after((*then, *orelse), known)
            case Choice(_, alternatives):
                for alternative in alternatives:
                    yield from _only_found(self.block(alternative.body, known))
                yield self.after(tuple(s for a in alternatives for s in a.body), known)
            case While(condition, otherwise, body):
                start = self.after(body, known)
                yield from _only_found(self.block(body, start.knowing(condition)))
                yield start.knowing(otherwise)
            case Repeat(_, body):
                start = self.after(body, known)
                yield from _only_found(self.block(body, start))
                yield start
            case _:
                raise AssertionError(statement)

    def assigned(self, known: _Known, symbol: Symbol, term: Term) -> _Known:
        size = _size(term, known.sizes)
        if size > MAX_SIZE:
            return self.forgotten(known, frozenset({symbol.name}))
        value = substituted(term, known.values)
        return _Known({**known.values, symbol: value}, {**known.sizes, symbol: size}, known.facts)

    def test(self, formula: Formula, span: Span, what: str, known: _Known) -> Iterator[Diagnostic | _Known]:
        verdict = self.verdict(formula, known, both=what == "test")
        if verdict is not None:
            yield _constant(formula, span, what, verdict)
        if verdict is not False:
            yield known.knowing(formula)

    def verdict(self, formula: Formula, known: _Known, both: bool = True) -> bool | None:
        """Whether the formula always holds (asked if `both`) or never; None where it depends, or is plain."""
        if isinstance(formula, Truth):
            return None
        here = known.of(formula)
        if self.oracle.exists((*known.facts, here)).verdict == "no":
            return False
        if both and self.oracle.exists((*known.facts, negation(here))).verdict == "no":
            return True
        return None

    def after(self, block: Block, known: _Known) -> _Known:
        return self.forgotten(known, written(block, self.model.flows))

    def forgotten(self, known: _Known, names: frozenset[str]) -> _Known:
        values, sizes = dict(known.values), dict(known.sizes)
        for name in sorted(names):
            self.fresh += 1
            values[Symbol(name, "variable")] = Symbol(f"{name} {self.fresh}", "variable")
            sizes[Symbol(name, "variable")] = 1
        return _Known(values, sizes, known.facts)


def constant_tests(model: Model, oracle: Oracle) -> Iterator[Diagnostic]:
    """`constant-test`."""
    walk = _Walk(model, oracle)
    yield from _only_found(walk.block((*model.lead, *model.body), _Known({}, {}, rigid_facts(model))))


def _size(term: Term, sizes: Mapping[Symbol, int]) -> int:
    """How many symbols the term has once the values of variables are put in."""
    if isinstance(term, Symbol):
        return sizes.get(term, 1)
    return 1 + sum(_size(t, sizes) for t in operands(term))


def _only_found(found: Iterator[Diagnostic | _Known]) -> Iterator[Diagnostic]:
    return (item for item in found if isinstance(item, Diagnostic))


def _constant(formula: Formula, span: Span, what: str, verdict: bool) -> Diagnostic:
    place = span_of(formula)
    never = {
        "test": "no run passes it",
        "condition": "the first branch is never taken",
        "domain": "no run enters this flow",
    }
    always = {"test": "it forbids nothing", "condition": "the other branch is never taken"}
    return warning(
        "constant-test",
        f"this {what} is always {'true' if verdict else 'false'}",
        span if place == NOWHERE else place,
        always[what] if verdict else never[what],
        "leave it out, or correct it",
    )
