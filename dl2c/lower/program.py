"""Programs of the syntax tree as IR blocks: decisions named, branches told from choices.

Assumes an expanded, executable program. A choice of exactly two alternatives whose first tests
are complementary is an `If`; nested choices flatten to one; `{?P;a}*; ?!P` is a `While`, any
other loop a `Repeat` (semantics 2).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar, assert_never

from dl2c.ir import model as ir
from dl2c.ir.logic import negation, oriented
from dl2c.lower.flow import lower_flow
from dl2c.lower.terms import Scope, lower_formula, lower_term
from dl2c.options import Options
from dl2c.parse import tree
from dl2c.parse.annotations import ChoiceAnnotation, FallbackAnnotation, ProgramAnnotation
from dl2c.resolve.shape import alternatives, first_statement, statements
from dl2c.source import Span

P = TypeVar("P", ChoiceAnnotation, FallbackAnnotation)


@dataclass(slots=True)
class ProgramLowering:
    """One program being lowered: what it reads, and the flows and keys found so far.

    `roles` are those that variables are annotated with; else the agent decides, and for the other player
    of a game chance does. `annotations` are those inside programs, by their places. `placed` holds for every
    annotation met the choice or alternative that it belongs to. `once` in a problem without a loop.
    Where `resets`, chance makes all decisions, under keys of their own.
    """

    scope: Scope
    roles: dict[str, ir.Role]
    annotations: Mapping[Span, ProgramAnnotation]
    options: Options
    once: bool = False
    resets: bool = False
    flows: list[ir.Flow] = field(default_factory=list[ir.Flow])
    choices: int = 0
    loops: int = 0
    assigned: dict[str, str] = field(default_factory=dict[str, str])
    placed: dict[ProgramAnnotation, Span] = field(default_factory=dict[ProgramAnnotation, Span])

    def sequence(self, program: Sequence[tree.Program]) -> ir.Block:
        """The statements of programs that follow each other."""
        found: list[ir.Statement] = []
        rest = list(program)
        while rest:
            first = rest.pop(0)
            loop = self._while(first, rest[0]) if isinstance(first, tree.Loop) and rest else None
            if loop is not None:
                found.append(loop)
                rest.pop(0)
            else:
                found += self.block(first)
        return tuple(found)

    def block(self, program: tree.Program) -> ir.Block:
        """The statements of a program, in order."""
        match program:
            case tree.Compose():
                return self.sequence(statements(program))
            case tree.Assign(name, term):
                return (ir.Assign(name, lower_term(term, self.scope), span=program.span),)
            case tree.AssignAny(name):
                return (self._assign_any(program, name),)
            case tree.Test(formula):
                return (ir.Test(lower_formula(formula, self.scope), span=program.span),)
            case tree.ODESystem():
                self.flows.append(self._flow(program))
                return (ir.Evolve(len(self.flows) - 1, span=program.span),)
            case tree.Choice():
                return (self._choice(program),)
            case tree.Loop():
                return (self._repeat(program),)
            case tree.ProgramConst() | tree.Dual():
                raise AssertionError("expansion and with_players leave none of these")
            case _:
                assert_never(program)

    def _flow(self, program: tree.ODESystem) -> ir.Flow:
        flow = lower_flow(program, self.scope, self.options, self.once)
        chance = self._role(program) != "agent" or self.options.duration == "sample"
        return replace(flow, drawn=chance)

    def _assign_any(self, program: tree.AssignAny, name: str) -> ir.AssignAny:
        stem = self._key(f"assign_{name}")
        key = stem
        count = 0
        while key in self.assigned:
            count += 1
            key = f"{stem}_{count}"
        self.assigned[key] = name
        return ir.AssignAny(name, key, self._role(program, self.roles.get(name)), span=program.span)

    def _choice(self, program: tree.Choice) -> ir.Statement:
        found = alternatives(program)
        if len(found) == 2 and (branch := self._branch(found, program.span)) is not None:
            return branch
        key = self._key(f"choice_{self.choices}")
        self.choices += 1
        annotation = self._annotation_at(program)
        marks = [self._is_fallback(a) for a in found]
        lowered = tuple(
            ir.Alternative(self.block(a), mark, span=a.span) for a, mark in zip(found, marks, strict=True)
        )
        role = self._role(program, annotation.role if annotation else None)
        return ir.Choice(key, lowered, role, annotation.name if annotation else "", span=program.span)

    def _repeat(self, program: tree.Loop) -> ir.Repeat:
        key = self._key(f"loop_{self.loops}")
        self.loops += 1
        body, most = self.block(program.child), self.options.max_repeat
        return ir.Repeat(key, body, most, self._role(program), span=program.span)

    def _while(self, loop: tree.Loop, after: tree.Program) -> ir.While | None:
        """`{?P; body}*; ?!P`, if that is what it is."""
        first, *body = statements(loop.child)
        if (conditions := self._complementary(first, after)) is None:
            return None
        return ir.While(*conditions, self.sequence(body), span=loop.span)

    def _complementary(
        self, first: tree.Program, second: tree.Program
    ) -> tuple[ir.Formula, ir.Formula] | None:
        """The conditions of two tests, if one is the negation of the other."""
        if not isinstance(first, tree.Test) or not isinstance(second, tree.Test):
            return None
        condition, otherwise = (lower_formula(t.formula, self.scope) for t in (first, second))
        return (condition, otherwise) if oriented(negation(condition)) == oriented(otherwise) else None

    def _key(self, key: str) -> str:
        return f"prefix_{key}" if self.resets else key

    def _role(
        self,
        decision: tree.AssignAny | tree.Choice | tree.Loop | tree.ODESystem,
        annotated: ir.Role | None = None,
    ) -> ir.Role:
        """Who makes a decision of the program."""
        if self.resets:
            return "reset"
        return annotated or ("env" if decision.dual else "agent")

    def _branch(self, sides: tuple[tree.Program, ...], span: Span) -> ir.If | None:
        """A deterministic branch, if the first tests exclude each other and one always holds."""
        conditions = self._complementary(*map(_first, sides))
        if conditions is None:
            return None
        then, orelse = (self.block(side)[1:] for side in sides)
        return ir.If(*conditions, then, orelse, span=span)

    def _annotation_at(self, choice: tree.Choice) -> ChoiceAnnotation | None:
        """The `@choice` in front of a choice. It belongs to the outermost that begins there."""
        return next(self._before(choice, ChoiceAnnotation), None)

    def _is_fallback(self, alternative: tree.Program) -> bool:
        return next(self._before(alternative, FallbackAnnotation), None) is not None

    def _before(self, program: tree.Program, kind: type[P]) -> Iterator[P]:
        """The annotations of a kind before a program, but those of another one that begins there."""
        for written in first_statement(program).annotations:
            annotation = self.annotations[written.span]
            if (
                isinstance(annotation, kind)
                and self.placed.setdefault(annotation, program.span) == program.span
            ):
                yield annotation


def _first(program: tree.Program) -> tree.Program:
    """The first statement."""
    return _first(program.left) if isinstance(program, tree.Compose) else program
