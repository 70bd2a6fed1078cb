"""Reading one declaration of a `Definitions` or `ProgramVariables` block.

In: the range of one declaration, `Real c, d;` up to its `;`. Out: `Declaration`s without their
annotations, which archive.py attaches.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import count

from lark import Token, Tree

from dl2c.diagnostics import CompileError
from dl2c.ir.functions import KYX_MATH
from dl2c.parse import build, errors
from dl2c.parse.build import Node, Reading
from dl2c.parse.scan import Code
from dl2c.parse.syntax import parse_tree
from dl2c.parse.tree import (
    Assign,
    AtomicODE,
    Compose,
    Declaration,
    Expression,
    ODESystem,
    Parameter,
    Program,
    Sort,
    Truth,
)

SORTS: dict[str, Sort] = {
    "Real": "Real",
    "R": "Real",
    "T": "Real",
    "Bool": "Bool",
    "B": "Bool",
    "F": "Bool",
    "HP": "HP",
    "HG": "HP",
    "P": "HP",
}
_IMPORT = re.compile(
    r"import\s+(?P<package>[A-Za-z]\w*(?:\.[A-Za-z]\w*)*)\."
    r"(?:(?P<name>[A-Za-z]\w*|\*)|\{(?P<names>\s*[A-Za-z]\w*\s*(?:,\s*[A-Za-z]\w*\s*)*)\})\s*;\s*\Z"
)


def read_definition(code: Code, start: int, end: int, read: Reading) -> tuple[Declaration, ...]:
    """The declarations of one statement of a Definitions block."""
    node = parse_tree(code, start, end, "declaration", read.recovery)
    match str(node.data), build.parts(node):
        case "declared", [Token() as sort, *items]:
            declared = tuple(_declaration(sort, item, None, read) for item in build.nodes(items))
            if SORTS[sort] == "HP":
                raise CompileError(errors.undefined_program(d.span, d.name) for d in declared)
            return declared
        case "defined_term", [Token() as sort, Tree() as item, Tree() as body]:
            _check_sign(sort, "Real", "=", read)
            return (_declaration(sort, item, build.term(body, _anonymous(item, body, read)), read, body),)
        case "defined_formula", [Token() as sort, Tree() as item, _, Tree() as body]:
            _check_sign(sort, "Bool", "<->", read)
            return (_declaration(sort, item, build.formula(body, _anonymous(item, body, read)), read, body),)
        case "defined_program", [Token() as sort, Tree() as item, Tree() as body]:
            _check_sign(sort, "HP", "::=", read)
            return (_declaration(sort, item, build.program(body, read), read),)
        case "defined_implicitly", [Token() as sort, *items, Tree() as body]:
            return _implicit(sort, build.nodes(items), build.program(body, read), read)
        case unknown:
            raise AssertionError(unknown)


def _implicit(sort: Token, items: Sequence[Node], body: Program, read: Reading) -> tuple[Declaration, ...]:
    """Functions of time that solve a differential equation: `{{f := 1;} {f' = f}}`."""
    if SORTS[sort] != "Real":
        raise CompileError(errors.implicit_sort(read.span(sort), str(sort)))
    declared = tuple(_declaration(sort, item, body, read) for item in items)
    start, flow = _in_order(body)[:-1], _in_order(body)[-1]
    if not isinstance(flow, ODESystem) or flow.domain != Truth(True):
        raise CompileError(errors.implicit_shape(flow.span))
    problems = [errors.implicit_shape(s.span) for s in start if not isinstance(s, Assign) or s.differential]
    problems += [errors.implicit_shape(e.span) for e in flow.equations if not isinstance(e, AtomicODE)]
    given = {s.name for s in start if isinstance(s, Assign)}
    moving = {e.name for e in flow.equations if isinstance(e, AtomicODE)}
    for function in declared:
        if len(function.parameters or ()) != 1:
            problems.append(errors.implicit_parameter(function.span, function.name))
        elif function.name not in given & moving:
            problems.append(errors.implicit_unsolved(function.span, function.name))
    if problems:
        raise CompileError(problems)
    return declared


def _in_order(program: Program) -> list[Program]:
    """The statements of a sequence."""
    if isinstance(program, Compose):
        return [*_in_order(program.left), *_in_order(program.right)]
    return [program]


def read_variables(code: Code, start: int, end: int, read: Reading) -> tuple[Declaration, ...]:
    """The program variables of one statement of a ProgramVariables block."""
    node = parse_tree(code, start, end, "declaration", read.recovery)
    match str(node.data), build.parts(node):
        case "declared", [Token() as sort, *items]:
            variables = tuple(_declaration(sort, item, None, read) for item in build.nodes(items))
            if SORTS[sort] == "HP" or any(variable.parameters is not None for variable in variables):
                raise CompileError(errors.not_a_real(read.span(node)))
            return variables
        case _:
            raise CompileError(errors.defined_variable(read.span(node)))


def _check_sign(sort: Token, wanted: Sort, sign: str, read: Reading) -> None:
    if SORTS[sort] != wanted:
        expected = {"Real": "=", "Bool": "<->", "HP": "::="}[SORTS[sort]]
        raise CompileError(errors.not_defined_with(read.span(sort), str(sort), sign, expected))


def _declaration(
    sort: Token, item: Node, body: Expression | None, read: Reading, written: Node | None = None
) -> Declaration:
    """`written` is the text of a body in which parameters without name may occur."""
    name, parameters = build.parts(item)
    assert isinstance(name, Token)
    span = read.span(name)
    if parameters is None:
        return Declaration(SORTS[sort], str(name), None, body, span=span)
    if SORTS[sort] == "HP":
        raise CompileError(errors.program_parameters(span))
    return Declaration(SORTS[sort], str(name), _parameters(item, written, read), body, span=span)


def _parameters(item: Node, body: Node | None, read: Reading) -> tuple[Parameter, ...]:
    """The parameters; those without name, which KeYmaera X 4 allows, get names the body does not have."""
    parameters: list[Parameter] = []
    taken = {str(token) for part in (item, body) if part for token in part.scan_values(lambda _: True)}
    for place, node in enumerate(_parameter_nodes(item), 1):
        sort, name = build.parts(node)
        assert isinstance(sort, Token)
        if SORTS[sort] != "Real":
            raise CompileError(errors.parameter_sort(read.span(node), str(sort)))
        fresh = next(n for i in count() if (n := f"x{place}_{i}" if i else f"x{place}") not in taken)
        text, part = (str(name), name) if isinstance(name, Token) else (fresh, node)
        parameters.append(Parameter(text, span=read.span(part)))
    return tuple(parameters)


def _parameter_nodes(item: Node) -> list[Node]:
    _, parameters = build.parts(item)
    return build.nodes(build.parts(parameters)) if isinstance(parameters, Tree) else []


def _anonymous(item: Node, body: Node, read: Reading) -> Reading:
    """The reading of a body whose parameters have no names."""
    unnamed = [node for node in _parameter_nodes(item) if build.parts(node)[1] is None]
    if not unnamed:
        return read
    return replace(read, anonymous=tuple(p.name for p in _parameters(item, body, read)))


def read_import(code: Code, start: int, end: int, read: Reading) -> tuple[str, ...]:
    """The names that one `import` brings in, in full; `import kyx.math.*;` gives `kyx.math.*`."""
    statement = _IMPORT.match(code.text[start:end])
    span = code.span(start, start + len(code.text[start:end].rstrip()))
    if statement is None:
        raise CompileError(errors.malformed_import(span))
    package = statement.group("package")
    if package.split(".")[0] == "keyx":
        read.warnings.append(errors.misspelt_package(span))
        package = "kyx" + package.removeprefix("keyx")
    names = [n.strip() for n in (statement.group("names") or statement.group("name")).split(",")]
    unknown = names if package != "kyx.math" else [n for n in names if n not in (*KYX_MATH, "*")]
    if unknown:
        raise CompileError(errors.unknown_import(span, f"{package}.{n}", sorted(KYX_MATH)) for n in unknown)
    return tuple(f"{package}.{name}" for name in names)
