"""Linear arithmetic over products of facts: many inequalities between polynomials follow from these.

Facts that are polynomials with known signs are multiplied with one another, up to some number of factors;
every monomial then counts as a symbol of its own. What has no solution so has none over the reals.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations_with_replacement, islice, product
from typing import TypeAlias

from dl2c.ir.logic import symbols
from dl2c.ir.model import Compare, Sub, Symbol
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Polynomial, Ring, TooLarge

MAX_PRODUCTS = (0, 0, 1000, 3000, 3000)
"""Of so many factors."""

MAX_FACTS = 40
"""That are multiplied: those that are about the goal's symbols and few others come first."""

MAX_FACTORS = 12
"""Short facts of which products of more than two factors are made."""

LENGTH_OF_FACTOR = 4
"""Monomials of these."""

MAX_ROWS = 3000
"""Inequalities and equations of one question."""

MAX_DEGREE = 20
"""Of facts that are multiplied."""

BITS = 8
"""Of the exponent of a symbol in a monomial, which is one number; no product reaches 2^BITS."""

Row: TypeAlias = tuple[dict[int, int], str]
"""Coefficients of the monomials of a polynomial that is `>`, `>=` or `=` 0."""


def scripts(facts: Sequence[object], wanted: set[Symbol], most: int, until: float) -> Iterator[str]:
    """Questions of linear arithmetic, each harder than the one before; "unsat" says that the facts contradict
    each other. Of `facts`, which are total, those that are comparisons count; `wanted` are the symbols that
    matter most, `most` how many factors products have, `until` is when to stop on the monotonic clock.
    """
    atoms = [a for a in facts if isinstance(a, Compare) and a.op != "!="]
    atoms.sort(key=lambda a: (len(symbols(a) - wanted), len(symbols(a))))
    rows = _rows(atoms[:MAX_FACTS])
    count = 0
    for factors in range(2, most + 1):
        if time.monotonic() > until:
            return
        useful = _useful(_products(rows, factors))
        if count < len(useful) <= MAX_ROWS:
            count = len(useful)
            yield _script(useful)


def _rows(atoms: Sequence[Compare]) -> list[Row]:
    """The facts as rows; of those about one polynomial the strictest."""
    ring = Ring(tuple(sorted(symbols(*atoms), key=str)))
    found: dict[tuple[tuple[int, int], ...], Row] = {}
    for a in atoms:
        left, right = (a.right, a.left) if a.op in ("<", "<=") else (a.left, a.right)
        try:
            p = ring.primitive(ring.polynomial(Sub(left, right)))
        except (NotPolynomial, TooLarge):
            continue
        if p.total_degree() > MAX_DEGREE:
            continue
        row, op = _packed(p), {"<": ">", "<=": ">="}.get(a.op, a.op)
        key = tuple(sorted(row.items()))
        if row and (key not in found or op == "=" or (op == ">" and found[key][1] == ">=")):
            found[key] = row, op
    return list(found.values())


def _packed(p: Polynomial) -> dict[int, int]:
    return {
        sum(int(e) << BITS * k for k, e in enumerate(exponents)): int(value.p)
        for exponents, value in p.to_dict().items()
    }


def _products(rows: Sequence[Row], factors: int) -> list[Row]:
    """The facts with their products of up to so many factors, and equalities times facts and symbols."""
    inequalities = [r for r in rows if r[1] != "="]
    short = [r for r in inequalities if len(r[0]) <= LENGTH_OF_FACTOR]
    short = sorted(short, key=lambda r: (max(map(_degree, r[0])), len(r[0])))[:MAX_FACTORS]
    longer = [r for r in inequalities if r not in short]
    found = [*rows, *_multiplied(combinations_with_replacement(inequalities, 2), MAX_PRODUCTS[2])]
    for count in range(3, factors + 1):
        found += _multiplied(combinations_with_replacement(short, count), MAX_PRODUCTS[count])
        shorter = _multiplied(combinations_with_replacement(short, count - 1), MAX_PRODUCTS[count])
        found += _multiplied(product(longer, list(shorter)), MAX_PRODUCTS[count])
    used = sorted(
        {1 << BITS * k for r, _ in rows for m in r for k in range(_width(m)) if m >> BITS * k & 255}
    )
    multipliers = [*({m: 1} for m in used), *(r for r, _ in inequalities)]
    found += [(_times(r, m), "=") for r, op in rows if op == "=" for m in multipliers]
    return found


def _width(monomial: int) -> int:
    return -(-monomial.bit_length() // BITS)


def _degree(monomial: int) -> int:
    return sum(monomial.to_bytes(_width(monomial) or 1, "little"))


def _multiplied(chosen: Iterable[tuple[Row, ...]], most: int) -> Iterator[Row]:
    """The first products of these facts."""
    for some in islice(chosen, most):
        result = some[0][0]
        for row, _ in some[1:]:
            result = _times(result, row)
        yield result, ">" if all(op == ">" for _, op in some) else ">="


def _times(a: dict[int, int], b: dict[int, int]) -> dict[int, int]:
    result: dict[int, int] = {}
    for m, c in a.items():
        for n, d in b.items():
            result[m + n] = result.get(m + n, 0) + c * d
    return {m: c for m, c in result.items() if c}


def _is_square(monomial: int) -> bool:
    return not any(e % 2 for e in monomial.to_bytes(_width(monomial) or 1, "little"))


def _useful(rows: list[Row]) -> list[Row]:
    """The rows without those that have a monomial which no other row cancels: in a sum of rows with positive
    factors that is a negative number, these do not occur."""
    while True:
        up: set[int] = set()
        down: set[int] = set()
        for row, op in rows:
            if op == "=":
                up.update(row)
                down.update(row)
            else:
                up.update(m for m, c in row.items() if c > 0)
                down.update(m for m, c in row.items() if c < 0)
        lonely = (up - down) | {m for m in down - up if not _is_square(m)}
        lonely.discard(0)
        kept = [r for r in rows if lonely.isdisjoint(r[0])] if lonely else rows
        if len(kept) == len(rows):
            return rows
        rows = kept


def _script(rows: Sequence[Row]) -> str:
    monomials: dict[int, str] = {}
    asserts: list[str] = []
    for row, op in dict.fromkeys((tuple(row.items()), op) for row, op in rows):
        parts: list[str] = []
        for m, value in row:
            number = f"{value}.0" if value >= 0 else f"(- {-value}.0)"
            if m:
                name = monomials.setdefault(m, f"m{len(monomials)}")
                number = f"(* {number} {name})"
            parts.append(number)
        asserts.append(f"(assert ({op} (+ 0.0 {' '.join(parts)}) 0.0))")
    squares = [f"(assert (>= {name} 0.0))" for m, name in monomials.items() if _is_square(m)]
    declared = [f"(declare-fun {name} () Real)" for name in monomials.values()]
    return "\n".join(["(set-logic QF_LRA)", *declared, *squares, *asserts]) + "\n"
