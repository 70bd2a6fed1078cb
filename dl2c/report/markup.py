"""HTML that cannot be broken by what stands in it: every text is escaped, only `Markup` is taken as it is.

What this module does not know cannot get into a page: there are no scripts, and the page's own policy
forbids them and every access to the network.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True, slots=True)
class Markup:
    """HTML made here."""

    html: str


def tag(name: str, *children: "Markup | str", **attributes: str) -> Markup:
    """An element; `class_` is the attribute class."""
    given = "".join(f' {key.rstrip("_")}="{escape(value)}"' for key, value in attributes.items())
    return Markup(f"<{name}{given}>{inner(children)}</{name}>")


def inner(children: "Iterable[Markup | str]") -> str:
    """Children one after the other, texts escaped."""
    return "".join(c.html if isinstance(c, Markup) else escape(_printable(c)) for c in children)


def _printable(text: str) -> str:
    """Control characters, surrogates and marks that turn the writing direction as replacement characters."""
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def table(heads: Sequence[str], rows: "Iterable[Sequence[Markup | str]]") -> Markup:
    """A table; every row has a cell for each head."""
    first = tag("tr", *(tag("th", h) for h in heads))
    body = [tag("tr", *(tag("td", cell) for cell in row)) for row in rows]
    return tag("table", tag("thead", first), tag("tbody", *body))


def image(uri: str, about: str) -> Markup:
    """A picture that stands in the page itself; `uri` is a data URI."""
    assert uri.startswith("data:image/png;base64,")
    return Markup(f'<img src="{escape(uri)}" alt="{escape(_printable(about))}">')


def section(title: str, *children: "Markup | str") -> Markup:
    """A part of the page under a heading."""
    return tag("section", tag("h2", title), *children)


POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""What the page may load: nothing but the pictures and the style in it."""


def page(title: str, style: str, *children: Markup) -> str:
    """A whole page in one file."""
    head = Markup(
        '<meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{style}</style>"
    )
    body = tag("main", *children)
    whole = tag("html", tag("head", head, tag("title", title)), tag("body", body), lang="en")
    return f"<!DOCTYPE html>\n{whole.html}\n"
