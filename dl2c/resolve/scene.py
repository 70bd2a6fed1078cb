"""`@scene` above Problem: shapes, and terms of the model that say where they are.

In: the raw annotation, whose shapes are text. Out: shapes with every definition expanded. Raises
`CompileError` with every independent mistake.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar, cast

from dl2c.diagnostics import CompileError, Diagnostic
from dl2c.ir.model import SceneRole
from dl2c.ir.scene import FORMS, PAIRS, POINTS, ROLES, Form
from dl2c.parse import tree
from dl2c.parse.annotations import one_of, string
from dl2c.parse.comments import parts_of, visible
from dl2c.parse.errors import no_value, repeated_annotation
from dl2c.parse.parser import parse_annotated
from dl2c.resolve import errors
from dl2c.resolve.bind import check
from dl2c.resolve.expand import NONE, Expander
from dl2c.resolve.fragment import not_executable
from dl2c.resolve.symbols import Symbols
from dl2c.source import Span

_SHAPE = re.compile(r"(\w+)\s*\((.*)\)", re.DOTALL)
_NAMED = re.compile(r"([A-Za-z_]\w*)\s*=(?!=)\s*(.*)", re.DOTALL)
_PAIR = re.compile(r"\((.*)\)", re.DOTALL)

LEAST_POINTS = 3

Terms = tuple[tree.Term, ...]
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class SceneShape:
    """One shape with expanded terms; otherwise as `ir.Shape`."""

    kind: str
    role: SceneRole
    name: str
    arguments: tuple[tuple[str, Terms], ...]
    span: Span


def scene_of(annotations: Sequence[tree.Annotation], symbols: Symbols) -> tuple[SceneShape, ...] | None:
    """The shapes of the one `@scene` above Problem; None where there is none. Raises `CompileError`."""
    given = [a for a in annotations if a.name == "scene"]
    if not given:
        return None
    found: list[Diagnostic] = [repeated_annotation(again.span, "scene") for again in given[1:]]
    if not given[0].attributes:
        found.append(errors.not_a_shape(given[0].span))
    read = [_Reader(symbols, found).shape(span) for _, _, span in given[0].attributes]
    if found:
        raise CompileError(found)
    return tuple(shape for shape in read if shape is not None)


def written_terms(span: Span) -> Iterator[tree.Expression]:
    """The terms in the text of a shape, definitions not expanded; what cannot be read is left out."""
    shape = _SHAPE.fullmatch(visible(span))
    for part in parts_of(_within(span, shape, 2)) if shape else ():
        named = _NAMED.fullmatch(visible(part))
        if named is not None and named[1] in ("role", "name"):
            continue
        value = part if named is None else _within(part, named, 2)
        pair = _PAIR.fullmatch(visible(value)) if named is not None and named[1] in PAIRS else None
        for place in (value,) if pair is None else parts_of(_within(value, pair, 1)):
            with suppress(CompileError):
                yield parse_annotated(place)


@dataclass(slots=True)
class _Reader:
    """Reads shapes; what is wrong with them goes to `found`."""

    symbols: Symbols
    found: list[Diagnostic]

    def shape(self, span: Span) -> SceneShape | None:
        """The shape written at `span`; None if the text is not that of a shape."""
        parts = _SHAPE.fullmatch(visible(span))
        if parts is None:
            self.found.append(errors.not_a_shape(span))
            return None
        kind, form = parts[1], FORMS.get(parts[1])
        if form is None:
            self.found.append(errors.unknown_shape(_within(span, parts, 1), kind, tuple(FORMS)))
            return None
        places, named = self._sorted(kind, form, parts_of(_within(span, parts, 2)))
        arguments = self._placed(kind, form, places, span)
        for key in (*form.needed, *form.optional):
            if key not in named and key in form.needed:
                self.found.append(errors.missing_argument(span, kind, key))
            elif key in named and key != "name":
                arguments[key] = self._pair(named[key]) if key in PAIRS else self._term(named[key])
        role = self._decoded(named, "role", "world", lambda text, at: one_of(text, at, ROLES))
        name = self._decoded(named, "name", "", string)
        return SceneShape(kind, cast("SceneRole", role), name, tuple(arguments.items()), span)

    def _sorted(self, kind: str, form: Form, parts: Sequence[Span]) -> tuple[list[Span], dict[str, Span]]:
        """The positional arguments in their order, and the others by name."""
        places: list[Span] = []
        named: dict[str, Span] = {}
        for part in parts:
            found = _NAMED.fullmatch(visible(part))
            if found is None:
                places.append(part)
            elif found[1] not in form.keywords:
                name = _within(part, found, 1)
                self.found.append(errors.unknown_argument(name, kind, found[1], form.keywords))
            elif found[1] in named:
                self.found.append(errors.repeated_argument(_within(part, found, 1), kind, found[1]))
            elif not found[2]:
                self.found.append(no_value(_within(part, found, 1), found[1]))
            else:
                named[found[1]] = _within(part, found, 2)
        return places, named

    def _placed(self, kind: str, form: Form, places: Sequence[Span], span: Span) -> dict[str, Terms]:
        """The terms of the positional arguments, by the names that the form gives them."""
        if form.many:
            if len(places) < 2 * LEAST_POINTS or len(places) % 2:
                wanted = f"x and y of at least {LEAST_POINTS} points"
                self.found.append(errors.wrong_places(span, kind, wanted, len(places)))
            return {POINTS: tuple(t for place in places for t in self._term(place))}
        if len(places) != len(form.places):
            wanted = ", ".join(f"`{name}`" for name in form.places)
            self.found.append(errors.wrong_places(span, kind, wanted, len(places)))
        return {name: self._term(place) for name, place in zip(form.places, places, strict=False)}

    def _pair(self, span: Span) -> Terms:
        """The two terms of a pair `(dx, dy)`; fewer where one has a mistake."""
        inside = _PAIR.fullmatch(visible(span))
        parts = () if inside is None else parts_of(_within(span, inside, 1))
        if len(parts) != 2:
            self.found.append(errors.not_a_direction(span))
        return tuple(t for part in parts for t in self._term(part))

    def _term(self, span: Span) -> Terms:
        """A term with its definitions expanded, alone in a tuple; an empty tuple if it has a mistake."""
        try:
            read = parse_annotated(span)
        except CompileError as wrong:
            self.found += wrong.diagnostics
            return ()
        if not isinstance(read, tree.Term):
            self.found.append(errors.not_a_scene_term(span))
            return ()
        if found := tuple(check(read, self.symbols, frozenset())):
            self.found += found
            return ()
        expander = Expander(self.symbols)
        term = expander.term(read, {}, NONE)
        found = (*expander.found, *not_executable((term,)))
        self.found += found
        return () if found else (term,)

    def _decoded(
        self, named: dict[str, Span], key: str, default: _T, decode: Callable[[str, Span], _T]
    ) -> _T:
        if key not in named:
            return default
        try:
            return decode(" ".join(visible(named[key]).split()), named[key])
        except CompileError as wrong:
            self.found += wrong.diagnostics
            return default


def _within(span: Span, found: re.Match[str], group: int) -> Span:
    """The span of a group of `found`, which is a match in the text of `span`."""
    start, end = found.span(group)
    return Span(span.source, span.start + start, span.start + end)
