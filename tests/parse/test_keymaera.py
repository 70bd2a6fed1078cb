"""Agreement with KeYmaera X: its own test pairs, and what it makes of public models in both dialects."""

import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import cache
from typing import Any

import pytest
from conftest import shared
from selection import quick_rows

from dl2c.diagnostics import CompileError
from dl2c.options import Options
from dl2c.parse.parser import parse_archive, parse_formula, parse_program, parse_term
from dl2c.parse.printer import print_archive, print_formula
from dl2c.parse.tree import Archive, Entry, Expression, Formula, FuncOf, Loop, ODESystem, Variable
from dl2c.pipeline import emit
from dl2c.resolve.problem import expansion
from dl2c.resolve.symbols import nodes
from dl2c.source import Source, Span

READERS = {"term": parse_term, "formula": parse_formula, "program": parse_program}


def test_both_sides_of_every_official_pair_are_the_same_tree() -> None:
    pairs = json.loads(shared("oracle/pairs.json").read_text())
    differing: list[str] = []
    for sort, rows in pairs.items():
        for text, meaning in rows:
            try:
                tree = READERS[sort](text, strict=True)
            except CompileError:
                tree = None
            expected = None if meaning is None else READERS[sort](meaning, strict=True)
            if tree != expected:
                differing.append(text)
    assert differing == []
    assert sum(len(rows) for rows in pairs.values()) == 573


def elaborate(node: Any, constants: frozenset[str]) -> Any:
    """KeYmaera X shows a declared constant `c` as `c()`."""
    match node:
        case Variable(name=name):
            return FuncOf(name, ()) if name in constants else node
        case tuple():
            return tuple(elaborate(child, constants) for child in node)
        case _ if is_dataclass(node) and not isinstance(node, (type, Span)):
            changed = {
                f.name: elaborate(getattr(node, f.name), constants)
                for f in fields(node)
                if f.name not in ("span", "invariants")
            }
            return replace(node, **changed)
        case _:
            return node


def meaning(entry: Entry, formula: Formula) -> Formula:
    """A formula of an entry as KeYmaera X shows it."""
    return elaborate(formula, frozenset(d.name for d in entry.definitions if d.sort == "Real"))


def reading_of_keymaera(text: str) -> Formula:
    """KeYmaera X's print of a model without its interpretations `f<<...>>` and the taboos of `a{|^@|};`."""
    parts, depth = [""], 0
    for part in re.split(r"(<<|>>(?=\())", text.replace("{|^@|}", "")):
        depth += {"<<": 1, ">>": -1}.get(part, 0)
        if depth == 0 and part != ">>":
            parts.append(part)
    return parse_formula("".join(parts))


@cache
def public_models(every: int = 1) -> dict[str, tuple[Archive, list[dict[str, str]]]]:
    """By one file of so many, its archive and what the parsers of KeYmaera X 5 and 4 make of its entries."""
    rows: dict[str, list[dict[str, str]]] = {}
    for line in shared("oracle/golden.jsonl").read_text().splitlines():
        row = json.loads(line)
        rows.setdefault(row["file"], []).append(row)
    return {
        f: (parse_archive(Source.read(shared(f"corpus/{f}")))[0], found)
        for f, found in list(rows.items())[::every]
    }


def of_name(archive: Archive, name: str) -> list[Entry]:
    """The entries of a name; KeYmaera X has none for the entry of a bare file."""
    return [entry for entry in archive.entries if name in (entry.name, "<undefined>")]


def compared(
    stage: str, ours: Callable[[Entry], Formula], every: int = 1
) -> tuple[dict[str, int], list[str]]:
    """How many entries of every so many files agree with a stage of KeYmaera X, by its parser, and which
    differ.
    """
    agreeing: Counter[str] = Counter()
    differing: list[str] = []
    for file, (archive, rows) in public_models(every).items():
        for row in rows:
            expected = reading_of_keymaera(row[stage])
            if expected in [meaning(entry, ours(entry)) for entry in of_name(archive, row["name"])]:
                agreeing[row["parser"]] += 1
            else:
                differing.append(f"{file}: {row['name']}")
    print(f"{stage}: {dict(agreeing)} agree, {len(differing)} differ")
    return dict(agreeing), differing


ALL = {"archive": 473, "oldarchive": 114}
"""The entries that the parsers of KeYmaera X 5 and 4 read."""

EVERY = 5
"""One file of so many is read in quick tests."""

SOME = {"archive": 43, "oldarchive": 21}
"""The entries in these."""


@pytest.mark.parametrize(("every", "read"), quick_rows(((EVERY, SOME), (1, ALL)), ((EVERY, SOME),)))
def test_public_models_read_as_keymaera_reads_them(every: int, read: dict[str, int]) -> None:
    assert compared("model", lambda entry: entry.problem, every) == (read, [])


@pytest.mark.slow  # expands all public models; test_the_expanded_stage_prints_the_expansion does a few
def test_public_models_expand_as_keymaera_expands_them() -> None:
    """What `dl2c emit --stage expanded` prints parses back to the formula of KeYmaera X."""
    assert compared("expanded", lambda entry: parse_formula(print_formula(expansion(entry)))) == (ALL, [])


def hints(entry: Entry, *bodies: Expression | None) -> list[Formula]:
    """The formulas of `@invariant` and `@variant` in the bodies."""
    loops = [n for body in bodies for n in nodes(body) if isinstance(n, (Loop, ODESystem))]
    return [meaning(entry, formula) for loop in loops for formula in loop.invariants]


@pytest.mark.parametrize(("every", "count"), quick_rows(((EVERY, 13), (1, 278)), ((EVERY, 13),)))
def test_invariants_of_public_models_are_those_of_keymaera(every: int, count: int) -> None:
    """KeYmaera X lists those of the problem and of the definitions that it uses."""
    found = 0
    for archive, rows in public_models(every).values():
        for row in rows:
            (entry,) = of_name(archive, row["name"])[:1]
            listed = [reading_of_keymaera(text) for text in row["annot"].split(" ;; ") if text]
            everywhere = hints(entry, entry.problem, *(d.body for d in entry.definitions))
            assert all(formula in listed for formula in hints(entry, entry.problem))
            assert all(formula in everywhere for formula in listed)
            found += bool(listed)
    assert found == count


def test_the_expanded_stage_prints_the_expansion() -> None:
    """Of entries chosen by number; two of the public ones share a name."""
    for file, (archive, _) in list(public_models(EVERY).items())[::4]:
        source = Source.read(shared(f"corpus/{file}"))
        for number, entry in enumerate(archive.entries[:2], 1):
            shown = emit(source, "expanded", Options(entry=str(number)))
            assert shown == print_formula(expansion(entry)) + "\n"


@pytest.mark.slow  # prints all public models; test_print.py does so with random ones
def test_public_models_print_as_models_of_the_new_dialect() -> None:
    for archive, _ in public_models().values():
        again, warnings = parse_archive(Source("again.kyx", print_archive(archive)))
        assert again == archive
        assert not warnings
