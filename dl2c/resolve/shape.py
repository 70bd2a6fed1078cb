"""The parts of a problem: `P -> [prefix; {body}*; suffix]Q & <same>R` (semantics 1).

Comes in: the problem as written and its expansion. Goes out: `Shape`, or a located error.
Formulas stay trees; nothing is evaluated.
"""

from dataclasses import dataclass, replace
from functools import partial, reduce

from dl2c.diagnostics import CompileError, Diagnostic, error
from dl2c.parse import tree
from dl2c.parse.printer import print_program
from dl2c.resolve import errors
from dl2c.resolve.players import with_players
from dl2c.resolve.symbols import nodes


@dataclass(frozen=True, slots=True)
class Shape:
    """The parts of a problem, expanded, its games with players. `written_*` keep the calls of definitions
    as the user wrote them.

    `body` is one step; `loop` is the loop it came from, None where the program has none.
    `postcondition` is Q, None for a diamond-only problem; `progress` is R.
    """

    assumptions: tuple[tree.Formula, ...]
    prefix: tuple[tree.Program, ...]
    body: tuple[tree.Program, ...]
    suffix: tuple[tree.Program, ...]
    loop: tree.Loop | None
    postcondition: tree.Formula | None
    progress: tree.Formula | None
    written_assumptions: tuple[tree.Formula, ...]
    written_postcondition: tree.Formula | None
    written_progress: tree.Formula | None


@dataclass(frozen=True, slots=True)
class _Modal:
    programs: tuple[tree.Program, ...]
    post: tree.Formula
    node: tree.Modal

    @property
    def statements(self) -> tuple[tree.Program, ...]:
        return tuple(s for program in self.programs for s in statements(program))


def shape_of(written: tree.Formula, expanded: tree.Formula, chosen: int | None = None) -> Shape:
    """`chosen` is which top-level loop to take, from 1; needed where there are several.

    Raises `CompileError` for a problem that is not of this shape.
    """
    assumptions, conclusion = implications(expanded)
    box, diamond = _modalities(conclusion)
    if box and diamond and _grouped(box.statements) != _grouped(diamond.statements):
        raise CompileError(_different_programs(box, diamond))
    some = box or diamond
    assert some is not None, "a conclusion has one of them"
    prefix, loop, suffix = _around_loop(some.statements, chosen)
    written_assumptions, written_conclusion = implications(written)
    written_box, written_diamond = _written(written_conclusion, box, diamond)
    return Shape(
        assumptions=assumptions,
        prefix=prefix if loop else (),
        body=statements(loop.child) if loop else prefix,
        suffix=suffix,
        loop=loop,
        postcondition=box.post if box else None,
        progress=diamond.post if diamond else None,
        written_assumptions=written_assumptions,
        written_postcondition=written_box,
        written_progress=written_diamond,
    )


def statements(program: tree.Program) -> tuple[tree.Program, ...]:
    """The program as a flat sequence."""
    if isinstance(program, tree.Compose):
        return (*statements(program.left), *statements(program.right))
    return (program,)


def first_statement(program: tree.Program) -> tree.Statement:
    """The statement with which the text of a program begins."""
    match program:
        case tree.Compose(left=first) | tree.Choice(left=first) | tree.Loop(first) | tree.Dual(first):
            return first_statement(first)
        case _:
            return program


def alternatives(program: tree.Program) -> tuple[tree.Program, ...]:
    """The alternatives of a choice, nested choices of the same player flattened."""
    if not isinstance(program, tree.Choice):
        return (program,)
    return tuple(
        alternative
        for side in (program.left, program.right)
        for alternative in (
            alternatives(side) if isinstance(side, tree.Choice) and side.dual == program.dual else (side,)
        )
    )


def _grouped(program: tuple[tree.Program, ...]) -> tuple[tree.Program, ...]:
    """The sequence with every sequence and choice inside nested to the right, whatever its braces."""
    out: list[tree.Program] = []
    for statement in program:
        match statement:
            case tree.Loop(child):
                out.append(replace(statement, child=reduce(_compose, reversed(_grouped(statements(child))))))
            case tree.Choice():
                sides = [reduce(_compose, reversed(_grouped(statements(a)))) for a in alternatives(statement)]
                out.append(reduce(partial(_choose, statement), reversed(sides)))
            case _:
                out.append(statement)
    return tuple(out)


def _compose(rest: tree.Program, first: tree.Program) -> tree.Program:
    return tree.Compose(first, rest)


def _choose(choice: tree.Choice, rest: tree.Program, first: tree.Program) -> tree.Program:
    return replace(choice, left=first, right=rest)


def implications(formula: tree.Formula) -> tuple[tuple[tree.Formula, ...], tree.Formula]:
    assumptions: list[tree.Formula] = []
    while isinstance(formula, tree.Imply):
        assumptions.append(formula.left)
        formula = formula.right
    return tuple(assumptions), formula


def _modal(formula: tree.Formula) -> _Modal | None:
    """`[a][b]Q` is `[a;b]Q`."""
    if not isinstance(formula, tree.Modal):
        return None
    programs = [with_players(formula.program)]
    post = formula.child
    while isinstance(post, type(formula)):
        programs.append(with_players(post.program))
        post = post.child
    return _Modal(tuple(programs), post, formula)


def _modalities(conclusion: tree.Formula) -> tuple[_Modal | None, _Modal | None]:
    """The box and the diamond of the conclusion, at least one."""
    parts = [(part, _modal(part)) for part in conjuncts(conclusion)]
    boxes = [m for _, m in parts if m and isinstance(m.node, tree.Box)]
    diamonds = [m for _, m in parts if m and isinstance(m.node, tree.Diamond)]
    if not boxes and not diamonds:
        raise CompileError(errors.not_a_problem(conclusion.span))
    found = [errors.outside_modality(part.span) for part, modal in parts if modal is None]
    for modals, written in ((boxes, "[program]"), (diamonds, "<program>")):
        found += [errors.several_modalities(m.node.span, written, modals[0].node.span) for m in modals[1:]]
    if found:
        raise CompileError(found)
    return (boxes[0] if boxes else None), (diamonds[0] if diamonds else None)


def conjuncts(formula: tree.Formula) -> tuple[tree.Formula, ...]:
    if isinstance(formula, tree.And):
        return (*conjuncts(formula.left), *conjuncts(formula.right))
    return (formula,)


def _written(
    conclusion: tree.Formula, box: _Modal | None, diamond: _Modal | None
) -> tuple[tree.Formula | None, tree.Formula | None]:
    """Q and R as written; the expanded ones where the conclusion itself is a definition."""
    try:
        written_box, written_diamond = _modalities(conclusion)
    except CompileError:
        written_box, written_diamond = box, diamond
    return (written_box.post if written_box else None), (written_diamond.post if written_diamond else None)


def _around_loop(
    program: tuple[tree.Program, ...], chosen: int | None
) -> tuple[tuple[tree.Program, ...], tree.Loop | None, tuple[tree.Program, ...]]:
    places = [k for k, s in enumerate(program) if isinstance(s, tree.Loop)]
    if chosen is not None and not chosen <= len(places):
        raise CompileError(_no_such_loop(program, chosen, len(places)))
    if not places:
        return program, None, ()
    if len(places) > 1 and chosen is None:
        raise CompileError([_one_of_several(program[k], n) for n, k in enumerate(places, 1)])
    k = places[(chosen or 1) - 1]
    loop = program[k]
    assert isinstance(loop, tree.Loop)
    return program[:k], loop, program[k + 1 :]


def _one_of_several(loop: tree.Program, number: int) -> Diagnostic:
    return error(
        "several-loops",
        "the program has several top-level loops",
        loop.span,
        f"loop {number}",
        f"`--loop {number}` makes this one the episode's; or join them, e.g. `{{first ++ second}}*`",
    )


def _no_such_loop(program: tuple[tree.Program, ...], chosen: int, count: int) -> Diagnostic:
    return error(
        "no-such-loop",
        f"there is no top-level loop {chosen}",
        program[0].span,
        f"the program has {count}" if count else "the program has none",
        "`--loop` counts the loops of the program from 1",
    )


def _different_programs(box: _Modal, diamond: _Modal) -> Diagnostic:
    def text(modal: _Modal) -> str:
        shown = " ".join(" ".join(print_program(p).split()) for p in modal.programs)
        return shown if len(shown) <= 200 else shown[:200] + " ..."

    return error(
        "different-programs",
        "the box and the diamond run different programs",
        diamond.node.span,
        "this one differs from the box",
        "both must be the same program after expansion",
        (f"the box runs     {text(box)}", f"the diamond runs {text(diamond)}"),
    )


def written_variables(programs: tuple[tree.Program, ...]) -> frozenset[str]:
    """Variables that any of the programs may change."""
    names: set[str] = set()
    for program in programs:
        for node in nodes(program):
            if isinstance(node, (tree.Assign, tree.AssignAny, tree.AtomicODE)):
                names.add(node.name)
    return frozenset(names)
