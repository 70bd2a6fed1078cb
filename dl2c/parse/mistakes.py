"""Syntax errors in words of dL, with advice for the classic mistakes.

In: a `Failure`, where the parser stopped and what it would have accepted. Out: one diagnostic.
`CLASSICS` is the table of mistakes that are recognised by the text around the place.
"""

import re
from dataclasses import dataclass

from dl2c.diagnostics import Diagnostic, error
from dl2c.parse import errors
from dl2c.parse.scan import Code

MAX_BEFORE = 200
"""How far back before the place a mistake is looked for."""


@dataclass(frozen=True, slots=True)
class Failure:
    """The parser stopped at `place` (offset) on `length` characters while reading `start` to `end`.

    `length` is 0 at the end of the text. `accepted` holds the terminals of grammar.lark that
    could have followed; `is_token` says whether what stands there is a terminal at all.
    """

    code: Code
    start: int
    end: int
    place: int
    length: int
    is_token: bool
    accepted: frozenset[str]
    symbol: str

    @property
    def before(self) -> str:
        return self.code.text[self.start : self.place]

    @property
    def rest(self) -> str:
        return self.code.text[self.place : self.end]


@dataclass(frozen=True, slots=True)
class Classic:
    """A mistake recognised by the text right before and right after the place.

    With `operator` it is one only where an operator could have followed.
    """

    before: re.Pattern[str]
    rest: re.Pattern[str]
    title: str
    help: str
    operator: bool = False


def _classic(before: str, rest: str, title: str, help: str, operator: bool = False) -> Classic:
    return Classic(re.compile(rf"(?:{before})\Z"), re.compile(rest), title, help, operator)


CLASSICS = (
    _classic(r"=", r"=", "`==` is not an operator of dL", "write `=` to compare, `:=` to assign"),
    _classic(r"", r"==", "`==` is not an operator of dL", "write `=` to compare, `:=` to assign"),
    _classic(r"=\s*", r">", "`=>` is not an operator of dL", "write `->` for implication, `>=` to compare"),
    _classic(r"=\s*", r"<", "`=<` is not an operator of dL", "write `<=`"),
    _classic(r"<\s*", r">", "`<>` is not an operator of dL", "write `!=`"),
    _classic(r"<", r"<", "interpreted functions `f<<...>>` cannot be run", "import it from kyx.math"),
    _classic(r"\*", r"\*", "`**` is not an operator of dL", "write `^` for powers"),
    _classic(r"'\s*", r"[<>≤≥]", "only differential equations can be run", "write `x' = e`"),
    _classic(
        r"", r"<-", "`<-` needs blanks around it", "write `x < -5` to compare, `p <- q` for implication"
    ),
    _classic(r"", r"(?:and|AND)\b", "`and` is not an operator of dL", "write `&`"),
    _classic(r"", r"(?:or|OR)\b", "`or` is not an operator of dL", "write `|`"),
    _classic(r"\b(?:not|NOT)\s+", r"", "`not` is not an operator of dL", "write `!`"),
    _classic(r"", r"\\/", "`\\/` is not an operator of dL", "write `|`"),
    _classic(r"/", r"\\", "`/\\` is not an operator of dL", "write `&`"),
    _classic(
        r"\b(?:forall|exists)\s+", r"", "quantifiers start with a backslash", "write `\\forall x (...)`"
    ),
    _classic(r"\belse\s+", r"if\b", "`else if` needs braces", "write `else { if (...) {...} else {...} }`"),
    _classic(r"", r"then\b", "dL has no `then`", "write `if (c) {...} else {...}`"),
    _classic(r"\bwhile\s*", r"\(", "dL has no `while`", "write `{?c; ...}*; ?!c;`"),
    _classic(r"\d", r"[eE][+-]?\d", "numbers have no exponent", "write for example `1000` for `1e3`"),
    _classic(r"\d", r"\.\d", "a number has one point", ""),
    _classic(r"\d", r"\.", "digits must follow the point of a number", "write for example `5.0`"),
    _classic(r"", r"\.\d", "digits must precede the point of a number", "write for example `0.5`"),
    _classic(r"", r"\.|•|⎵", "`.` and `•` are syntax of axioms, not of models", ""),
    _classic(r"[0-9]", r"[A-Za-z(]", "a product needs its `*`", "write for example `2*x`", operator=True),
    _classic(r"\)\s*", r"[0-9A-Za-z(]", "an operator is missing", "write for example `(a)*b`", operator=True),
    _classic(r"", r"\\(?:forall|exists)", "a blank must follow a quantifier", "write `\\forall x (...)`"),
    _classic(r"", r"\\", "unknown symbol `\\`", "quantifiers are written `\\forall` and `\\exists`"),
    _classic(r"", r"[−–—]", "this is not the minus sign `-`", "write `-`"),
    _classic(r"", r"[·⋅∗]", "this is not the product sign `*`", "write `*`"),
    _classic(r"", r"¬", "`¬` is not an operator of dL", "write `!`"),
    _classic(r"", r"[%#$~`]", "this character is not part of dL", ""),
)

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_RESERVED = frozenset(
    {
        *("Real", "Bool", "HP", "HG", "Axiom", "End", "Functions", "Definitions", "ProgramVariables"),
        *("Variables", "Problem", "Tactic", "implicit", "Sequent", "Formula", "Lemma", "Tool"),
        *("SharedDefinitions", "ArchiveEntry", "Theorem", "Exercise", "true", "false"),
    }
)
_COMPARISONS = re.compile(r"<=|>=|!=|=|<|>|≤|≥|≠")
_OPERAND = frozenset({"NAME", "NUMBER", "LPAR"})
_OPERATORS = frozenset({"PLUS", "MINUS", "STAR", "SLASH", "CIRCUMFLEX", "EQ", "NE", "LE", "GE", "LT", "GT"})
_CONNECTIVES = frozenset({"AND", "OR", "_IMPLY", "_REVERSE", "IFF"})
_NOTHING = frozenset({"$END"})
_STATEMENT = frozenset({"QMARK", "IF", "LBRACE"})
_WORDS = {
    "RPAR": "`)`",
    "LPAR": "`(`",
    "RBRACE": "`}`",
    "LBRACE": "`{`",
    "RSQB": "`]`",
    "COMMA": "`,`",
    "EXTRA_SEMICOLON": "`;`",
    "_DEFINED": "`::=`",
    "_ASSIGN": "`:=`",
    "NAME": "a name",
    "SORT": "a sort (`Real`, `Bool`, `HP`)",
    "EQ": "`=`",
    "GT": "`>`",
    "IFF": "`<->`",
    "PRIME": "`'`",
    "CHOICE": "`++`",
    "STAR": "`*`",
    "ELSE": "`else`",
}


def explain(failure: Failure) -> Diagnostic:
    """The most helpful thing to say about a syntax error."""
    return (
        (_plain(failure) if failure.accepted == _NOTHING else None)
        or _bad_name(failure)
        or _assignment(failure)
        or _chained(failure)
        or _classic_mistake(failure)
        or _unclosed(failure)
        or _missing_semicolon(failure)
        or _plain(failure)
    )


def _bad_name(failure: Failure) -> Diagnostic | None:
    """A word that is no name: `my_var`, `x_01`, `Real`."""
    if failure.place > failure.start and failure.code.text[failure.place - 1].isalnum():
        return None
    word = _NAME.match(failure.rest)
    if word is None or word.group().strip("_") == "":
        return None
    name = word.group()
    span = failure.code.span(failure.place, failure.place + len(name))
    if name in _RESERVED and "NAME" in failure.accepted:
        return error(
            "bad-name", f"`{name}` is a reserved word", span, "expected a name", "choose another name"
        )
    if not failure.is_token and "_" in name:
        plain = name.replace("_", "")
        advice = f", for example `{plain}`" if plain[:1].isalpha() else ""
        return error(
            "bad-name",
            f"`{name}` is not a name of dL",
            span,
            "only one `_` may end a name, and one index such as `_0` follow",
            f"rename it{advice}",
        )
    return None


def _chained(failure: Failure) -> Diagnostic | None:
    """`0 <= x <= 1` and `p <-> q <-> r`."""
    if failure.accepted.isdisjoint(_CONNECTIVES) or failure.before[-1:] in "=<>":
        return None
    span = failure.code.span(failure.place, failure.place + failure.length)
    if failure.rest.startswith(("<->", "↔")):
        return error("chained", "`<->` does not chain", span, "", "write `p <-> (q <-> r)`")
    if (
        _COMPARISONS.match(failure.rest)
        and "EQ" not in failure.accepted
        and not failure.rest.startswith("<-")
    ):
        in_statement = failure.rest[0] == ">" and "EXTRA_SEMICOLON" in failure.accepted
        help = "end the statement with `;`" if in_statement else "write `a <= x & x <= b`"
        return error("chained", "comparisons do not chain", span, "", help)
    return None


def _assignment(failure: Failure) -> Diagnostic | None:
    """`x = 1;` as a statement, `x := 1` in a formula, `x' = 1` without braces of its own."""
    if (
        failure.rest.startswith("=")
        and failure.before.rstrip().endswith("'")
        and "_ASSIGN" in failure.accepted
    ):
        span = failure.code.span(failure.place, failure.place + 1)
        return error("syntax", "a differential equation needs its own braces", span, "", "write `{x' = e}`")
    if failure.rest.startswith("*") and failure.before.endswith("}") and "STAR" not in failure.accepted:
        span = failure.code.span(failure.place, failure.place + 1)
        return error("syntax", "only a block can be repeated", span, "", "write `{{x' = e}}*`")
    if failure.rest.startswith("=") and "_ASSIGN" in failure.accepted:
        span = failure.code.span(failure.place, failure.place + 1)
        return error("syntax", "an assignment is written `:=`", span, "expected `:=`", "write `x := e;`")
    if failure.rest.startswith(":=") and "EQ" in failure.accepted:
        span = failure.code.span(failure.place, failure.place + 2)
        return error("syntax", "`:=` assigns, it does not compare", span, "", "write `=` to compare")
    return None


def _classic_mistake(failure: Failure) -> Diagnostic | None:
    before = failure.before[-MAX_BEFORE:]
    for classic in CLASSICS:
        left, right = classic.before.search(before), classic.rest.match(failure.rest)
        if left is None or right is None or (classic.operator and "STAR" not in failure.accepted):
            continue
        start = failure.place - len(left.group())
        end = failure.place + max(len(right.group()), int(not left.group()))
        return error("syntax", classic.title, failure.code.span(start, end), "", classic.help)
    return None


def _unclosed(failure: Failure) -> Diagnostic | None:
    """A bracket that is still open where the text, the statement or an outer bracket ends."""
    opened: list[int] = []
    for bracket in re.finditer(r"[(\[{)\]}]", failure.before):
        if bracket.group() in "([{":
            opened.append(bracket.start())
        elif opened:
            opened.pop()
    found = failure.rest[:1]
    if not opened or found not in ("", ";", ")", "]", "}"):
        return None
    opener = failure.before[opened[-1]]
    closer, terminal = {"(": (")", "RPAR"), "[": ("]", "RSQB"), "{": ("}", "RBRACE")}[opener]
    if found == closer or terminal not in failure.accepted:
        return None
    place = failure.start + opened[-1]
    return errors.never_closed(failure.code.span(place, place + 1), opener)


def _missing_semicolon(failure: Failure) -> Diagnostic | None:
    if "EXTRA_SEMICOLON" not in failure.accepted or failure.accepted & _STATEMENT:
        return None
    ended = failure.start + len(failure.before.rstrip())
    next_line = "\n" in failure.code.text[ended : failure.place]
    if (
        failure.length
        and not next_line
        and not re.match(r"[{?}\]>]|\+\+|[A-Za-z]\w*\s*'?\s*:=", failure.rest)
    ):
        return None
    return errors.missing(failure.code.span(ended, ended + 1), ";")


def _plain(failure: Failure) -> Diagnostic:
    """What was found and what could have stood there."""
    if failure.length == 0:
        place = max(failure.end - 1, failure.start)
        what = f"end of the {failure.symbol.removeprefix('start_')}"
        return errors.unexpected(failure.code.span(place, place + 1), what, _expected(failure))
    word = _NAME.match(failure.rest)
    found = word.group() if word else failure.rest[: failure.length]
    span = failure.code.span(failure.place, failure.place + len(found))
    return errors.unexpected(span, f"`{found}`", _expected(failure))


def _expected(failure: Failure) -> str:
    """What could have followed, as a phrase; empty where too much could."""
    left = set(failure.accepted)
    words: list[str] = []
    if failure.accepted == _NOTHING:
        if failure.symbol == "declaration":
            return "a declaration (`Real`, `Bool`, `HP`) or `End.`"
        return "nothing more"
    if left >= _OPERAND:
        words.append("a formula or term" if "TRUE" in left else "a term")
        left &= {"RPAR"} if "PLUS" in left else {"RPAR", "STAR"}
    if left >= _STATEMENT:
        words.append("a statement")
        left -= _STATEMENT | {"NAME", "EXTRA_SEMICOLON", "DUAL"}
    if left & {"PLUS", "AND"}:
        words.append("an operator")
        left -= _OPERATORS | _CONNECTIVES | {"PRIME", "LPAR", "BARRED_ARGUMENTS", "TIGHT_BRACE"}
    words += [_WORDS[terminal] for terminal in _WORDS if terminal in left]
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
