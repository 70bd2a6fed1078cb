"""Mutants of the examples: all kinds, the same for the same seed, each a model that can be read."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from generators.mutants import KINDS, mutants
from oracles.exact_runs import theorem
from selection import quick_among

from dl2c.parse.parser import parse_archive
from dl2c.source import Source

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.kyx"))


@pytest.mark.parametrize("path", quick_among(EXAMPLES, EXAMPLES[::4]), ids=lambda path: path.stem)
def test_mutants_are_other_models(path: Path) -> None:
    archive, _ = parse_archive(Source.read(path))
    entry = archive.entries[0]
    found = list(mutants(entry, 1, 28))
    assert [m.text for m in found] == [m.text for m in mutants(entry, 1, 28)]
    assert [m.text for m in found] != [m.text for m in mutants(entry, 2, 28)]
    plain = replace(entry, program_annotations=())
    for mutant in found:
        assert mutant.entry != plain
        again, _ = parse_archive(Source("mutant.kyx", mutant.text))
        assert again.entries[0] == mutant.entry
        theorem(mutant.text)


def test_every_kind_occurs() -> None:
    entries = [parse_archive(Source.read(path))[0].entries[0] for path in EXAMPLES]
    kinds = Counter(mutant.kind for entry in entries for mutant in mutants(entry, 1))
    assert set(kinds) == set(KINDS)
    assert min(kinds.values()) >= 10
