"""The page: one file of HTML that needs nothing else and may load nothing else."""

import base64
import hashlib
import json
import re
from html import escape
from pathlib import Path

from dl2c.play.build import Playable
from dl2c.play.facts import facts_of

FOLDER = Path(__file__).parent / "page"

CHARTS, CHARTS_STYLE = "uplot/uPlot.iife.min.js", "uplot/uPlot.min.css"
"""uPlot, as it is distributed; plots.js uses it."""

MODULES = (
    *(
        "elements",
        "conditions",
        "engine",
        "episode",
        "deciding",
        "policy",
        "plots",
        "listing",
        "controls",
        "panels",
    ),
    *("layout", "shapes", "scene", "player", "words", "keys", "main"),
)
"""Modules of JavaScript, each behind those that it imports; their names do not clash."""

IMPORT = re.compile(r"^import \{[^}]*\} from \"\./[a-z]+\.js\";\n", re.MULTILINE)
EXPORT = re.compile(r"^export ", re.MULTILINE)


def page_of(made: Playable) -> str:
    """The whole page."""
    style, program = _file(CHARTS_STYLE) + _file("page.css"), script()
    allowed = [
        "default-src 'none'",
        f"script-src {_hash(program)} 'wasm-unsafe-eval'",
        f"style-src {_hash(style)}",
        "base-uri 'none'",
        "form-action 'none'",
    ]
    parts = {
        "POLICY": "; ".join(allowed),
        "TITLE": escape(_printable(made.manifest.name)),
        "STYLE": style,
        "FACTS": _data(facts_of(made)),
        "MODULE": base64.b64encode(made.wasm).decode(),
        "SCRIPT": program,
    }
    return re.sub(r"%([A-Z]+)%", lambda found: parts[found[1]], _file("page.html"))


def script() -> str:
    """uPlot and all modules as one: they import nothing but each other."""
    texts = [_file(CHARTS)] + [EXPORT.sub("", IMPORT.sub("", _file(f"{name}.js"))) for name in MODULES]
    return "\n".join(texts)


def _file(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """The source expression that allows this text alone."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _data(content: object) -> str:
    """JSON that cannot end the element in which it stands."""
    return json.dumps(content, allow_nan=False).replace("<", "\\u003c")


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
