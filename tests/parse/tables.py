"""Writes dl2c/parse/tables.json: `python tests/parse/tables.py`, after a change of the grammar or of lark."""

import json
from pathlib import Path
from typing import Any

from lark.grammar import Rule
from lark.lexer import TerminalDef

from dl2c.parse.syntax import TABLES, facts, made_parser

FILE = Path(__file__).resolve().parents[2] / "dl2c" / "parse" / TABLES


def plain(value: Any) -> Any:
    """As JSON values; a dict whose keys are no words is a list of pairs, in a dict of its own."""
    match value:
        case dict():
            pairs = [(key, plain(v)) for key, v in value.items()]
            return dict(pairs) if all(isinstance(key, str) for key, _ in pairs) else {"": pairs}
        case list() | tuple():
            return [plain(v) for v in value]
        case set() | frozenset():
            return sorted(value)
        case _:
            return value


def tables() -> dict[str, Any]:
    """The parser's tables, and what they depend on."""
    data, memo = made_parser(callbacks=False).memo_serialize([TerminalDef, Rule])
    return {"facts": facts(), "data": plain(data), "memo": plain(memo)}


if __name__ == "__main__":
    FILE.write_text(json.dumps(tables(), separators=(",", ":")) + "\n", encoding="utf-8")
