"""From the concrete syntax tree to terms, formulas and programs.

In: lark trees of grammar.lark. Out: nodes of tree.py with spans. The place of an expression
asks for a sort; an expression of the other sort is an error there. `if`, `<-`, demonic choice
and repetition, and tuples of arguments are resolved, as KeYmaera X does while parsing; the holes
`__________` of exercises become the symbols that it gives them (`exerciseF_` and the like).
Assumes trees no deeper than `syntax.MAX_DEPTH`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TypeAlias, cast

from lark import Token, Tree

from dl2c.diagnostics import CompileError, Diagnostic, together
from dl2c.parse import errors
from dl2c.parse import tree as ast
from dl2c.parse.syntax import Node, Recovery
from dl2c.source import Source, Span
from dl2c.work import spend

Child: TypeAlias = Node | Token | None

MAX_DIGITS = 400
_TERMS = frozenset(
    {"number", "primed_name", "neg", "power", "product", "sum", "name", "call", "space_call", "hole", "dot"}
)


@dataclass(frozen=True, slots=True)
class Reading:
    """One text being read, and the warnings found so far (appended to while reading). With a `recovery`
    reading goes on behind mistakes.

    `annotations` are those inside programs, by the place of the statement that they stand before.
    `anonymous` are the names given to the parameters without name that `.`, `._0`, `._1` mean.
    """

    source: Source
    warnings: list[Diagnostic]
    annotations: Mapping[int, tuple[ast.Annotation, ...]]
    anonymous: tuple[str, ...] = ()
    recovery: Recovery | None = None

    def stands_in(self, span: Span) -> bool:
        """Whether this is not a text of the user, but stands in for a mistake."""
        return self.recovery is not None and any(a <= span.start < b for a, b in self.recovery.gaps)

    def before(self, statement: Span) -> tuple[ast.Annotation, ...]:
        """The annotations that stand before a statement."""
        return self.annotations.get(statement.start, ())

    def span(self, part: Node | Token) -> Span:
        match part:
            case Token(start_pos=int(start), end_pos=int(end)):
                return Span(self.source, start, end)
            case Tree(meta=meta):
                return Span(self.source, meta.start_pos, meta.end_pos)
            case _:
                raise AssertionError(part)


def parts(node: Node) -> list[Child]:
    """The children of a node; an optional part that is not there is None."""
    return cast("list[Child]", node.children)


def nodes(children: Sequence[Child]) -> list[Node]:
    return [child for child in children if isinstance(child, Tree)]


# ---------------------------------------------------------------- terms


def term(node: Node, read: Reading) -> ast.Term:
    """Read `node` as a term."""
    spend()
    span = read.span(node)
    match str(node.data), parts(node):
        case "number", [Token() as digits]:
            return _number(digits, span)
        case "hole", _:
            return ast.UnitFunctional("exerciseF_", (), span=span)
        case "dot", [Token() as dot]:
            return ast.Variable(_argument(dot, read), span=span)
        case "name", [Token() as name]:
            return ast.Variable(str(name), span=span)
        case "primed_name", [Token() as name, _]:
            return ast.DifferentialSymbol(str(name), span=span)
        case "call", [Token() as name, *arguments, prime]:
            return _primed_term(ast.FuncOf(str(name), _arguments(arguments, read), span=span), prime, span)
        case "space_call", [Token() as name, Token() as space, prime]:
            return _primed_term(ast.UnitFunctional(str(name), _taboo(space), span=span), prime, span)
        case "paren", [Tree() as inner, prime]:
            if prime is None and _is_literal_zero(inner):
                return ast.Number(Fraction(0), span=span)
            return _primed_term(replace(term(inner, read), span=span), prime, span)
        case "paren", _:
            raise CompileError(errors.stray_tuple(span))
        case "neg", [_, Tree() as child]:
            return ast.Neg(term(child, read), span=span)
        case "power", [Tree() as left, Tree() as right]:
            return ast.Power(term(left, read), term(right, read), span=span)
        case "product", [Tree() as first, *rest]:
            return _product(first, rest, read)
        case "sum", [Tree() as first, *rest]:
            return _sum(first, rest, read)
        case _:
            raise CompileError(errors.wrong_sort(span, "term", "formula"))


def _argument(dot: Token, read: Reading) -> str:
    """The name of the parameter without name that `dot` stands for."""
    if not read.anonymous:
        raise CompileError(errors.axiom_dot(read.span(dot)))
    place = int(dot[2:] or "0")
    if place >= len(read.anonymous) or (dot == "." and len(read.anonymous) != 1):
        raise CompileError(errors.stray_dot(read.span(dot)))
    return read.anonymous[place]


def _number(digits: Token, span: Span) -> ast.Number:
    if len(digits) > MAX_DIGITS:
        raise CompileError(errors.too_many_digits(span, MAX_DIGITS))
    return ast.Number(Fraction(str(digits)), span=span)


def _primed_term(inner: ast.Term, prime: Child, span: Span) -> ast.Term:
    return inner if prime is None else ast.Differential(inner, span=span)


def _is_literal_zero(inner: Node) -> bool:
    """`(-0)` is the literal 0 for KeYmaera X, unlike `(- 0)` and `-0`."""
    match str(inner.data), parts(inner):
        case "neg", [Token(end_pos=sign_end), Tree(data="number", children=[Token() as digits])]:
            return sign_end == digits.start_pos and not digits.strip("0.")
        case _:
            return False


def _arguments(children: Sequence[Child], read: Reading) -> tuple[ast.Term, ...]:
    """The arguments of a call; `f((a,(b,c)))` is `f(a,b,c)`."""
    arguments: list[ast.Term] = []
    for child in nodes(children):
        match str(child.data), parts(child):
            case "paren", [*items, None] if len(items) > 1:
                arguments += _arguments(items, read)
            case _:
                arguments.append(term(child, read))
    return tuple(arguments)


def _taboo(token: Token) -> tuple[str, ...]:
    """The names between the bars of `(|x,y|)` or `{|x,y|}`."""
    return tuple(name for part in token[2:-2].split(",") if (name := part.strip()))


def _pairs(rest: Sequence[Child]) -> list[tuple[Token, Node]]:
    """`op operand op operand ...` as pairs."""
    return cast("list[tuple[Token, Node]]", list(zip(rest[::2], rest[1::2], strict=True)))


def _sum(first: Node, rest: Sequence[Child], read: Reading) -> ast.Term:
    left = term(first, read)
    for op, operand in _pairs(rest):
        right = term(operand, read)
        node = ast.Plus if op == "+" else ast.Minus
        left = node(left, right, span=left.span.to(right.span))
    return left


def _product(first: Node, rest: Sequence[Child], read: Reading) -> ast.Term:
    """A chain of `*` and `/`, left associative but for the sign rule of KeYmaera X:

    an unparenthesised `-` after `*` takes the rest of the chain, and so does one after `/`
    unless `*` or nothing follows: `x*-y*z` = x*(-(y*z)), `x/-y/z` = x/(-(y/z)), `x/-y*z` = (x/(-y))*z.
    """
    chain = _pairs(rest)
    outer: list[tuple[Token, ast.Term]] = []
    left = term(first, read)
    for (op, operand), following in zip(chain, [*chain[1:], None], strict=True):
        takes_rest = operand.data == "neg" and (op == "*" or (following is not None and following[0] == "/"))
        right = term(operand, read)
        if takes_rest and isinstance(right, ast.Neg):
            outer.append((op, left))
            left = right.child
        else:
            left = _multiply(op, left, right)
    for op, factor in reversed(outer):
        left = _multiply(op, factor, ast.Neg(left, span=left.span))
    return left


def _multiply(op: Token, left: ast.Term, right: ast.Term) -> ast.Term:
    node = ast.Times if op == "*" else ast.Divide
    return node(left, right, span=left.span.to(right.span))


# ---------------------------------------------------------------- formulas


def formula(node: Node, read: Reading) -> ast.Formula:
    """Read `node` as a formula."""
    span = read.span(node)
    match str(node.data), parts(node):
        case "truth", [Token() as word]:
            return ast.Truth(word == "true", span=span)
        case "comparison", [Tree() as left, Token() as op, Tree() as right]:
            return ast.Compare(_comparison(op), term(left, read), term(right, read), span=span)
        case "hole", _:
            return ast.UnitPredicational("exerciseP_", (), span=span)
        case "name", [Token() as name]:
            return (
                ast.Truth(True, span=span) if read.stands_in(span) else ast.PredOf(str(name), (), span=span)
            )
        case "call", [Token() as name, *arguments, prime]:
            return _primed_formula(ast.PredOf(str(name), _arguments(arguments, read), span=span), prime, span)
        case "space_call", [Token() as name, Token() as space, prime]:
            return _primed_formula(ast.UnitPredicational(str(name), _taboo(space), span=span), prime, span)
        case "predicational", [Token() as name, _, Tree() as child]:
            return ast.PredicationalOf(str(name), formula(child, read), span=span)
        case "paren", [Tree() as inner, prime]:
            return _primed_formula(replace(formula(inner, read), span=span), prime, span)
        case "paren", _:
            raise CompileError(errors.stray_tuple(span))
        case "not", [Tree() as child]:
            return ast.Not(formula(child, read), span=span)
        case "and" | "or" | "imply" as op, operands:
            return _connect(op, operands, read)
        case "reverse", [Tree() as left, Tree() as right]:
            conclusion = formula(left, read)
            return ast.Imply(formula(right, read), conclusion, span=span)
        case "equiv", [Tree() as left, _, Tree() as right]:
            return ast.Equiv(formula(left, read), formula(right, read), span=span)
        case "quantified", [Token() as quantifier, Tree() as names, Tree() as child]:
            return _quantified(quantifier, names, formula(child, read), span)
        case "box", [Tree() as body, Tree() as child]:
            return ast.Box(*_modality(body, child, read), span=span)
        case "diamond", [_, Tree() as body, _, Tree() as child]:
            return ast.Diamond(*_modality(body, child, read), span=span)
        case _:
            raise CompileError(errors.wrong_sort(span, "formula", "term"))


def _comparison(op: Token) -> ast.Comparison:
    ascii_form = {"≠": "!=", "≤": "<=", "≥": ">="}.get(str(op), str(op))
    return cast("ast.Comparison", ascii_form)


def _primed_formula(inner: ast.Formula, prime: Child, span: Span) -> ast.Formula:
    return inner if prime is None else ast.DifferentialFormula(inner, span=span)


def _connect(op: str, operands: Sequence[Child], read: Reading) -> ast.Formula:
    """A right associative chain of one connective."""
    for token in operands:
        if isinstance(token, Token) and token in ("&&", "||"):
            read.warnings.append(errors.doubled_connective(read.span(token)))
    *firsts, right = together(lambda o=o: formula(o, read) for o in nodes(operands))
    connective = {"and": ast.And, "or": ast.Or, "imply": ast.Imply}[op]
    for left in reversed(firsts):
        right = connective(left, right, span=left.span.to(right.span))
    return right


def _modality(body: Node, child: Node, read: Reading) -> tuple[ast.Program, ast.Formula]:
    inner, after = together((lambda: program(body, read), lambda: formula(child, read)))
    return cast("ast.Program", inner), cast("ast.Formula", after)


def _quantified(quantifier: Token, names: Node, child: ast.Formula, span: Span) -> ast.Formula:
    """`\\forall x,y P` is `\\forall y \\forall x P`."""
    node = ast.Forall if quantifier in ("\\forall", "∀") else ast.Exists
    for name in parts(names):
        child = node(str(name), child, span=span)
    return child


def value(node: Node, read: Reading) -> ast.Term | ast.Formula:
    """Read `node` as a term if it can be one, else as a formula."""
    inner = node
    while inner.data == "paren":
        inner = nodes(parts(inner))[0]
    return term(node, read) if inner.data in _TERMS else formula(node, read)


# ---------------------------------------------------------------- programs


def program(node: Node, read: Reading) -> ast.Program:
    """Read `node` as a program."""
    spend()
    span = read.span(node)
    notes = read.before(span)
    match str(node.data), parts(node):
        case "choice", alternatives:
            return _choice(alternatives, read)
        case "sequence" | "open_sequence", statements:
            return _sequence(nodes(statements), read)
        case "open_statement", [Tree() as statement]:
            read.warnings.append(errors.open_statement(Span(read.source, span.end - 1, span.end)))
            return program(statement, read)
        case "statement", [Tree() as base, dual, _]:
            inner = program(base, read)
            return inner if dual is None else ast.Dual(inner, span=span)
        case "block", [Tree() as inner]:
            return replace(program(inner, read), span=span)
        case "loop", [Tree() as block, Token() as star, invariants]:
            return _loop(block, star, _invariants(invariants, read), read, span)
        case "if", [_, Tree() as condition, Tree() as then, _, otherwise]:
            return _if(condition, then, otherwise, read, span)
        case "assign", [Token() as name, prime, Token()]:
            return ast.AssignAny(str(name), prime is not None, annotations=notes, span=span)
        case "assign", [Token() as name, prime, Tree() as value]:
            return ast.Assign(str(name), term(value, read), prime is not None, annotations=notes, span=span)
        case "test", [Tree() as condition]:
            return ast.Test(formula(condition, read), annotations=notes, span=span)
        case "call_program", [Token() as name, *dual]:
            if read.stands_in(span):
                return ast.Test(ast.Truth(True), span=span)
            called = "exerciseS_" if name.type == "HOLE" else str(name)
            call = ast.ProgramConst(called, annotations=notes, span=span)
            return ast.Dual(call, span=span) if dual else call
        case "ode", [Tree() as flow]:
            return _ode(flow, (), read, span)
        case "ode_block", [Tree() as flow, invariants]:
            return _ode(flow, _invariants(invariants, read), read, span)
        case unknown:
            raise AssertionError(unknown)


def _sequence(statements: Sequence[Node], read: Reading) -> ast.Program:
    *firsts, last = together(lambda s=s: program(s, read) for s in statements)
    right = last
    for left in reversed(firsts):
        right = ast.Compose(left, right, span=left.span.to(right.span))
    return right


def _choice(alternatives: Sequence[Child], read: Reading) -> ast.Program:
    """`a ++ b` and `a -- b`, right associative at one level; `a -- b` is `{{a}^@ ++ {b}^@}^@`."""
    *firsts, right = together(lambda a=a: program(a, read) for a in nodes(alternatives))
    for left, op in reversed(list(zip(firsts, alternatives[1::2], strict=True))):
        span = left.span.to(right.span)
        if op in ("++", "∪"):
            right = ast.Choice(left, right, span=span)
        else:
            duals = ast.Dual(left, span=left.span), ast.Dual(right, span=right.span)
            right = ast.Dual(ast.Choice(*duals, span=span), span=span)
    return right


def _loop(
    block: Node, star: Token, invariants: tuple[ast.Formula, ...], read: Reading, span: Span
) -> ast.Program:
    child = program(block, read)
    if star == "*":
        return ast.Loop(child, invariants, span=span)
    return ast.Dual(ast.Loop(ast.Dual(child, span=child.span), invariants, span=span), span=span)


def _if(condition: Node, then: Node, otherwise: Child, read: Reading, span: Span) -> ast.Program:
    """`if (c) {a} else {b}` is `{?c; {a}} ++ {?!c; {b}}`; without else the second branch is `?!c;`."""
    holds = formula(condition, read)
    notes = read.before(span)
    marks = tuple(note for note in notes if note.name == "fallback")  # a choice begins but once
    fails = ast.Test(ast.Not(holds, span=holds.span), annotations=marks, span=holds.span)
    first = ast.Compose(ast.Test(holds, annotations=notes, span=holds.span), program(then, read), span=span)
    last = ast.Compose(fails, program(otherwise, read), span=span) if isinstance(otherwise, Tree) else fails
    return ast.Choice(first, last, span=span)


def _ode(flow: Node, invariants: tuple[ast.Formula, ...], read: Reading, span: Span) -> ast.ODESystem:
    *equations, conjunction, domain = parts(flow)
    if isinstance(conjunction, Token) and conjunction == "&&":
        read.warnings.append(errors.doubled_connective(read.span(conjunction)))
    constraint = formula(domain, read) if isinstance(domain, Tree) else ast.Truth(True, span=span)
    rates = tuple(_equation(equation, read) for equation in nodes(equations))
    return ast.ODESystem(rates, constraint, invariants, annotations=read.before(rates[0].span), span=span)


def _equation(node: Node, read: Reading) -> ast.AtomicODE | ast.DifferentialProgramConst:
    span = read.span(node)
    match str(node.data), parts(node):
        case "derivative", [Token() as name, _, Tree() as value]:
            return ast.AtomicODE(str(name), term(value, read), span=span)
        case "flow_hole", _:
            return ast.DifferentialProgramConst("exerciseD_", span=span)
        case "flow_symbol", [Token() as name, space]:
            taboo = _taboo(space) if isinstance(space, Token) else None
            return ast.DifferentialProgramConst(str(name), taboo, span=span)
        case unknown:
            raise AssertionError(unknown)


def _invariants(node: Child, read: Reading) -> tuple[ast.Formula, ...]:
    return tuple(formula(child, read) for child in nodes(parts(node))) if isinstance(node, Tree) else ()
