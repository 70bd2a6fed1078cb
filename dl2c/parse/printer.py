"""Syntax trees as KeYmaera X text.

In: trees of tree.py. Out: text with the fewest parentheses that read well, such that parsing it
gives the same tree. A minus sign is only left bare at the start of a sum.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import assert_never, cast

from dl2c.ir.printer import decimal_places
from dl2c.parse import tree
from dl2c.parse.archive import read_archive
from dl2c.parse.comments import read_annotations
from dl2c.parse.scan import scan
from dl2c.source import Source

SUM, PRODUCT, POWER, ATOM = range(4)
"""How strongly a term binds."""

EQUIV, IMPLY, OR, AND, UNARY = range(5)
"""How strongly a formula binds."""

INFIX: dict[type, tuple[str, int, int, int]] = {
    tree.Plus: (" + ", SUM, SUM, PRODUCT),
    tree.Minus: (" - ", SUM, SUM, PRODUCT),
    tree.Times: ("*", PRODUCT, PRODUCT, POWER),
    tree.Divide: ("/", PRODUCT, PRODUCT, POWER),
    tree.Power: ("^", POWER, ATOM, POWER),
    tree.And: (" & ", AND, UNARY, AND),
    tree.Or: (" | ", OR, AND, OR),
    tree.Imply: (" -> ", IMPLY, OR, IMPLY),
    tree.Equiv: (" <-> ", EQUIV, IMPLY, IMPLY),
}
"""How operators are written, how strongly they bind, and how strongly their operands have to."""

CHOICE, SEQUENCE, STATEMENT = range(3)
"""How strongly a program binds."""

INDENT = "  "

WIDTH = 90
"""A part of a Problem that is longer is broken into lines."""


def print_term(term: tree.Term) -> str:
    """The term as text."""
    return _term(term, SUM)


def print_formula(formula: tree.Formula) -> str:
    """The formula as text, on one line."""
    return _formula(formula, EQUIV)


def print_program(program: tree.Program) -> str:
    """The program as text, on one line."""
    return _program(program, CHOICE)


# ---------------------------------------------------------------- terms


def _term(term: tree.Term, level: int) -> str:
    """The term, in parentheses where it binds more weakly than `level`."""
    text = _bare_term(term)
    if _term_level(term) >= level:
        return text
    blank = " " if term == tree.Neg(tree.Number(Fraction(0))) else ""  # `(-0)` would be the literal 0
    return f"({text[:1]}{blank}{text[1:]})"


def _term_level(term: tree.Term) -> int:
    match term:
        case tree.BinaryTerm():
            return INFIX[type(term)][1]
        case tree.Neg():
            return SUM
        case tree.Number(value) if decimal_places(value) is None:
            return PRODUCT
        case _:
            return ATOM


def _bare_term(term: tree.Term) -> str:
    match term:
        case tree.Number(value):
            return decimal(value)
        case tree.Variable(name):
            return name
        case tree.DifferentialSymbol(name):
            return f"{name}'"
        case tree.FuncOf(name, args):
            return f"{name}({', '.join(map(print_term, args))})"
        case tree.UnitFunctional(name, taboo):
            return f"{name}(|{','.join(taboo)}|)"
        case tree.Neg(child):
            return f"-{_term(child, PRODUCT)}"
        case tree.BinaryTerm():
            operator, _, left, right = INFIX[type(term)]
            return f"{_term(term.left, left)}{operator}{_term(term.right, right)}"
        case tree.Differential(child):
            return f"({print_term(child)})'"
        case _:
            assert_never(term)


def decimal(value: Fraction) -> str:
    """A non-negative number as an exact decimal; as a quotient if it has none."""
    assert value >= 0
    places = decimal_places(value)
    if places is None:
        return f"{value.numerator}/{value.denominator}"
    digits = str(int(value * 10**places)).rjust(places + 1, "0")
    return digits if places == 0 else f"{digits[:-places]}.{digits[-places:]}"


# ---------------------------------------------------------------- formulas


def _formula(formula: tree.Formula, level: int) -> str:
    """The formula, in parentheses where it binds more weakly than `level`."""
    own = INFIX[type(formula)][1] if isinstance(formula, tree.Connective) else UNARY
    text = _bare_formula(formula)
    return text if own >= level else f"({text})"


def _bare_formula(formula: tree.Formula) -> str:
    match formula:
        case tree.Truth(value):
            return "true" if value else "false"
        case tree.Compare(op, left, right):
            return f"{print_term(left)} {op} {print_term(right)}"
        case tree.PredOf(name, args):
            return f"{name}({', '.join(map(print_term, args))})"
        case tree.UnitPredicational(name, taboo):
            return f"{name}(|{','.join(taboo)}|)"
        case tree.PredicationalOf(name, child):
            return f"{name}{{{print_formula(child)}}}"
        case tree.Not(child):
            return f"!{_operand(child)}"
        case tree.Connective():
            operator, _, left, right = INFIX[type(formula)]
            return f"{_formula(formula.left, left)}{operator}{_formula(formula.right, right)}"
        case tree.Quantified():
            word = "forall" if isinstance(formula, tree.Forall) else "exists"
            return f"\\{word} {formula.variable} {_operand(formula.child)}"
        case tree.Box(program, child):
            return f"[{print_program(program)}]{_operand(child)}"
        case tree.Diamond(program, child):
            return f"<{print_program(program)}>{_operand(child)}"
        case tree.DifferentialFormula(child):
            return f"({print_formula(child)})'"
        case _:
            assert_never(formula)


def _operand(formula: tree.Formula) -> str:
    """The operand of a prefix; comparisons get parentheses for the reader's sake."""
    return f"({_bare_formula(formula)})" if isinstance(formula, tree.Compare) else _formula(formula, UNARY)


# ---------------------------------------------------------------- programs


def _program(program: tree.Program, level: int) -> str:
    """The program, in braces where it binds more weakly than `level`."""
    text = _bare_program(program)
    match program:
        case tree.Choice():
            own = CHOICE
        case tree.Compose():
            own = SEQUENCE
        case _:
            own = STATEMENT
    return text if own >= level else f"{{{text}}}"


def _notes(program: tree.Program) -> str:
    """The annotations before a statement."""
    notes = program.annotations if isinstance(program, tree.Statement) else ()
    return "".join(f"{_annotation(note)} " for note in notes)


def _bare_program(program: tree.Program) -> str:
    return _notes(program) + _plain_program(program)


def _plain_program(program: tree.Program) -> str:
    match program:
        case tree.Assign(name, term, differential):
            return f"{name}{_prime(differential)} := {print_term(term)};"
        case tree.AssignAny(dual=True) | tree.ODESystem(dual=True):
            return _plain_program(tree.Dual(replace(program, dual=False, annotations=())))
        case tree.AssignAny(name=name, differential=differential):
            return f"{name}{_prime(differential)} := *;"
        case tree.Test(formula):
            return f"?{_bare_formula(formula)};"
        case tree.ProgramConst(name):
            return f"{name};"
        case tree.ODESystem(equations=equations, domain=domain, invariants=invariants):
            constraint = "" if domain == tree.Truth(True) else f" & {print_formula(domain)}"
            return f"{{{', '.join(map(_equation, equations))}{constraint}}}{_invariants(invariants)}"
        case tree.Compose(left=left, right=right):
            return f"{_program(left, STATEMENT)} {_program(right, SEQUENCE)}"
        case tree.Choice(left=left, right=right, dual=dual):
            level = CHOICE if isinstance(right, tree.Choice) and right.dual == dual else SEQUENCE
            return f"{_program(left, SEQUENCE)} {'--' if dual else '++'} {_program(right, level)}"
        case tree.Loop(child=child, invariants=invariants, dual=dual):
            return f"{{{print_program(child)}}}{'×' if dual else '*'}{_invariants(invariants)}"
        case tree.Dual(child):
            return f"{{{print_program(child)}}}^@"
        case _:
            assert_never(program)


def _prime(differential: bool) -> str:
    return "'" if differential else ""


def _equation(equation: tree.AtomicODE | tree.DifferentialProgramConst) -> str:
    match equation:
        case tree.AtomicODE(name, term):
            return f"{name}' = {print_term(term)}"
        case tree.DifferentialProgramConst(name, taboo):
            return name if taboo is None else f"{name}{{|{','.join(taboo)}|}}"
        case _:
            assert_never(equation)


def _invariants(invariants: Sequence[tree.Formula]) -> str:
    return f"@invariant({', '.join(map(print_formula, invariants))})" if invariants else ""


# ---------------------------------------------------------------- lines


def _indented(lines: Sequence[str]) -> list[str]:
    return [INDENT + line for line in lines]


def _formula_lines(formula: tree.Formula, level: int) -> list[str]:
    """The formula as `_formula` gives it, on several lines if it is long."""
    text = _formula(formula, level)
    if len(text) <= WIDTH:
        return [text]
    match formula:
        case tree.Connective():
            operator, own, left, right = INFIX[type(formula)]
            first, *rest = _formula_lines(formula.right, right)
            lines = [*_formula_lines(formula.left, left), f"{operator[1:]}{first}", *rest]
            return lines if own >= level else ["(", *_indented(lines), ")"]
        case tree.Box(program, child):
            return _modal_lines("[", program, "]", child)
        case tree.Diamond(program, child):
            return _modal_lines("<", program, ">", child)
        case _:
            return [text]


def _modal_lines(begin: str, program: tree.Program, end: str, child: tree.Formula) -> list[str]:
    """A modality; programs that are not a loop get a line for each bracket."""
    steps = _program_lines(program, CHOICE)
    if not isinstance(program, tree.Loop):
        steps = ["", *_indented(steps), ""]
    first, *after = [_operand(child)] if isinstance(child, tree.Compare) else _formula_lines(child, UNARY)
    steps[0] = begin + steps[0]
    steps[-1] += end + first
    return [*steps, *after]


def _program_lines(program: tree.Program, level: int) -> list[str]:
    """The program as `_program` gives it, on several lines if it is long."""
    text = _program(program, level)
    if len(text) <= WIDTH:
        return [text]
    match program:
        case tree.Choice() | tree.Compose() if (
            text.startswith("{") and text == f"{{{_bare_program(program)}}}"
        ):
            return ["{", *_indented(_program_lines(program, CHOICE)), "}"]
        case tree.Compose():
            lines: list[str] = []
            while isinstance(program, tree.Compose):
                lines += _program_lines(program.left, STATEMENT)
                program = program.right
            return [*lines, *_program_lines(program, SEQUENCE)]
        case tree.Choice(left=left, right=right, dual=dual):
            chain = isinstance(right, tree.Choice) and right.dual == dual
            first, *rest = _program_lines(right, CHOICE if chain else SEQUENCE)
            later = rest if chain else [f"   {line}" for line in rest]
            return [*_program_lines(left, SEQUENCE), f"{'--' if dual else '++'} {first}", *later]
        case tree.Loop(child=child, invariants=invariants, dual=dual):
            end = f"}}{'×' if dual else '*'}{_invariants(invariants)}"
            return ["{", *_indented(_program_lines(child, CHOICE)), end]
        case tree.ODESystem(dual=False, domain=domain, invariants=invariants) if domain != tree.Truth(True):
            equations = ", ".join(map(_equation, program.equations))
            first, *rest = _formula_lines(domain, EQUIV)
            lines = [f"{_notes(program)}{{{equations}", f"  & {first}", *(f"    {line}" for line in rest)]
            return [*lines[:-1], f"{lines[-1]}}}{_invariants(invariants)}"]
        case _:
            return [text]


# ---------------------------------------------------------------- archives


def print_archive(archive: tree.Archive) -> str:
    """The whole archive as a file, its annotations included."""
    return "\n".join(map(print_entry, archive.entries))


def print_source(source: Source) -> str:
    """A whole file, printed, with the comments before each entry that hold no annotation. Raises as
    `parser.parse_archive` does.
    """
    archive, _ = read_archive(source)
    code = scan(source)
    notes = [annotation.span.start for annotation in read_annotations(code, [])]
    prose = [
        comment.span
        for comment in code.comments
        if not any(comment.span.start <= at < comment.span.end for at in notes)
    ]
    parts: list[str] = []
    after = 0
    for entry in archive.entries:
        parts += [f"{span.text}\n" for span in prose if after <= span.start < entry.span.start]
        parts.append(print_entry(entry) + "\n" * (entry is not archive.entries[-1]))
        after = entry.span.end
    return "".join(parts)


def print_entry(entry: tree.Entry) -> str:
    """One entry as text that ends with a line end."""
    name = entry.name.replace("\\", "\\\\").replace('"', '\\"')
    lines = [f'{entry.kind} "{name}"', ""]
    if entry.imports or entry.definitions:
        lines += ["Definitions"]
        lines += [f"{INDENT}import {name};" for name in entry.imports]
        lines += [line for group in _together(entry.definitions) for line in _declared(group)]
        lines += ["End.", ""]
    if entry.variables:
        lines += ["ProgramVariables"]
        lines += [line for declaration in entry.variables for line in _declared([declaration])]
        lines += ["End.", ""]
    lines += [_annotation(annotation) for annotation in entry.problem_annotations]
    lines += ["Problem", *_indented(_formula_lines(entry.problem, EQUIV)), "End.", "", "End.", ""]
    return "\n".join(lines)


def _together(declarations: Sequence[tree.Declaration]) -> list[list[tree.Declaration]]:
    """The declarations, those that one implicit definition defines in one group."""
    groups: list[list[tree.Declaration]] = []
    for declaration in declarations:
        if groups and declaration.implicit and groups[-1][0].body == declaration.body:
            groups[-1].append(declaration)
        else:
            groups.append([declaration])
    return groups


def _declared(group: Sequence[tree.Declaration]) -> list[str]:
    first = group[0]
    names = ", ".join(f"{declaration.name}{_parameters(declaration)}" for declaration in group)
    lines = [INDENT + _annotation(annotation) for annotation in first.annotations]
    return [*lines, f"{INDENT}{'implicit ' * first.implicit}{first.sort} {names}{_definition(first)};"]


def _parameters(declaration: tree.Declaration) -> str:
    if declaration.parameters is None:
        return ""
    return f"({', '.join(f'Real {parameter.name}' for parameter in declaration.parameters)})"


def _definition(declaration: tree.Declaration) -> str:
    match declaration.sort, declaration.body:
        case _, None:
            return ""
        case "Real", tree.Compose(left=start, right=flow):
            return f" = {{{{{print_program(start)}}}; {print_program(flow)}}}"
        case "Real", body:
            return f" = {print_term(cast('tree.Term', body))}"
        case "Bool", body:
            return f" <-> {print_formula(cast('tree.Formula', body))}"
        case "HP", body:
            return f" ::= {{ {print_program(cast('tree.Program', body))} }}"
        case _:
            assert_never(declaration.sort)


def _annotation(annotation: tree.Annotation) -> str:
    attributes = [f"{name}={value}" if value else name for name, value, _ in annotation.attributes]
    return f"/* @{annotation.name}{': ' if attributes else ''}{', '.join(attributes)} */"
