"""A program inside a condition, `[a]P` or `<a>P`, as a condition on the state alone.

By the axioms of dL for assignments, tests, sequences, choices and solutions of differential equations:
`[{x' = f(x) & H}]P` is P at all times t >= 0 up to which H holds, along the solution. Times and values
of `x := *` are quantified, and these quantifiers eliminated. Programs have no loops; their solutions
are polynomials of time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, islice

from dl2c.diagnostics import CompileError
from dl2c.flows.solution import NotPolynomial, solve
from dl2c.ir import model as ir
from dl2c.ir.logic import conjunction, disjunction, folded, leaves, substituted, symbols
from dl2c.ir.polynomial import Coefficients
from dl2c.parse import tree
from dl2c.resolve import errors
from dl2c.resolve.shape import statements
from dl2c.source import Span

Scope = Mapping[str, ir.Term]
"""What each name of a model stands for."""

MAX_STATEMENTS = 1000
"""On all runs of a program inside a condition."""

MAX_SIZE = 1000
"""Numbers and symbols in the value of a variable."""


@dataclass(frozen=True, slots=True)
class Modality:
    """One modality being lowered; of its negation where `negated`.

    `everything` where all its runs count, else some; `formula(f, scope, negated)` is the normal form of
    a condition on the state, `term` that of a term.
    """

    everything: bool
    negated: bool
    post: tree.Formula
    span: Span
    formula: Callable[[tree.Formula, Scope, bool], ir.Formula]
    term: Callable[[tree.Term, Scope], ir.Term]
    statements: Iterator[int] = field(default_factory=count)
    """Counts them on all runs."""

    def after(self, program: Sequence[tree.Program], scope: Scope) -> ir.Formula:
        """What has to hold where the rest of the program begins, its values being those of the scope."""
        if not program:
            return self.formula(self.post, scope, self.negated)
        if next(self.statements) > MAX_STATEMENTS:
            raise CompileError([errors.modality(self.span, "it has too many runs")])
        first, *rest = program
        match first:
            case tree.Compose():
                return self.after((*statements(first), *rest), scope)
            case tree.Assign(name, term, False):
                value = self.term(term, scope)
                if _size(value) > MAX_SIZE:
                    raise CompileError([errors.modality(self.span, f"the value of `{name}` is too long")])
                return self.after(rest, {**scope, name: value})
            case tree.Test(condition):
                return self._where(self.formula(condition, scope, self.everything), self.after(rest, scope))
            case tree.Choice(left, right):
                sides = [self.after((side, *rest), scope) for side in (left, right)]
                return conjunction(sides) if self.everything else disjunction(sides)
            case tree.AssignAny(name, False):
                value = _fresh(scope)
                return self._quantified(value, self.after(rest, {**scope, name: value}), self.everything)
            case tree.ODESystem():
                return self._flow(first, rest, scope)
            case tree.Assign() | tree.AssignAny():
                raise CompileError([errors.modality(first.span, "it assigns to a differential")])
            case tree.Loop() | tree.Dual() | tree.ProgramConst():
                raise AssertionError("check_executable refuses these here")

    def _where(self, condition: ir.Formula, rest: ir.Formula) -> ir.Formula:
        """The rest where a condition holds: of all runs it is the negated condition, or the rest."""
        return disjunction((condition, rest)) if self.everything else conjunction((condition, rest))

    def _flow(self, ode: tree.ODESystem, rest: Sequence[tree.Program], scope: Scope) -> ir.Formula:
        """At all times, or at some, that the motion reaches inside its domain."""
        curves = self._curves(ode, scope)
        time = _fresh(scope)
        end = {**scope, **{x: _at(curve, time) for x, curve in curves.items()}}
        earlier = _fresh({**scope, "": time})
        then = {**scope, **{x: _at(curve, earlier) for x, curve in curves.items()}}
        inside = self.formula(ode.domain, then, self.everything)
        if self.everything:
            before = (ir.Compare("<=", ir.ZERO, earlier), ir.Compare("<=", earlier, time))
            left = self._quantified(earlier, conjunction((*before, inside)), everything=False)
            reached = disjunction((ir.Compare("<", time, ir.ZERO), left))
        else:
            outside = (ir.Compare("<", earlier, ir.ZERO), ir.Compare(">", earlier, time))
            stays = self._quantified(earlier, disjunction((*outside, inside)), everything=True)
            reached = conjunction((ir.Compare("<=", ir.ZERO, time), stays))
        return self._quantified(time, self._where(reached, self.after(rest, end)), self.everything)

    def _curves(self, ode: tree.ODESystem, scope: Scope) -> dict[str, Coefficients]:
        """The coefficients of each variable in the time since the motion began."""
        equations = [e for e in ode.equations if isinstance(e, tree.AtomicODE)]
        if len(equations) < len(ode.equations):
            raise CompileError([errors.modality(ode.span, "it has an equation without definition")])
        begun = {ir.Symbol(f"moving {e.name}", "variable"): scope[e.name] for e in equations}
        moving = {**scope, **{e.name: ir.Symbol(f"moving {e.name}", "variable") for e in equations}}
        rates = tuple((f"moving {e.name}", self.term(e.term, moving)) for e in equations)
        solution = solve(ir.Flow(rates, ir.TRUE, ir.TRUE, (), None, span=ode.span))
        if isinstance(solution, NotPolynomial):
            raise CompileError([errors.modality(self.span, "its motion is not a polynomial of time")])
        return {
            e.name: tuple(substituted(c, begun) for c in solution.variables[f"moving {e.name}"])
            for e in equations
        }

    def _quantified(self, bound: ir.Symbol, body: ir.Formula, everything: bool) -> ir.Formula:
        from dl2c.quantifiers.eliminate import Quantifier, eliminated

        try:
            return eliminated(Quantifier(everything, bound.name, bound, False, self.span), body)
        except CompileError:
            reason = "its times or values cannot be eliminated"
            raise CompileError([errors.modality(self.span, reason)]) from None


def _size(term: ir.Term) -> int:
    """How many numbers and symbols it has, counted only until they are too many."""
    return sum(1 for _ in islice(leaves(term), MAX_SIZE + 1))


def _fresh(scope: Scope) -> ir.Symbol:
    """A symbol that no value mentions."""
    taken = symbols(*scope.values())
    return next(s for k in count() if (s := ir.Symbol(f"run {k}", "variable")) not in taken)


def _at(curve: Coefficients, time: ir.Symbol) -> ir.Term:
    """A polynomial at a time, by Horner's rule."""
    value: ir.Term = curve[-1]
    for coefficient in reversed(curve[:-1]):
        value = folded(ir.Add(coefficient, folded(ir.Mul(value, time))))
    return value
