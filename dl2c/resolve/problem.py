"""An entry with every name bound and every definition expanded, ready to be lowered.

Comes in: a parsed entry. Goes out: `Problem`. Raises `CompileError` with every
independent error: of names, of definitions, of annotations, of what cannot be executed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.parse import tree
from dl2c.parse.annotations import (
    ConstantAnnotation,
    EpisodeAnnotation,
    PredicateAnnotation,
    ProgramAnnotation,
    VariableAnnotation,
    decode_conclusion,
    decode_declaration,
    decode_problem,
    decode_program,
)
from dl2c.resolve.bind import check_entry
from dl2c.resolve.expand import expanded_formula
from dl2c.resolve.fragment import check_executable
from dl2c.resolve.infer import with_implied, with_inferred
from dl2c.resolve.predicates import AnnotatedPredicate, bind_predicates
from dl2c.resolve.scene import SceneShape, scene_of
from dl2c.resolve.shape import Shape, shape_of
from dl2c.resolve.symbols import Symbols, collect

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Problem:
    """One resolved entry. Annotations are None where a declaration has none. `scene` are the shapes of
    `@scene`, None without one. `existential` are the constants for some value of which the problem is stated.
    """

    entry: tree.Entry
    symbols: Symbols
    expanded: tree.Formula
    shape: Shape
    variables: tuple[tuple[tree.Declaration, VariableAnnotation | None], ...]
    constants: tuple[tuple[tree.Declaration, ConstantAnnotation | None], ...]
    predicates: tuple[AnnotatedPredicate, ...]
    program_annotations: tuple[ProgramAnnotation, ...]
    episode: EpisodeAnnotation | None
    scene: tuple[SceneShape, ...] | None = None
    warnings: tuple[Diagnostic, ...] = ()
    existential: tuple[str, ...] = ()

    @property
    def annotated(self) -> bool:
        """Whether the model says anything about learning."""
        declared = any(a is not None for _, a in (*self.variables, *self.constants))
        return declared or bool(self.predicates)


def resolve(entry: tree.Entry, loop: int | None = None) -> Problem:
    """`loop` is which top-level loop to run, from 1; `@episode` may say so too. Raises `CompileError`."""
    entry, undeclared = with_inferred(entry)
    symbols, found = collect(entry)
    if any(d.code == "recursive-definition" for d in found):
        raise CompileError(found)
    found += check_entry(entry, symbols)
    variables, constants, predicates = _annotations(entry, symbols, found)
    episode = _decoded(found, lambda: decode_problem(entry.problem_annotations))
    concluded = _decoded(found, lambda: decode_conclusion(entry.problem_annotations)) or ()
    program = _decoded(found, lambda: decode_program(entry.program_annotations)) or ()
    scene = _decoded(found, lambda: scene_of(entry.problem_annotations, symbols))
    if found:
        raise CompileError(found)
    expanded = expanded_formula(entry.problem, symbols)
    check_executable(expanded)
    shape = shape_of(entry.problem, expanded, _chosen(loop, episode))
    return Problem(
        entry=entry,
        symbols=symbols,
        expanded=expanded,
        shape=shape,
        variables=variables,
        constants=constants,
        predicates=bind_predicates(predicates, concluded, shape, symbols),
        program_annotations=program,
        episode=episode,
        scene=scene,
        warnings=undeclared.warnings(),
        existential=tuple(d.name for d in undeclared.existential),
    )


def expansion(entry: tree.Entry) -> tree.Formula:
    """The problem of an entry without its definitions, also of one that nothing can run.

    Raises `CompileError` for what KeYmaera X refuses too.
    """
    symbols, found = collect(with_implied(entry))
    found += [d for d in check_entry(entry, symbols) if d.code != "exercise-hole"]
    if found:
        raise CompileError(found)
    return expanded_formula(entry.problem, symbols, run=False)


def _chosen(loop: int | None, episode: EpisodeAnnotation | None) -> int | None:
    named = [value for name, value, _ in episode.options if name == "loop"] if episode else []
    return int(named[0]) if loop is None and named else loop


def _annotations(
    entry: tree.Entry, symbols: Symbols, found: list[Diagnostic]
) -> tuple[
    tuple[tuple[tree.Declaration, VariableAnnotation | None], ...],
    tuple[tuple[tree.Declaration, ConstantAnnotation | None], ...],
    tuple[tuple[tree.Declaration, PredicateAnnotation], ...],
]:
    """Every declaration with its decoded annotation, sorted by what it declares."""
    variables: list[tuple[tree.Declaration, VariableAnnotation | None]] = []
    constants: list[tuple[tree.Declaration, ConstantAnnotation | None]] = []
    predicates: list[tuple[tree.Declaration, PredicateAnnotation]] = []
    for declaration in entry.variables:
        decoded = _decoded(found, lambda d=declaration: decode_declaration(d, "variable")) or ()
        own = [a for a in decoded if isinstance(a, VariableAnnotation)]
        variables.append((declaration, own[0] if own else None))
    for declaration in entry.definitions:
        decoded = _decoded(found, lambda d=declaration: decode_declaration(d, "definition")) or ()
        for annotation in decoded:
            if isinstance(annotation, PredicateAnnotation):
                predicates.append((declaration, annotation))
        if symbols.roles.get(declaration.name) == "constant":
            own_constant = [a for a in decoded if isinstance(a, ConstantAnnotation)]
            constants.append((declaration, own_constant[0] if own_constant else None))
    return tuple(variables), tuple(constants), tuple(predicates)


def _decoded(found: list[Diagnostic], decode: Callable[[], _T]) -> _T | None:
    try:
        return decode()
    except CompileError as problem:
        found += problem.diagnostics
        return None
