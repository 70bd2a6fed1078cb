"""Questions in cases: disjunctions are taken apart one by one, and what is decided is dropped."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from math import prod

from dl2c.ir.logic import conjunction, conjuncts, disjunction, fold, symbols
from dl2c.ir.model import And, Compare, Formula, Or, Sub, Symbol, Truth
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Ring, TooLarge

MAX_ROUNDS = 8
"""Of dropping what other facts decide."""

_SIGNS = {">": "+", ">=": "+0", "=": "0", "!=": "+-", "<=": "-0", "<": "-"}
_TURNED = str.maketrans("+-", "-+")


@dataclass(slots=True)
class Signs:
    """Which signs facts leave to polynomials in `names`."""

    names: Sequence[Symbol]
    ring: Ring = field(init=False)
    known: dict[Compare, tuple[str, frozenset[str]]] = field(
        default_factory=dict[Compare, tuple[str, frozenset[str]]]
    )

    def __post_init__(self) -> None:
        self.ring = Ring(tuple(self.names))

    def of(self, atom: Compare) -> tuple[str, frozenset[str]]:
        """A polynomial up to positive factors, by its text, and the signs that it may have."""
        if atom not in self.known:
            signs = _SIGNS[atom.op]
            try:
                p = self.ring.primitive(self.ring.polynomial(Sub(atom.left, atom.right)))
                if not p.is_zero() and p.leading_coefficient() < 0:
                    p, signs = -p, signs.translate(_TURNED)
                text = str(p)
            except (NotPolynomial, TooLarge):
                text = f"{atom.left} - {atom.right}"
            self.known[atom] = text, frozenset(signs)
        return self.known[atom]

    def settled(self, facts: Sequence[Formula]) -> list[Formula] | None:
        """The facts without what others of them decide; None where they contradict each other."""
        current = list(dict.fromkeys(facts))
        for _ in range(MAX_ROUNDS):
            left: dict[str, frozenset[str]] = {}
            for fact in current:
                if isinstance(fact, Compare):
                    name, signs = self.of(fact)
                    left[name] = left.get(name, signs) & signs
                    if not left[name]:
                        return None
            following: list[Formula] = []
            for fact in current:
                following += [fact] if isinstance(fact, Compare) else conjuncts(self._reduced(fact, left))
            if Truth(False) in following:
                return None
            following = [f for f in dict.fromkeys(following) if f != Truth(True)]
            if following == current:
                break
            current = following
        return current

    def _reduced(self, formula: Formula, left: dict[str, frozenset[str]]) -> Formula:
        """A formula without the atoms that are true or false by the signs that are left."""

        def atom(a: Compare) -> Formula:
            name, signs = self.of(a)
            known = left.get(name, frozenset("+-0"))
            return Truth(False) if not known & signs else Truth(True) if known <= signs else a

        return fold(formula, Truth, atom, conjunction, disjunction)


def disjunctions(facts: Sequence[Formula], about: set[Symbol]) -> list[Or]:
    """The disjunctions among facts, first those of few symbols beside the goal's, and of few cases."""
    found = [f for f in facts if isinstance(f, Or)]
    return sorted(found, key=lambda f: (len(symbols(f) - about), len(f.children)))


def cases_of(facts: Sequence[Formula], split: Or) -> list[list[Formula]]:
    """The facts in each case of a disjunction among them."""
    rest = [f for f in facts if f is not split]
    return [[*rest, *conjuncts(case)] for case in split.children]


def clauses(formula: Formula, most: int) -> tuple[Formula, ...]:
    """Disjunctions that together say the same; none where they are more than `most`. A part that alone has
    more clauses stays as it is.
    """
    match formula:
        case And(children):
            found = tuple(c for child in children for c in clauses(child, most) or (child,))
        case Or(children):
            parts = [clauses(child, most) or (child,) for child in children]
            if prod(map(len, parts)) > most:
                return ()
            found = tuple(disjunction(chosen) for chosen in product(*parts))
        case _:
            found = (formula,)
    return found if len(found) <= most else ()
