"""A symbolic state: what each name stands for, and what is known where a run has come."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, TypeAlias, TypeVar

from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import conjuncts, folded, holds, operands, rewritten, symbols, with_operands
from dl2c.ir.model import Compare, Formula, Number, Symbol, Term, Truth
from dl2c.lower.terms import lower_formula, lower_term
from dl2c.parse import tree
from dl2c.resolve.symbols import nodes
from dl2c.source import Span
from dl2c.verify.arithmetic.total import is_total

EventKind: TypeAlias = Literal["choice", "value", "duration", "again"]
"""Of a decision."""

Lowered = TypeVar("Lowered", Term, Formula)

Event: TypeAlias = tuple[EventKind, int | Symbol]
"""A decision of a run: an alternative, 0 or 1; a value of `x := *`; a duration; how often a loop has run."""


class Unsupported(Exception):
    """Something in a model for which there is no rule, with its place."""

    def __init__(self, what: str, span: Span) -> None:
        super().__init__(what)
        self.span = span


@dataclass(frozen=True, slots=True)
class State:
    """`store` has the value of each name, in terms of values chosen before; `facts` are known of these, and
    may say less than is true; `trail` are the decisions that lead here. `universals` are formulas that hold
    whatever some symbols of theirs are.
    """

    store: Mapping[str, Term]
    facts: tuple[Formula, ...] = ()
    trail: tuple[Event, ...] = ()
    universals: tuple[tuple[frozenset[Symbol], Formula], ...] = ()

    def where(self, *formulas: Formula) -> "State | None":
        """With further facts; None where one of them is false."""
        new = [c for f in formulas for c in conjuncts(f)]
        if any(isinstance(f, Truth) and not f.value for f in new):
            return None
        known = set(self.facts)
        return replace(self, facts=(*self.facts, *(f for f in dict.fromkeys(new) if f not in known)))

    def having(self, values: Mapping[str, Term]) -> "State":
        """With other values of some names."""
        return replace(self, store={**self.store, **values})

    def after(self, *events: Event) -> "State":
        """With further decisions."""
        return replace(self, trail=(*self.trail, *events))

    def recalling(self, before: "State") -> "State":
        """With the same names for earlier values as another state."""
        present = {x: value for x, value in self.store.items() if not _is_earlier(x)}
        earlier = {x: value for x, value in before.store.items() if _is_earlier(x)}
        return replace(self, store={**present, **earlier})


def earlier_values(state: State) -> dict[str, Term]:
    """The values of all names in a state, as those of `old(x)`."""
    return {_earlier(x): value for x, value in state.store.items() if not _is_earlier(x)}


def _earlier(name: str) -> str:
    return f"old({name})"


def _is_earlier(name: str) -> bool:
    return name.startswith("old(")


@dataclass(slots=True)
class Names:
    """Symbols that nothing else uses."""

    count: dict[str, int] = field(default_factory=dict[str, int])

    def fresh(self, name: str) -> Symbol:
        """A new symbol, named after one of the model."""
        k = self.count[name] = self.count.get(name, 0) + 1
        return Symbol(f"{name}~{k}", "variable")


def term_in(term: tree.Term, state: State) -> Term:
    """The value of a term. Raises `Unsupported`."""
    _check(term)
    return _valued(lambda: lower_term(term, state.store), term.span)


def formula_in(formula: tree.Formula, state: State) -> Formula:
    """A formula about one state. Raises `Unsupported`, `CompileError`."""
    _check(formula)
    return _valued(lambda: lower_formula(formula, state.store), formula.span)


def _valued(lowered: Callable[[], Lowered], span: Span) -> Lowered:
    """`old(x)` of a bound x names nothing."""
    try:
        return lowered()
    except KeyError as missing:
        raise Unsupported(f"`{missing.args[0]}`, which is the value of nothing", span) from None


def _check(node: tree.Term | tree.Formula) -> None:
    for part in nodes(node):
        match part:
            case tree.Loop(span=span) | tree.Dual(span=span) | tree.ProgramConst(span=span):
                raise Unsupported("a program inside a condition", span)
            case tree.Assign(_, _, True, span=span) | tree.AssignAny(_, True, span=span):
                raise Unsupported("an assignment to a differential", span)
            case (
                tree.DifferentialSymbol(span=span)
                | tree.Differential(span=span)
                | tree.DifferentialFormula(span=span)
            ):
                raise Unsupported("a differential outside an ODE", span)
            case tree.FuncOf("old", (_, *_), span=span):
                raise Unsupported("`old(...)` outside an invariant of an ODE", span)
            case (
                tree.UnitFunctional(span=span)
                | tree.UnitPredicational(span=span)
                | tree.PredicationalOf(span=span)
                | tree.PredOf(span=span)
                | tree.DifferentialProgramConst(span=span)
            ):
                raise Unsupported("a symbol without definition", span)
            case _:
                pass


def without_old(node: tree.Formula, inside: bool = False) -> tree.Formula:
    """`old(e)` by e with names for earlier values, and `x'` by a name for the rate of x."""

    def changed(part: Any, inside: bool) -> Any:
        match part:
            case tree.FuncOf("old", (argument,)):
                return changed(argument, True)
            case tree.DifferentialSymbol(name) if not inside:
                return tree.Variable(f"{name}'", span=part.span)
            case tree.Variable(name) if inside:
                return tree.Variable(_earlier(name), span=part.span)
            case _:
                pass
        found: dict[str, Any] = {}
        for f in fields(part):
            value: Any = getattr(part, f.name)
            if isinstance(value, tree.Expression):
                found[f.name] = changed(value, inside)
            elif f.name == "args":
                found[f.name] = tuple(changed(v, inside) for v in value)
        return replace(part, **found) if found else part

    return changed(node, inside)


def has_program(formula: tree.Formula) -> bool:
    """Whether a formula is about runs."""
    return any(isinstance(n, tree.Modal) for n in nodes(formula))


def has_differential(formula: tree.Formula) -> bool:
    """Whether a formula speaks of rates."""
    return any(isinstance(n, tree.DifferentialSymbol) for n in nodes(formula))


def quantified(formula: tree.Formula) -> bool:
    """Whether a formula has quantifiers."""
    return any(isinstance(n, tree.Quantified) for n in nodes(formula))


def partial(formula: tree.Formula) -> bool:
    """Whether a formula has terms that may be undefined, as far as its text tells."""
    return any(map(_may_be_undefined, nodes(formula)))


def has_values(formula: tree.Formula, state: State) -> bool:
    """Whether all terms of a formula have values in a state, as far as its text and the store tell."""
    values = (state.store.get(n.name) for n in nodes(formula) if isinstance(n, tree.Variable))
    return not partial(formula) and all(is_total(v) for v in values if v is not None)


def loses_a_reading(formula: tree.Formula, state: State) -> bool:
    """Whether eliminating quantifiers leaves a formula about one of the readings of undefined terms alone."""
    return (quantified(formula) or has_program(formula)) and not has_values(formula, state)


def _may_be_undefined(node: object) -> bool:
    match node:
        case tree.Divide(_, tree.Number(value)):
            return not value
        case tree.Power(_, tree.Number(value)):
            return value.denominator != 1 or not value
        case tree.Divide() | tree.Power():
            return True
        case tree.FuncOf(name):
            return name not in FUNCTIONS or FUNCTIONS[name].domain is not None
        case _:
            return False


def evaluated(formula: Formula, values: Mapping[Symbol, Number]) -> Formula:
    """The formula where symbols have these values, as far as rational arithmetic decides it."""

    def value(term: Term) -> Term:
        if isinstance(term, Symbol):
            return values.get(term, term)
        return folded(with_operands(term, tuple(value(t) for t in operands(term))))

    def atom(a: Compare) -> Formula:
        left, right = value(a.left), value(a.right)
        if isinstance(left, Number) and isinstance(right, Number):
            return Truth(holds(a.op, left.value, right.value))
        return Compare(a.op, left, right)

    return rewritten(formula, atom)


def connected(facts: Iterable[Formula], *goal: Formula) -> list[Formula]:
    """The facts that share symbols with a goal, directly or through others, in their order."""
    left = [(f, symbols(f)) for f in facts]
    reached = symbols(*goal)
    chosen: set[int] = set()
    grown = True
    while grown:
        grown = False
        for k, (_, names) in enumerate(left):
            if k not in chosen and (names & reached or not names):
                chosen.add(k)
                reached |= names
                grown = True
    return [f for k, (f, _) in enumerate(left) if k in chosen]
