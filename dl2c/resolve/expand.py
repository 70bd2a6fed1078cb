"""Replace every use of a definition by its body.

Assumes that `bind` found no error, so that names exist, sorts and arities fit and no
definition is recursive. Nodes of a body keep the span of the definition they come from.
Definitions inside definitions can make a small text huge: the result is limited in size.
A definition of a term or formula must not mention, other than as a parameter, a variable
that a program around its use changes (the substitution would be captured); such uses are
errors, as in KeYmaera X.
"""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TypeAlias, assert_never

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.ir.functions import DEFINED
from dl2c.parse import tree
from dl2c.parse.parser import parse_term
from dl2c.resolve import errors
from dl2c.resolve.implicit import Solution, solve
from dl2c.resolve.symbols import Node, Symbols, children, free_variables, mentioned, own_names, reached_by
from dl2c.source import Span
from dl2c.work import spend

Names = frozenset[str]
NONE: Names = frozenset()

Values: TypeAlias = dict[str, tree.Term]
"""What parameters stand for."""

MAX_DEPTH = 200
MAX_SIZE = 100_000
MAX_QUANTIFIERS = 100
"""Limits of an expanded problem: levels of nesting, symbols, and quantifiers, each of which takes time."""


@dataclass(slots=True)
class Expander:
    """One expansion: the symbols it reads and the errors it found so far.

    With `run`, what has no definition is an error. Without, it stays as it is, and invariants,
    which are hints that no run depends on, are left out. `around` are the variables that programs around
    the definition that is being expanded change, `renamed` what quantifiers call their variables here, and
    `hidden` the variables that these stand for, which nothing that is called may mention.
    """

    symbols: Symbols
    run: bool = True
    found: list[Diagnostic] = field(default_factory=list[Diagnostic])
    expanded: int = 0
    solutions: dict[str, Solution | None] = field(default_factory=dict[str, Solution | None])
    around: Names = NONE
    renamed: set[str] = field(default_factory=set[str])
    hidden: Names = NONE
    reached: dict[str, Names] = field(default_factory=dict[str, Names])

    def term(self, term: tree.Term, values: dict[str, tree.Term], bound: Names) -> tree.Term:
        """`values` replaces parameters; `bound` are variables that programs around this term change, in the
        definition that it belongs to.
        """
        self._count(term)
        match term:
            case tree.Variable(name):
                if name in values:
                    return self._argument(name, values[name], term, bound)
                return self._called_term(name, (), term, bound)
            case tree.FuncOf(name, args):
                return self._called_term(name, tuple(self.term(a, values, bound) for a in args), term, bound)
            case tree.Number() | tree.DifferentialSymbol() | tree.UnitFunctional():
                return term
            case tree.Neg(child) | tree.Differential(child):
                return replace(term, child=self.term(child, values, bound))
            case tree.BinaryTerm():
                return replace(
                    term, left=self.term(term.left, values, bound), right=self.term(term.right, values, bound)
                )
            case _:
                assert_never(term)

    def _argument(self, name: str, value: tree.Term, use: tree.Variable, bound: Names) -> tree.Term:
        """What a parameter stands for, which no program between its definition and its use may change."""
        clash = free_variables(value) & bound - self.renamed if value != tree.Variable(name) else NONE
        if clash:
            self._refuse(errors.captured_argument(name, clash, use.span))
        return value

    def _written_name(self, program: tree.Assign | tree.AssignAny | tree.AtomicODE, values: Values) -> str:
        """The variable that a statement changes, which is not a parameter."""
        name = program.name
        if values.get(name, tree.Variable(name)) != tree.Variable(name):
            self._refuse(errors.parameter_written(name, program.span))
        return name

    def _refuse(self, diagnostic: Diagnostic) -> None:
        if diagnostic not in self.found:
            self.found.append(diagnostic)

    @contextmanager
    def _definition(self, bound: Names) -> Generator[None]:
        """Expand the body of a definition that is used below programs that change variables."""
        before, self.around = self.around, self.around | bound
        try:
            yield
        finally:
            self.around = before

    def _called_term(self, name: str, args: tuple[tree.Term, ...], use: tree.Term, bound: Names) -> tree.Term:
        if self.symbols.is_builtin(name, len(args)) and not (
            args == () and isinstance(use, tree.Variable) and name in self.symbols.declarations
        ):
            if name in DEFINED and self.run:
                parameters, text = DEFINED[name]
                values = dict(zip(parameters, args, strict=True))
                return self.term(_placed(parse_term(text), use.span), values, NONE)
            return tree.FuncOf(name, args, span=use.span)
        declaration = self.symbols.declarations.get(name)
        if declaration is None or self.symbols.roles[name] in ("variable", "constant"):
            return tree.FuncOf(name, args, span=use.span) if args else tree.Variable(name, span=use.span)
        if declaration.body is None:
            self._undefined(name, use)
            return tree.FuncOf(name, args, span=use.span)
        self._check_use(declaration, use, bound)
        if declaration.implicit:
            return self._solution(declaration, args, use, bound)
        with self._definition(bound):
            return self.term(_term_body(declaration), bound_parameters(declaration, args), NONE)

    def _solution(
        self, function: tree.Declaration, args: tuple[tree.Term, ...], use: tree.Term, bound: Names
    ) -> tree.Term:
        """A call of a function that is defined by a differential equation."""
        if not self.run:
            return tree.FuncOf(function.name, args, span=use.span)
        if function.name not in self.solutions:
            own = {n: tree.Variable(n) for n in own_names(function)}
            self.solutions[function.name] = solve(function, lambda term: self.term(term, dict(own), bound))
        solution = self.solutions[function.name]
        if solution is None:
            self.found.append(errors.implicit_function(function.name, function.span, use.span))
            return use
        return replace(solution(args[0]), span=use.span)

    def formula(self, formula: tree.Formula, values: dict[str, tree.Term], bound: Names) -> tree.Formula:
        self._count(formula)
        match formula:
            case tree.Truth() | tree.UnitPredicational() | tree.PredicationalOf():
                return formula
            case tree.Compare(_, left, right):
                return replace(
                    formula, left=self.term(left, values, bound), right=self.term(right, values, bound)
                )
            case tree.PredOf(name, args):
                return self._called_formula(
                    name, tuple(self.term(a, values, bound) for a in args), formula, bound
                )
            case tree.Not(child) | tree.DifferentialFormula(child):
                return replace(formula, child=self.formula(child, values, bound))
            case tree.Connective():
                return replace(
                    formula,
                    left=self.formula(formula.left, values, bound),
                    right=self.formula(formula.right, values, bound),
                )
            case tree.Quantified():
                name, child = formula.variable, formula.child
                own = self._bound_name(name, child, values)
                inner, before = {**values, name: tree.Variable(own)}, self.hidden
                if own != name:
                    self.renamed.add(own)
                    self.hidden |= {name} if self.symbols.roles.get(name) == "variable" else NONE
                child = self.formula(child, inner, bound | {own})
                self.hidden = before
                return replace(formula, variable=own, child=child)
            case tree.Modal():
                program, written = self.program(formula.program, values, bound)
                child = self.formula(formula.child, values, bound | written)
                return replace(formula, program=program, child=child)
            case _:
                assert_never(formula)

    def _called_formula(
        self, name: str, args: tuple[tree.Term, ...], use: tree.PredOf, bound: Names
    ) -> tree.Formula:
        declaration = self.symbols.declarations[name]
        if declaration.body is None:
            self._undefined(name, use)
            return replace(use, args=args)
        self._check_use(declaration, use, bound)
        with self._definition(bound):
            return self.formula(_formula_body(declaration), bound_parameters(declaration, args), NONE)

    def _bound_name(self, name: str, child: tree.Formula, values: dict[str, tree.Term]) -> str:
        """What a quantifier may call its variable: no name that arguments mention, and to run none of
        a constant or definition, which definitions in its scope may mention.
        """
        taken = {n for parameter, v in values.items() if parameter != name for n in free_variables(v)}
        if self.run and self.symbols.roles.get(name, "variable") != "variable":
            taken.add(name)
        if name in taken:
            taken |= {*self.symbols.declarations, *mentioned(child)}
        while name in taken:
            name += "_"
        return name

    def program(
        self, program: tree.Program, values: dict[str, tree.Term], bound: Names
    ) -> tuple[tree.Program, Names]:
        """The expanded program and the variables it may change."""
        self._count(program)
        match program:
            case tree.Assign(_, term):
                name = self._written_name(program, values)
                return replace(program, term=self.term(term, values, bound)), frozenset({name})
            case tree.AssignAny():
                return program, frozenset({self._written_name(program, values)})
            case tree.Test(formula):
                return replace(program, formula=self.formula(formula, values, bound)), NONE
            case tree.ProgramConst(name):
                body = _program_body(self.symbols.declarations[name])
                if body is None:
                    return program, NONE
                self._check_hidden(self.symbols.declarations[name], program.span)
                return self.program(_noted(body, program.annotations), {}, bound)
            case tree.ODESystem():
                return self._ode(program, values, bound)
            case tree.Compose(left, right):
                first, written = self.program(left, values, bound)
                second, more = self.program(right, values, bound | written)
                return replace(program, left=first, right=second), written | more
            case tree.Choice(left, right):
                first, written = self.program(left, values, bound)
                second, more = self.program(right, values, bound)
                return replace(program, left=first, right=second), written | more
            case tree.Loop(child) | tree.Dual(child):
                written = self._written(child)
                body, _ = self.program(child, values, bound | written)
                return self._without_hints(replace(program, child=body)), written
            case _:
                assert_never(program)

    def _ode(
        self, ode: tree.ODESystem, values: dict[str, tree.Term], bound: Names
    ) -> tuple[tree.Program, Names]:
        equations = [e for e in ode.equations if isinstance(e, tree.AtomicODE)]
        written = frozenset(self._written_name(e, values) for e in equations)
        inner = bound | written
        followed = tuple(
            replace(e, term=self.term(e.term, values, inner)) if isinstance(e, tree.AtomicODE) else e
            for e in ode.equations
        )
        domain = self.formula(ode.domain, values, inner)
        return self._without_hints(replace(ode, equations=followed, domain=domain)), written

    def _without_hints(self, program: tree.Loop | tree.Dual | tree.ODESystem) -> tree.Program:
        if self.run or isinstance(program, tree.Dual):
            return program
        return replace(program, invariants=())

    def _written(self, program: tree.Program) -> Names:
        """The variables that a program, its calls included, may change."""
        found: set[str] = set()
        calls: set[str] = set()
        stack: list[Node] = [program]
        while stack:
            node = stack.pop()
            match node:
                case tree.Assign(name) | tree.AssignAny(name) | tree.AtomicODE(name):
                    found.add(name)
                case tree.ProgramConst(name) if name not in calls:
                    calls.add(name)
                    body = _program_body(self.symbols.declarations[name])
                    stack += [] if body is None else [body]
                case _:
                    stack += children(node)
        return frozenset(found)

    def _undefined(self, name: str, use: tree.Term | tree.Formula) -> None:
        if self.run:
            self.found.append(errors.undefined_function(name, use.span))

    def _count(self, node: tree.Expression) -> None:
        spend()
        self.expanded += 1
        if self.expanded > MAX_SIZE:
            raise CompileError(errors.too_large(node.span, MAX_SIZE))

    def _check_use(self, declaration: tree.Declaration, use: tree.Term | tree.Formula, bound: Names) -> None:
        names = self._behind(declaration) if declaration.implicit else self._free(declaration)
        if clash := names & (bound | self.around):
            self._refuse(errors.captured(declaration.name, clash, use.span))
        self._check_hidden(declaration, use.span)

    def _check_hidden(self, declaration: tree.Declaration, use: Span) -> None:
        """A quantifier that has another name now would no longer bind what a definition mentions."""
        if self.hidden and (clash := self._behind(declaration) & self.hidden):
            self._refuse(errors.captured(declaration.name, clash, use, bound=True))

    def _behind(self, declaration: tree.Declaration) -> Names:
        if declaration.name not in self.reached:
            self.reached[declaration.name] = reached_by(declaration, self.symbols)
        return self.reached[declaration.name]

    def _free(self, declaration: tree.Declaration) -> Names:
        """Program variables that a body mentions itself, other than as parameters."""
        names = NONE if declaration.body is None else free_variables(declaration.body)
        return frozenset(n for n in names - own_names(declaration) if self.symbols.roles.get(n) == "variable")


def expanded_formula(formula: tree.Formula, symbols: Symbols, run: bool = True) -> tree.Formula:
    """The formula without definitions, to `run` or only to be shown.

    Raises `CompileError` for captures, for missing bodies of what is to run, and for a result
    beyond the limits.
    """
    expander = Expander(symbols, run)
    try:
        result = expander.formula(formula, {}, NONE)
    except RecursionError:
        raise CompileError(errors.too_deep(formula.span, MAX_DEPTH)) from None
    if expander.found:
        raise CompileError(expander.found)
    _check_size(result, run)
    return result


def _check_size(formula: tree.Formula, run: bool) -> None:
    """Arguments are shared, so that a result may be far larger than the work of building it.

    Counted as later stages see it: they write both sides of `<->` twice.
    """
    size = quantifiers = 0
    stack: list[tuple[Node, int, int]] = [(formula, 1, 1)]
    while stack:
        node, depth, copies = stack.pop()
        size += copies
        if depth > MAX_DEPTH:
            raise CompileError(errors.too_deep(formula.span, MAX_DEPTH))
        if size > MAX_SIZE:
            raise CompileError(errors.too_large(formula.span, MAX_SIZE))
        quantifiers += copies if isinstance(node, tree.Quantified) else 0
        if run and quantifiers > MAX_QUANTIFIERS:
            raise CompileError(errors.too_many_quantifiers(node.span, MAX_QUANTIFIERS))
        copies *= 2 if isinstance(node, tree.Equiv) else 1
        stack += [(child, depth + 1, copies) for child in children(node)]


def _placed(term: tree.Term, span: Span) -> tree.Term:
    """A term of ours, as if the user had written it at a place."""
    match term:
        case tree.BinaryTerm():
            return type(term)(_placed(term.left, span), _placed(term.right, span), span=span)
        case tree.Neg(child):
            return tree.Neg(_placed(child, span), span=span)
        case tree.FuncOf(name, args):
            return tree.FuncOf(name, tuple(_placed(a, span) for a in args), span=span)
        case _:
            return replace(term, span=span)


def bound_parameters(declaration: tree.Declaration, args: tuple[tree.Term, ...]) -> dict[str, tree.Term]:
    """What the parameters of a definition stand for in a call with these arguments."""
    return {p.name: a for p, a in zip(declaration.parameters or (), args, strict=True)}


def _term_body(declaration: tree.Declaration) -> tree.Term:
    body = declaration.body
    assert isinstance(body, tree.Term), "bind checks sorts"
    return body


def _formula_body(declaration: tree.Declaration) -> tree.Formula:
    body = declaration.body
    assert isinstance(body, tree.Formula), "bind checks sorts"
    return body


def _noted(program: tree.Program, notes: tuple[tree.Annotation, ...]) -> tree.Program:
    """The program with annotations before the statement with which it begins."""
    match program:
        case _ if not notes:
            return program
        case tree.Compose(left=first) | tree.Choice(left=first):
            return replace(program, left=_noted(first, notes))
        case tree.Loop(child) | tree.Dual(child):
            return replace(program, child=_noted(child, notes))
        case _:
            return replace(program, annotations=(*program.annotations, *notes))


def _program_body(declaration: tree.Declaration) -> tree.Program | None:
    body = declaration.body
    assert body is None or isinstance(body, tree.Program), "bind checks sorts"
    return body
