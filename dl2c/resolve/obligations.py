"""When a progress predicate must hold: the premises D of `D -> P` in the postcondition (semantics 6).

Comes in: the postcondition as written, where P is a call. Goes out: for every obligation its
premises, expanded; it is due where all of them hold. What counts is the formula in negation
normal form: `D -> P`, `!D | P`, `D1 -> (D2 -> P)` and `!(D & !P)` say the same. Other
definitions are looked into. P alone, without premises, is not an obligation.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from dl2c.parse import tree
from dl2c.resolve.expand import NONE, Expander, bound_parameters

Premises = tuple[tree.Formula, ...]


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of the postcondition: negated or not, with parameters of the definition it stands in."""

    formula: tree.Formula
    negated: bool
    values: dict[str, tree.Term]

    def also(self, formula: tree.Formula, negated: bool = False) -> "_Part":
        return _Part(formula, self.negated != negated, self.values)


@dataclass(frozen=True, slots=True)
class Obligations:
    """The search for calls of `name` with these `arguments`."""

    name: str
    arguments: tuple[tree.Term, ...]
    expander: Expander

    def of(self, postcondition: tree.Formula) -> tuple[Premises, ...]:
        return tuple(self._walk(_Part(postcondition, False, {}), ()))

    def _walk(self, part: _Part, premises: Premises) -> Iterator[Premises]:
        match part.formula, part.negated:
            case tree.PredOf(name, args), negated:
                actual = tuple(self.expander.term(a, part.values, NONE) for a in args)
                if name != self.name:
                    yield from self._inside(name, actual, negated, premises)
                elif premises and not negated and actual == self.arguments:
                    yield premises
            case tree.Not(child), _:
                yield from self._walk(part.also(child, negated=True), premises)
            case (tree.And(left, right), False) | (tree.Or(left, right), True):
                yield from self._walk(part.also(left), premises)
                yield from self._walk(part.also(right), premises)
            case (tree.Or(left, right), False) | (tree.And(left, right), True):
                yield from self._either(part.also(left), part.also(right), premises)
            case tree.Imply(left, right), False:
                yield from self._either(part.also(left, negated=True), part.also(right), premises)
            case tree.Imply(left, right), True:
                yield from self._walk(part.also(left, negated=True), premises)
                yield from self._walk(part.also(right), premises)
            case tree.Equiv(left, right), False:
                yield from self._either(part.also(left, negated=True), part.also(right), premises)
                yield from self._either(part.also(left), part.also(right, negated=True), premises)
            case _:
                return

    def _either(self, left: _Part, right: _Part, premises: Premises) -> Iterator[Premises]:
        """Each side must hold where the other does not."""
        yield from self._walk(right, (*premises, self._opposite(left)))
        yield from self._walk(left, (*premises, self._opposite(right)))

    def _opposite(self, part: _Part) -> tree.Formula:
        formula = self.expander.formula(part.formula, part.values, NONE)
        return formula if part.negated else tree.Not(formula, span=formula.span)

    def _inside(
        self, name: str, actual: tuple[tree.Term, ...], negated: bool, premises: Premises
    ) -> Iterator[Premises]:
        declaration = self.expander.symbols.declarations[name]
        if isinstance(declaration.body, tree.Formula):
            values = bound_parameters(declaration, actual)
            yield from self._walk(_Part(declaration.body, negated, values), premises)
