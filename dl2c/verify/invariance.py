"""Whether a formula that is true where a flow begins stays true along it.

Rules, by their names in dL: differential invariants (dI), Darboux invariants (dbx), barrier certificates
(barrier), and for whole sets (sAI) the chains of Lie derivatives of Liu, Zhan and Zhao (EMSOFT 2011), which
Platzer and Tan (JACM 2020) prove complete. The premises of a rule are formulas that must hold at every point;
solvers decide them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from dl2c.ir.logic import (
    atoms,
    conjunction,
    conjuncts,
    disjunction,
    fold,
    mapped,
    negation,
    substituted,
    symbols,
)
from dl2c.ir.model import TRUE, ZERO, And, Compare, Formula, Neg, Or, Symbol, Term, Truth
from dl2c.verify.arithmetic.polynomials import NotPolynomial, Polynomial, Ring, TooLarge
from dl2c.verify.arithmetic.prover import Prover
from dl2c.verify.field import Field

MAX_RANK = 7
"""Lie derivatives in a chain."""


@dataclass(slots=True)
class Invariance:
    """Proves invariance along the field `vectors` within `domain`. `known` has symbols whose solution is a
    polynomial of time, as terms over a clock. `share` is how long each question may take, as a part of
    the prover's limit. `rules` notes which proved something.
    """

    vectors: Field
    domain: Formula
    prover: Prover
    known: Mapping[Symbol, Term] = field(default_factory=dict[Symbol, Term])
    share: float = 1.0
    rules: set[str] = field(default_factory=set[str])

    def keeps(self, formula: Formula, context: Sequence[Formula]) -> bool:
        """Whether a formula that is true at the start stays true, where `context` holds all the way.

        Raises `OutOfTime`.
        """
        try:
            plain = self.vectors.formula(formula)
            return self._keeps(plain, [*context, *self.vectors.ties])
        except (NotPolynomial, TooLarge):
            return False

    def _keeps(self, formula: Formula, context: list[Formula]) -> bool:
        match formula:
            case Truth():
                return True
            case Compare("!=", left, right):
                signs = [Compare(op, left, right) for op in ("<", ">")]
                return all(self._keeps(s, context) for s in signs)
            case Compare():
                return self._atom(formula, context) or self._set(formula, context)
            case And(children):
                return self._together(children, context)
            case Or(children) if still := [c for c in children if not self.vectors.moves(c)]:
                rest = disjunction(c for c in children if c not in still)
                return self._keeps(rest, [*context, *(negation(c) for c in still)])
            case Or(children):
                return all(self._single(c, context) for c in children) or self._set(formula, context)

    def _single(self, formula: Formula, context: list[Formula]) -> bool:
        """Whether a part of a conjunction or disjunction stays true, without the rule for whole sets."""
        if isinstance(formula, Compare):
            return self._atom(formula, context)
        return isinstance(formula, And) and self._together(formula.children, context, whole=False)

    def _together(self, parts: Sequence[Formula], context: list[Formula], whole: bool = True) -> bool:
        """Whether all conjuncts stay true: each if those proved before it do, the rest together."""
        left = list(parts)
        known = list(context)
        progress = True
        while left and progress:
            progress = False
            for part in list(left):
                if self._single(part, known) or (isinstance(part, Or) and self._keeps(part, known)):
                    left.remove(part)
                    known.append(part)
                    progress = True
        if not left:
            return True
        if self._barriers(left, known):
            return True
        return whole and self._set(conjunction(left), known)

    def _atom(self, atom: Compare, context: list[Formula]) -> bool:
        if atom.op == "!=":
            return self._keeps(atom, context)
        p = _oriented(atom)
        op = _sense(atom)
        if not self.vectors.smooth:
            return self._differential(p, op, context, self.vectors.derivative(p)) or self._barriers(
                [atom], context
            )
        ring = self.vectors.ring(p)
        polynomial = ring.polynomial(p)
        change = ring.derivative(polynomial, self.vectors.flow(ring))
        return (
            self._differential(p, op, context, ring.term(change), change.is_zero())
            or self._darboux(ring, polynomial, change, op, context)
            or (op != "=" and self._barriers([atom], context))
        )

    def _differential(
        self, p: Term, op: str, context: list[Formula], change: Term, constant: bool = False
    ) -> bool:
        """dI: along the equation p never decreases or, in an equality, never changes."""
        if constant:
            return self._noted("dI", True)
        wanted = Compare("=" if op == "=" else ">=", change, ZERO)
        return self._noted("dI", self._valid(context, wanted))

    def _darboux(
        self, ring: Ring, p: Polynomial, change: Polynomial, op: str, context: list[Formula]
    ) -> bool:
        """dbx: p' >= g p, or p' = g p, with a polynomial g."""
        tried: set[str] = set()
        for rest in _remainders(self.vectors, ring, p, change):
            if rest.is_zero():
                return self._noted("dbx", True)
            if (key := str(rest)) in tried:
                continue
            tried.add(key)
            wanted = Compare("=" if op == "=" else ">=", ring.term(rest), ZERO)
            if self._noted("dbx", self._valid(context, wanted)):
                return True
        return False

    def _barriers(self, parts: Sequence[Formula], context: list[Formula]) -> bool:
        """barrier: for each part, its margin p increases where it is 0 and those of the others are >= 0."""
        if not all(isinstance(a, Compare) and _sense(a) != "=" and a.op != "!=" for a in parts):
            return False
        margins = [_oriented(a) for a in parts if isinstance(a, Compare)]
        for k, p in enumerate(margins):
            siblings = [Compare(">=", q, ZERO) for j, q in enumerate(margins) if j != k]
            border = Compare("=", p, ZERO)
            rising = Compare(">", self._change(p), ZERO)
            if not self._valid([*context, *siblings, border], rising):
                return False
        return self._noted("barrier", True)

    def _change(self, p: Term) -> Term:
        if not self.vectors.smooth:
            return self.vectors.derivative(p)
        ring = self.vectors.ring(p)
        return ring.term(ring.derivative(ring.polynomial(p), self.vectors.flow(ring)))

    def _set(self, formula: Formula, context: list[Formula]) -> bool:
        """Invariance of a whole set, by chains of Lie derivatives."""
        if not self.vectors.smooth:
            return False
        chains = Chains(self.vectors, self.vectors.ring(formula, self.domain))
        inside = list(self._polynomial_domain())
        ops = {a.op for a in atoms(formula)}
        ahead = [f for h in inside if (f := chains.entered(h, 1, over=True)) != TRUE]
        if not ops <= {"<", ">", "!="} and not self._valid(
            [*context, formula, *ahead], chains.entered(formula, 1, over=False)
        ):
            return False
        behind = [f for h in inside if (f := chains.entered(h, -1, over=True)) != TRUE]
        goal = negation(chains.entered(formula, -1, over=True))
        if not ops <= {"<=", ">=", "="} and not self._valid([*context, negation(formula), *behind], goal):
            return False
        return self._noted("sAI", True)

    def _polynomial_domain(self) -> Iterator[Formula]:
        for part in conjuncts(self.domain):
            try:
                yield self.vectors.formula(part)
            except NotPolynomial:
                continue

    def _valid(self, facts: Sequence[Formula], goal: Formula) -> bool:
        if self.prover.decide(facts, goal, self.share).verdict == "unsat":
            return True
        if not self.known or not (symbols(*facts, goal) & self.known.keys()):
            return False
        given = [self._at_an_instant(f) for f in facts]
        return self.prover.decide(given, self._at_an_instant(goal), self.share).verdict == "unsat"

    def _at_an_instant(self, formula: Formula) -> Formula:
        return mapped(formula, lambda term: substituted(term, self.known))

    def _noted(self, rule: str, holds: bool) -> bool:
        if holds:
            self.rules.add(rule)
        return holds


def _oriented(atom: Compare) -> Term:
    """The term p with which the atom is p >= 0, p > 0, p = 0 or p != 0."""
    assert atom.right == ZERO
    return Neg(atom.left) if atom.op in ("<", "<=") else atom.left


def _sense(atom: Compare) -> str:
    return {"<": ">", "<=": ">="}.get(atom.op, atom.op)


def _remainders(field: Field, ring: Ring, p: Polynomial, change: Polynomial) -> Iterator[Polynomial]:
    """p' - g p, for polynomials g that division finds in some orders of monomials, and for some numbers g."""
    yield divmod(change, p)[1]
    for ordering in ("lex", "deglex"):
        other = field.ring(ring.term(p), ring.term(change), ordering=ordering)
        rest = divmod(other.polynomial(ring.term(change)), other.polynomial(ring.term(p)))[1]
        yield ring.polynomial(other.term(rest))
    for value in (1, -1, 2):
        yield change + ring.number(value) * p


@dataclass(slots=True)
class Chains:
    """Formulas that a motion is in a set for some time > 0 after now, from Lie derivatives of its atoms."""

    vectors: Field
    ring: Ring
    known: dict[Term, tuple[list[Polynomial], bool]] = field(
        default_factory=dict[Term, tuple[list[Polynomial], bool]]
    )

    def entered(self, formula: Formula, direction: int, over: bool) -> Formula:
        """That the motion along f (`direction` 1) or -f (-1) is in the set for some time > 0 from here on.
        Where the rank of a chain is not known, the formula is weaker (`over`) or stronger than that.
        """
        return fold(formula, Truth, lambda a: self._atom(a, direction, over), conjunction, disjunction)

    def _atom(self, atom: Compare, direction: int, over: bool) -> Formula:
        chain, complete = self._chain(_oriented(atom))
        margins = [self.ring.term(p if direction > 0 or k % 2 == 0 else -p) for k, p in enumerate(chain)]
        sense = _sense(atom)
        if sense in ("=", "!="):
            if not complete:
                zero = [Compare("=", m, ZERO) for m in margins]
                if sense == "=":
                    return conjunction(zero) if over else Truth(False)
                return TRUE if over else disjunction(Compare("!=", m, ZERO) for m in margins)
            rejoin = conjunction if sense == "=" else disjunction
            return rejoin(Compare(sense, m, ZERO) for m in margins)
        all_zero = sense == ">=" if complete else over
        formula: Formula = Compare(">=" if all_zero else ">", margins[-1], ZERO)
        for m in reversed(margins[:-1]):
            level = conjunction([Compare("=", m, ZERO), formula])
            formula = disjunction([Compare(">", m, ZERO), level])
        return formula

    def _chain(self, p: Term) -> tuple[list[Polynomial], bool]:
        """p and its Lie derivatives up to the rank, and whether that was found."""
        if p not in self.known:
            flow = self.vectors.flow(self.ring)
            chain = [self.ring.polynomial(p)]
            complete = False
            while len(chain) <= MAX_RANK and not complete:
                following = self.ring.derivative(chain[-1], flow)
                complete = self.ring.in_ideal(following, chain)
                if not complete:
                    chain.append(following)
            self.known[p] = chain, complete
        return self.known[p]
