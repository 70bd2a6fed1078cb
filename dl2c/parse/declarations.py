"""Reading one declaration of a `Definitions` or `ProgramVariables` block.

In: the range of one declaration, `Real c, d;` up to its `;`. Out: `Declaration`s without their
annotations, which archive.py attaches.
"""

import re
from collections.abc import Sequence

from lark import Token, Tree

from dl2c.diagnostics import CompileError
from dl2c.parse import build, errors
from dl2c.parse.build import Child, Node, Reading
from dl2c.parse.scan import Code
from dl2c.parse.syntax import parse_tree
from dl2c.parse.tree import Declaration, Expression, Parameter, Sort

_SORTS: dict[str, Sort] = {
    **{"Real": "Real", "Bool": "Bool", "HP": "HP", "HG": "HP"},
    **{"R": "Real", "T": "Real", "B": "Bool", "F": "Bool", "P": "HP"},
}
"""Of both dialects."""

_IMPORT = re.compile(
    r"import\s+(?P<package>[A-Za-z]\w*(?:\.[A-Za-z]\w*)*)\."
    r"(?:(?P<name>[A-Za-z]\w*|\*)|\{(?P<names>\s*[A-Za-z]\w*\s*(?:,\s*[A-Za-z]\w*\s*)*)\})\s*;\s*\Z"
)
_IMPLICIT_NAMES = re.compile(r"([A-Za-z]\w*)\s*\(")


def read_definition(code: Code, start: int, end: int, read: Reading) -> tuple[Declaration, ...]:
    """The declarations of one statement of a Definitions block."""
    node = parse_tree(code, start, end, "declaration")
    match str(node.data), build.parts(node):
        case "declared", [Token() as sort, *items]:
            declared = tuple(_declaration(sort, item, None, read) for item in build.nodes(items))
            if _SORTS[sort] == "HP":
                raise CompileError(errors.undefined_program(d.span, d.name) for d in declared)
            return declared
        case "defined_term", [Token() as sort, Tree() as item, Tree() as body]:
            _check_sign(sort, "Real", "=", read)
            return (_declaration(sort, item, build.term(body, read), read),)
        case "defined_formula", [Token() as sort, Tree() as item, _, Tree() as body]:
            _check_sign(sort, "Bool", "<->", read)
            return (_declaration(sort, item, build.formula(body, read), read),)
        case "defined_program", [Token() as sort, Tree() as item, Tree() as body]:
            _check_sign(sort, "HP", "::=", read)
            return (_declaration(sort, item, build.program(body, read), read),)
        case unknown:
            raise AssertionError(unknown)


def read_variables(code: Code, start: int, end: int, read: Reading) -> tuple[Declaration, ...]:
    """The program variables of one statement of a ProgramVariables block."""
    node = parse_tree(code, start, end, "declaration")
    match str(node.data), build.parts(node):
        case "declared", [Token() as sort, *items]:
            variables = tuple(_declaration(sort, item, None, read) for item in build.nodes(items))
            if _SORTS[sort] == "HP" or any(variable.parameters is not None for variable in variables):
                raise CompileError(errors.not_a_real(read.span(node)))
            return variables
        case _:
            raise CompileError(errors.defined_variable(read.span(node)))


def _check_sign(sort: Token, wanted: Sort, sign: str, read: Reading) -> None:
    if _SORTS[sort] != wanted:
        expected = {"Real": "=", "Bool": "<->", "HP": "::="}[_SORTS[sort]]
        raise CompileError(errors.not_defined_with(read.span(sort), str(sort), sign, expected))


def _declaration(sort: Token, item: Node, body: Expression | None, read: Reading) -> Declaration:
    name, parameters = build.parts(item)
    assert isinstance(name, Token)
    span = read.span(name)
    if parameters is None:
        return Declaration(_SORTS[sort], str(name), None, body, span=span)
    assert isinstance(parameters, Tree)
    if _SORTS[sort] == "HP":
        raise CompileError(errors.program_parameters(span))
    named = _parameters(build.parts(parameters), body is not None, read)
    return Declaration(_SORTS[sort], str(name), named, body, span=span)


def _parameters(children: Sequence[Child], defined: bool, read: Reading) -> tuple[Parameter, ...]:
    """Where no body uses them, KeYmaera X 4 lets parameters be without names: they get `x1`, `x2`, ..."""
    parameters: list[Parameter] = []
    for place, node in enumerate(build.nodes(children), 1):
        sort, name = build.parts(node)
        assert isinstance(sort, Token)
        if name is None and defined:
            raise CompileError(errors.unnamed_parameter(read.span(node)))
        if _SORTS[sort] != "Real":
            raise CompileError(errors.parameter_sort(read.span(node), str(sort)))
        if isinstance(name, Token):
            parameters.append(Parameter(str(name), span=read.span(name)))
        else:
            parameters.append(Parameter(f"x{place}", span=read.span(node)))
    return tuple(parameters)


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
    names = statement.group("names") or statement.group("name")
    return tuple(f"{package}.{name.strip()}" for name in names.split(","))


def refuse_implicit(code: Code, start: int, end: int) -> CompileError:
    """The error for `implicit Real f(Real t), ... = {...};`."""
    head = code.text[start:end].split("=")[0]
    span = code.span(start, start + len(head.rstrip()))
    return CompileError(
        errors.implicit_definition(span, ", ".join(f"`{n}`" for n in _IMPLICIT_NAMES.findall(head)))
    )
