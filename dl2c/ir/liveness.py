"""Which variables a program changes, and whether it forgets their old values."""

from collections.abc import Iterator
from typing import assert_never

from dl2c.ir.logic import symbols
from dl2c.ir.model import (
    Assign,
    AssignAny,
    Block,
    Choice,
    Evolve,
    Flow,
    If,
    Repeat,
    Statement,
    Symbol,
    Test,
    While,
)


def overwritten(block: Block, variable: str, flows: tuple[Flow, ...]) -> bool:
    """Whether every path writes the variable before any read (in a test, a domain, a right-hand side)."""
    reads, writes = _scan(block, Symbol(variable, "variable"), flows)
    return writes and not reads


def read_first(block: Block, variable: str, flows: tuple[Flow, ...]) -> bool:
    """Whether some path reads the variable before it writes it."""
    return _scan(block, Symbol(variable, "variable"), flows)[0]


def _scan(block: Block, symbol: Symbol, flows: tuple[Flow, ...]) -> tuple[bool, bool]:
    """Whether some path reads the symbol first, and whether every path writes it."""
    for statement in block:
        reads, writes = False, False
        match statement:
            case Assign(name, term):
                reads, writes = symbol in symbols(term), name == symbol.name
            case AssignAny(name):
                writes = name == symbol.name
            case Test(formula):
                reads = symbol in symbols(formula)
            case Evolve(k):
                flow = flows[k]
                rates = [term for _, term in flow.equations]
                reads = symbol in symbols(flow.domain, *rates) or symbol.name in dict(flow.equations)
            case If(condition, otherwise, then, orelse):
                branches = [_scan(then, symbol, flows), _scan(orelse, symbol, flows)]
                reads = symbol in symbols(condition, otherwise) or any(r for r, _ in branches)
                writes = all(w for _, w in branches)
            case While(condition, _, body):
                reads = symbol in symbols(condition) or _scan(body, symbol, flows)[0]
            case Repeat(_, body):
                reads, _ = _scan(body, symbol, flows)
            case Choice(_, alternatives):
                branches = [_scan(a.body, symbol, flows) for a in alternatives]
                reads, writes = any(r for r, _ in branches), all(w for _, w in branches)
            case _:
                assert_never(statement)
        if reads or writes:
            return reads, writes
    return False, False


def statements(block: Block) -> Iterator[Statement]:
    """All statements of a program, also those inside others."""
    for statement in block:
        yield statement
        for part in parts_of(statement):
            yield from statements(part)


def parts_of(statement: Statement) -> tuple[Block, ...]:
    """The programs inside a statement, of which a run executes one."""
    match statement:
        case If(_, _, then, orelse):
            return then, orelse
        case Choice(_, alternatives):
            return tuple(a.body for a in alternatives)
        case While(body=body) | Repeat(body=body):
            return (body,)
        case Assign() | AssignAny() | Test() | Evolve():
            return ()
        case _:
            assert_never(statement)


def written(block: Block, flows: tuple[Flow, ...]) -> frozenset[str]:
    """Variables that a program may change."""
    found: set[str] = set()
    for statement in statements(block):
        match statement:
            case Assign(name) | AssignAny(name):
                found.add(name)
            case Evolve(k):
                found.update(name for name, _ in flows[k].equations)
            case _:
                pass
    return frozenset(found)
