"""The parser's tables that come with dl2c are those of its grammar."""

import json
from pathlib import Path

import lark
import pytest
from parse import tables

from dl2c.parse import syntax
from dl2c.parse.parser import parse_formula
from dl2c.parse.tree import Formula


def test_kept_tables_are_those_of_the_grammar_and_of_lark() -> None:
    kept = json.loads(tables.FILE.read_text(encoding="utf-8"))
    assert kept["facts"] == syntax.facts(), "run `python tests/parse/tables.py`"


def test_made_and_kept_tables_read_alike() -> None:
    formula = (
        "x >= 0 -> [{ {?x < 1; v := *; ++ v := -1;} {x' = v, t' = 1 & t <= 1} }*@invariant(x >= 0)] x >= 0"
    )
    kept = syntax._parser()
    made = syntax.made_parser(callbacks=False)
    assert kept.parse(formula, start="start_formula") == made.parse(formula, start="start_formula")
    words = [{t.name: (t.pattern.value, sorted(t.pattern.flags)) for t in p.terminals} for p in (kept, made)]
    assert words[0] == words[1]
    assert set(kept.rules) == set(made.rules)


def test_for_another_lark_tables_are_made_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "x >= 0 & [x := 1;] x = 1"
    known, folder = parse_formula(text), tmp_path / "parser"
    monkeypatch.setenv("DL2C_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(lark, "__version__", "1.3.999")

    def read() -> Formula:
        syntax._parser.cache_clear()
        return parse_formula(text)

    try:
        assert read() == known
        (made,) = (path for path in folder.iterdir() if path.name != "lock")
        content = made.read_bytes()
        assert len(content) > 10_000
        for broken in (b"", content[:1000], b"broken"):
            made.write_bytes(broken)
            assert read() == known
            assert len(made.read_bytes()) > 10_000  # in what order sets are written differs
        folder.rename(tmp_path / "away")
        folder.write_text("no folder")
        assert read() == known
    finally:
        syntax._parser.cache_clear()
