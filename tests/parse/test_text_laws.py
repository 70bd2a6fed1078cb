"""What printing, expanding and annotating keep."""

import re
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from generators.random_texts import random_text, without_definitions
from generators.syntax_strategies import archives, programs
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from lint.test_annotate import MODELS, annotated, without
from selection import few_and_many_examples, quick_among

from dl2c.diagnostics import CompileError
from dl2c.ir.printer import print_model
from dl2c.options import Options
from dl2c.parse.parser import parse_archive, parse_program
from dl2c.parse.printer import print_archive, print_program
from dl2c.parse.tree import Annotation, Archive, Entry, Loop, ODESystem, Program
from dl2c.pipeline import emit, step_model
from dl2c.source import NOWHERE, Source

SEEDS = st.integers(0, 10**9)

VALUES = st.sampled_from(
    [
        "[0:1]",
        "[-inf:2.5]",
        '"a, b = [c] {d}"',
        "{x > 0 & y < 2}",
        "{[a;] x > 0}",
        "terminate:failure",
        "-1",
        "env",
        "",
    ]
)
ATTRIBUTES = st.lists(
    st.tuples(st.sampled_from(["bound", "def", "shape", "reward", "role", "unit"]), VALUES, st.just(NOWHERE)),
    max_size=3,
).map(tuple)


def annotations(*names: str) -> st.SearchStrategy[tuple[Annotation, ...]]:
    return st.lists(st.builds(Annotation, st.sampled_from(names), ATTRIBUTES), max_size=2).map(tuple)


@st.composite
def annotated_archives(draw: st.DrawFn) -> Archive:
    archive = draw(archives())
    declared = annotations("var", "const", "safety", "progress", "stability")
    entries: list[Entry] = []
    for entry in archive.entries:
        defined = (d if d.implicit else replace(d, annotations=draw(declared)) for d in entry.definitions)
        moving = tuple(replace(d, annotations=draw(declared)) for d in entry.variables)
        above = draw(annotations("episode", "safety", "progress"))
        entries.append(
            replace(entry, definitions=tuple(defined), variables=moving, problem_annotations=above)
        )
    return Archive(tuple(entries))


def said(archive: Archive) -> list[object]:
    """Every annotation with what it stands above."""
    return [
        (
            [(d.name, told(d.annotations)) for d in (*entry.definitions, *entry.variables)],
            told(entry.problem_annotations),
        )
        for entry in archive.entries
    ]


def told(found: tuple[Annotation, ...]) -> list[object]:
    return [(a.name, [(name, value) for name, value, _ in a.attributes]) for a in found]


@few_and_many_examples(12, 50, annotated_archives())
def test_annotations_survive_printing(archive: Archive) -> None:
    read, _ = parse_archive(Source("printed.kyx", print_archive(archive)))
    assert read == archive
    assert said(read) == said(archive)


def invariants(node: Any) -> list[object]:
    """The invariants of all loops and differential equations, which equality leaves out."""
    if isinstance(node, tuple):
        return [found for child in node for found in invariants(child)]
    if not is_dataclass(node):
        return []
    own = [node.invariants] if isinstance(node, Loop | ODESystem) else []
    return own + [i for f in fields(node) if f.name != "span" for i in invariants(getattr(node, f.name))]


@given(programs())
def test_invariants_survive_printing(program: Program) -> None:
    assert invariants(parse_program(print_program(program))) == invariants(program)


@few_and_many_examples(15, 60, SEEDS)
def test_expansion_means_the_same(seed: int) -> None:
    """A model and the model that its expansion is have one step model."""
    text = random_text(seed)
    found: list[str] = []
    for way in (text, without_definitions(text)):
        try:
            found.append(emit(Source("random.kyx", way), "ir", Options()))
        except CompileError as refused:
            found.append(" ".join(d.code for d in refused.diagnostics))
    assert found[0] == found[1]


@few_and_many_examples(15, 60, SEEDS)
def test_the_tree_of_a_model_means_the_same(seed: int) -> None:
    text = random_text(seed)
    again = emit(Source("random.kyx", text), "tree", Options())
    found = [emit(Source("random.kyx", way), "expanded", Options()) for way in (text, again)]
    assert found[0] == found[1]


DECISIONS = random_text(0).replace(
    "-> [{",
    '-> [{ /* @choice: name="gear" */ { x := 0; ++ /* @fallback */ { ?x > 0; x := 1; } ++ x := 2; }',
)


@pytest.mark.parametrize("path", quick_among(MODELS, MODELS[::4]), ids=lambda path: path.stem)
def test_printing_keeps_all_that_a_model_says(path: Path) -> None:
    source = Source.read(path)
    again = Source(path.name, emit(source, "tree", Options()))
    assert emit(again, "ir", Options()) == emit(source, "ir", Options())
    assert emit(again, "tree", Options()) == again.text


def test_printing_keeps_the_annotations_inside_programs() -> None:
    source = Source("decisions.kyx", DECISIONS)
    again = Source("decisions.kyx", emit(source, "tree", Options()))
    notes = [told(parse_archive(s)[0].entries[0].program_annotations) for s in (source, again)]
    assert notes[0] == notes[1] == [("choice", [("name", '"gear"')]), ("fallback", [])]
    found = [step_model(s, Options()) for s in (source, again)]
    assert print_model(found[0][0]) == print_model(found[1][0])
    assert [p.marks for p in found[0][1].paths] == [p.marks for p in found[1][1].paths]


@few_and_many_examples(15, 60, SEEDS, st.randoms(use_true_random=False))
def test_annotations_inside_programs_survive_printing(seed: int, random: Random) -> None:
    """Wherever they stand, where the model can be run with them."""
    text = random_text(seed)
    places = [match.end() for match in re.finditer(r"\+\+ |::= \{ ", text)]
    for at in sorted(random.sample(places, min(2, len(places))), reverse=True):
        note = "@fallback" if text[:at].endswith("++ ") else f'@choice: name="at {at}"'
        text = f"{text[:at]}/* {note} */ {text[at:]}"
    source = Source("random.kyx", text)
    try:
        model, paths = step_model(source, Options())
    except CompileError:
        assume(False)
        raise
    printed = Source("random.kyx", emit(source, "tree", Options()))
    notes = [told(parse_archive(s)[0].entries[0].program_annotations) for s in (source, printed)]
    assert set(map(str, notes[0])) == set(map(str, notes[1]))  # one before an `if` is printed twice
    again, found = step_model(printed, Options())
    assert print_model(again) == print_model(model)
    assert [p.marks for p in found.paths] == [p.marks for p in paths.paths]


@given(SEEDS, st.sampled_from([b"\n", b"\r\n"]))
@settings(max_examples=25)
def test_annotating_adds_comments_only(seed: int, ending: bytes) -> None:
    text = (
        random_text(seed)
        .replace("  /* @const: bound=[1:2] */\n", "")
        .replace("Problem\n  ", "Problem\n  A >= 1 & A <= 2 & ")
    )
    plain = text.encode().replace(b"\n", ending)
    try:
        copy = annotated(plain)
    except CompileError as refused:
        assert {d.code for d in refused.diagnostics} <= REFUSED, str(refused)
        return
    assert without(copy) == text.encode()


REFUSED = {"too-large", "unresolved-test", "unsatisfiable-precondition"}
"""Why a random model may not be lowered."""
