"""Names that no condition connects are drawn independently.

A formula and the names to sample come in; groups of names go out with their conjuncts, such that no
conjunct is about names of two groups. A product of uniform laws is uniform, and each group is drawn
again alone where a draw of it is rejected.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from dl2c.ir.logic import conjunction, conjuncts, symbols
from dl2c.ir.model import Compare, Formula, Symbol
from dl2c.sampling.equalities.algebra import is_affine


@dataclass(frozen=True, slots=True)
class Group:
    """`names` in the order given, and what is said about them."""

    names: tuple[Symbol, ...]
    formula: Formula


def groups_of(formula: Formula, names: Sequence[Symbol]) -> tuple[Group, ...]:
    """First the names that are only limited one by one, then the others by their connections."""
    parts = conjuncts(formula)
    home = {s: {s} for s in names}
    for part in parts:
        joined = {t for s in symbols(part) for t in home[s]}
        for symbol in joined:
            home[symbol] = joined
    single = [p for p in parts if not _is_limit(p)]
    entangled = {t for p in single for s in symbols(p) for t in home[s]}
    alone = tuple(s for s in names if s not in entangled)
    groups = [_group(alone, parts, names)] if alone or not names else []
    left = [s for s in names if s in entangled]
    while left:
        members = home[left[0]]
        groups.append(_group(tuple(s for s in left if s in members), parts, names))
        left = [s for s in left if s not in members]
    return tuple(groups)


def _group(members: tuple[Symbol, ...], parts: Sequence[Formula], names: Sequence[Symbol]) -> Group:
    """Conjuncts without names stand with the first name."""
    first = not names or names[0] in members
    own = [p for p in parts if symbols(p) & set(members) or (first and not symbols(p))]
    return Group(members, conjunction(own))


def _is_limit(part: Formula) -> bool:
    """Whether the conjunct limits one name by numbers."""
    if not isinstance(part, Compare):
        return False
    return len(symbols(part)) <= 1 and is_affine(part.left) and is_affine(part.right)
