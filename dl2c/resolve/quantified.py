"""A problem without the quantifiers around its program: their names become constants.

Comes in: a parsed entry. Goes out: its problem, `P -> \\forall x F` as `P -> F` and `\\exists x (C & F)` as
`C -> F`, and what these quantifiers declare. For all values of a name that nothing writes is for all
constants. For some value is about those that make the rest true: an environment has any that C allows.
"""

from dataclasses import dataclass, replace
from functools import reduce

from dl2c.parse import tree
from dl2c.resolve.shape import conjuncts, implications
from dl2c.resolve.symbols import mentioned, nodes, own_names, uses


@dataclass(frozen=True, slots=True)
class Opened:
    """A formula without the quantifiers around its program, and their names, with the spans of the
    quantifiers; `existential` are those of which there is said to be some value.
    """

    problem: tree.Formula
    declared: tuple[tree.Declaration, ...] = ()
    existential: tuple[tree.Declaration, ...] = ()


def without_quantifiers(entry: tree.Entry) -> Opened:
    """The problem of an entry; as it is where no quantifier can go."""
    bodies = {
        d.name: d.body for d in entry.definitions if isinstance(d.body, tree.Formula) and not d.parameters
    }
    outside = frozenset(d.name for d in entry.definitions)
    definitions = {d.name: d for d in entry.definitions}
    return _Opening(definitions, bodies).opened(entry.problem, outside)


@dataclass(frozen=True, slots=True)
class _Opening:
    """`bodies` are those of formulas without parameters that are not being looked into."""

    definitions: dict[str, tree.Declaration]
    bodies: dict[str, tree.Formula]

    def opened(self, formula: tree.Formula, outside: frozenset[str]) -> Opened:
        """`outside` are names that mean something beside the formula: a quantifier of one of them stays."""
        closed = Opened(formula)
        match formula:
            case tree.Imply(left, right):
                inner = self.opened(right, outside | self._names(left))
                opened = replace(inner, problem=replace(formula, right=inner.problem))
                return opened if inner.declared else closed
            case tree.PredOf(name, ()) if name in self.bodies:
                inner = self._inside(name).opened(self.bodies[name], outside)
                return inner if inner.declared else closed
            case tree.Quantified(name, child) if name not in outside:
                some = isinstance(formula, tree.Exists)
                inner = self.opened(self._premise(child, some), outside)
                if not self._is_problem(inner.problem) or any(d.name == name for d in inner.declared):
                    return closed
                own = tree.Declaration("Real", name, None, None, span=formula.span)
                existential = (own, *inner.existential) if some else inner.existential
                return Opened(inner.problem, (own, *inner.declared), existential)
            case _:
                return closed

    def _premise(self, formula: tree.Formula, some: bool) -> tree.Formula:
        """`C & F` under an existential quantifier as `C -> F`, where F alone has a program."""
        parts = conjuncts(formula)
        running = [p for p in parts if self._runs(p)]
        if not some or len(parts) == 1 or len(running) != 1:
            return formula
        conditions = [p for p in parts if p is not running[0]]
        return tree.Imply(reduce(tree.And, conditions), running[0], span=formula.span)

    def _is_problem(self, formula: tree.Formula) -> bool:
        """Whether a formula says what a program does, under nothing but implications."""
        _, conclusion = implications(formula)
        for part in conjuncts(conclusion):
            match part:
                case tree.Modal():
                    return True
                case tree.PredOf(name) if name in self.bodies:
                    if self._inside(name)._is_problem(self.bodies[name]):
                        return True
                case _:
                    pass
        return False

    def _inside(self, name: str) -> "_Opening":
        """For a body, which may call itself by mistake."""
        return replace(self, bodies={n: body for n, body in self.bodies.items() if n != name})

    def _runs(self, formula: tree.Formula) -> bool:
        """Whether a program stands anywhere in a formula, or in what it calls."""
        return any(
            isinstance(node, tree.Modal) for body in self._with_called(formula) for node in nodes(body)
        )

    def _names(self, formula: tree.Formula) -> frozenset[str]:
        """The names of numbers in a formula and in what it calls."""
        local = {id(d.body): own_names(d) for d in self.definitions.values()}
        bodies = self._with_called(formula)
        return frozenset(n for body in bodies for n, _ in uses(body, local.get(id(body), frozenset())))

    def _with_called(self, formula: tree.Formula) -> list[tree.Expression]:
        """The formula and the bodies of all definitions that it mentions, directly or through others."""
        waiting = dict(self.definitions)
        found: list[tree.Expression] = [formula]
        for body in found:
            called = [waiting.pop(name) for name in mentioned(body) if name in waiting]
            found += [d.body for d in called if d.body is not None]
        return found
