"""Syntax errors in words of dL, with advice for the classic mistakes.

In: a `Failure`, where the parser stopped and what it would have accepted. Out: one diagnostic.
The mistakes that are recognised by the text around the place are in classics.py.
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
_HEAD = re.compile(r"\s*(?P<sort>Real|Bool|HP|HG|[RBPTF])\s+\w+\s*(?:\([^()]*\))?\s*(?P<sign>::=|<->|=)?")
_SIGN = re.compile(r":=|==|=|:|->|\{")
_SIGNS = {
    **dict.fromkeys(("Real", "R", "T"), "="),
    **dict.fromkeys(("Bool", "B", "F"), "<->"),
    **dict.fromkeys(("HP", "HG", "P"), "::="),
}
_CALLED = re.compile(r"\{\s*(?P<name>[A-Za-z]\w*)\s*\}\Z")
_BEGUN = re.compile(r"\{\s*[A-Za-z]\w*\s*\Z")
_EQUATION = re.compile(r"\s*[A-Za-z]\w*\s*'\s*=")
_ALTERNATIVE = re.compile(r"\+\s*(?:[A-Za-z]\w*\s*'?\s*(?::=|;)|[{?])")
_PARAMETERS = frozenset({"RPAR", "COMMA"})
NOTHING = frozenset({"$END"})
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
        _stray(failure)
        or _definition(failure)
        or _assignment(failure)
        or _equations(failure)
        or _missing_before_choice(failure)
        or _classic_mistake(failure)
        or _bad_name(failure)
        or _unopened(failure)
        or _chained(failure)
        or _unclosed(failure)
        or _missing_semicolon(failure)
        or _missing_operator(failure)
        or _plain(failure)
    )


def _stray(failure: Failure) -> Diagnostic | None:
    """What follows a declaration and is none."""
    if failure.symbol != "declaration" or failure.accepted != NOTHING:
        return None
    word = re.match(r"\w+", failure.rest)
    length = len(word.group()) if word else failure.length
    return errors.not_a_declaration(failure.code.span(failure.place, failure.place + length))


def _definition(failure: Failure) -> Diagnostic | None:
    """`Bool p := ...`, `HP a = {`, `Real c == 1`: a sort with the sign of another."""
    if failure.symbol != "declaration":
        return None
    head = _HEAD.match(failure.before)
    found = _SIGN.match(failure.rest) if head and "_DEFINED" in failure.accepted else None
    if head is None or (found is None and not head.group("sign")):
        return None
    sort, wanted = head.group("sort"), _SIGNS[head.group("sort")]
    if found is not None:
        span = failure.code.span(failure.place, failure.place + len(found.group()))
        return errors.not_defined_with(span, sort, found.group(), wanted)
    if head.group("sign") == wanted or failure.before[head.end() :].strip():
        return None
    span = failure.code.span(*(failure.start + at for at in head.span("sign")))
    return errors.not_defined_with(span, sort, head.group("sign"), wanted)


def _bad_name(failure: Failure) -> Diagnostic | None:
    """A word that is not a name: `my_var`, `x_01`, `Real`."""
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
    code, place, before, rest = failure.code, failure.place, failure.before, failure.rest
    if rest.startswith("=") and before.rstrip().endswith("'") and "_ASSIGN" in failure.accepted:
        return _own_braces(failure, place)
    if rest.startswith("*") and before.endswith("}") and "STAR" not in failure.accepted:
        if call := _CALLED.search(before):
            end = failure.start + call.end("name")
            help = f"write `{{{call.group('name')};}}*`"
            return errors.missing(code.span(end, end + 1), ";", help)
        return error(
            "syntax", "only a block can be repeated", code.span(place, place + 1), "", "write `{{x' = e}}*`"
        )
    if rest.startswith("=") and "_ASSIGN" in failure.accepted:
        flows = _BEGUN.search(before) and "}" in rest and ";" not in rest[: rest.index("}")]
        help = "write `x := e;`, or `x' = e` for a differential equation" if flows else "write `x := e;`"
        span = code.span(place, place + 1)
        return error("syntax", "an assignment is written `:=`", span, "expected `:=`", help)
    if rest.startswith(":=") and "EQ" in failure.accepted:
        span = code.span(place, place + 2)
        return error("syntax", "`:=` assigns, it does not compare", span, "", "write `=` to compare")
    return None


def _own_braces(failure: Failure, place: int) -> Diagnostic:
    span = failure.code.span(place, place + 1)
    return error("syntax", "a differential equation needs its own braces", span, "", "write `{x' = e}`")


def _equations(failure: Failure) -> Diagnostic | None:
    """A `;` after a differential equation."""
    opened = _open_brackets(failure)
    if not opened or not failure.rest.startswith(";"):
        return None
    flow = _EQUATION.match(failure.before, opened[-1] + 1)
    if flow is None:
        return None
    span = failure.code.span(failure.place, failure.place + 1)
    following = failure.rest[1:].lstrip()
    if _EQUATION.match(following):
        title = "differential equations are separated by `,`"
        return error("syntax", title, span, "expected `,`", "write `{x' = v, t' = 1}`")
    if following.startswith("}"):
        title = "no `;` ends a differential equation"
        return error("syntax", title, span, "", "leave it out: write `{x' = e & Q}`")
    return _own_braces(failure, failure.start + flow.end() - 1)


def _missing_before_choice(failure: Failure) -> Diagnostic | None:
    """`x := 1 ++ v := 2;`, where the second `+` is the place."""
    if not (failure.before.endswith("+") and _ALTERNATIVE.match(failure.rest)):
        return None
    ended = failure.start + len(failure.before[:-1].rstrip())
    return errors.missing(failure.code.span(ended, ended + 1), ";", "end the statement before `++`")


def _classic_mistake(failure: Failure) -> Diagnostic | None:
    from dl2c.parse.classics import CLASSICS  # more than a hundred patterns, which most models do not need

    before = failure.before[-MAX_BEFORE:]
    for classic in CLASSICS:
        if classic.accepts and classic.accepts not in failure.accepted:
            continue
        left, right = classic.before.search(before), classic.rest.match(failure.rest)
        if left is None or right is None:
            continue
        shown = left.start("shown") if "shown" in left.re.groupindex else left.start()
        start = failure.place - len(before) + shown
        end = max(start + 1, failure.place + len(right.group()))
        return error("syntax", classic.title, failure.code.span(start, end), "", classic.help)
    return None


def _open_brackets(failure: Failure) -> list[int]:
    """Where the brackets begin that are still open, as offsets into `before`."""
    opened: list[int] = []
    for bracket in re.finditer(r"[(\[{)\]}]", failure.before):
        if bracket.group() in "([{":
            opened.append(bracket.start())
        elif opened:
            opened.pop()
    return opened


def closes_nothing(failure: Failure) -> bool:
    """Whether a closing bracket stands where none is open."""
    return failure.rest[:1] in (")", "]", "}") and not _open_brackets(failure)


def _unopened(failure: Failure) -> Diagnostic | None:
    if not closes_nothing(failure):
        return None
    closer = failure.rest[0]
    span = failure.code.span(failure.place, failure.place + 1)
    return error("syntax", f"`{closer}` closes nothing", span, "", "leave it out, or open it before")


def _unclosed(failure: Failure) -> Diagnostic | None:
    """A bracket that is still open where the text, the statement or an outer bracket ends."""
    opened, found = _open_brackets(failure), failure.rest[:1]
    starred = found == "*" and failure.before.rstrip().endswith("}")
    in_header = failure.accepted == _PARAMETERS and failure.symbol == "declaration"
    if not opened or not (found in ("", ";", ")", "]", "}") or in_header or starred):
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


def _missing_operator(failure: Failure) -> Diagnostic | None:
    """`x = v w`."""
    word = re.match(r"\w+", failure.rest)
    if word is None or "STAR" not in failure.accepted or not re.search(r"[\w)]\s*\Z", failure.before):
        return None
    if failure.before.rstrip()[-1:] in ("", "}"):
        return None
    span = failure.code.span(failure.place, failure.place + len(word.group()))
    return error(
        "syntax", "an operator is missing", span, f"before `{word.group()}`", "write for example `a*b`"
    )


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


def _operand(failure: Failure) -> str:
    """What the text before asks for."""
    before = failure.before.rstrip()
    if re.search(r"(?:->|<-|[?&|!\]])\Z", before):
        return "a formula"
    return "a term" if re.search(r"[-+*/^=<>≤≥≠]\Z", before) else "a formula or term"


def _expected(failure: Failure) -> str:
    """What could have followed, as a phrase; empty where too much could."""
    left = set(failure.accepted)
    words: list[str] = []
    if failure.accepted == NOTHING:
        return "nothing more"
    if left >= _OPERAND:
        words.append(_operand(failure) if "TRUE" in left else "a term")
        left &= {"RPAR"} if "PLUS" in left else {"RPAR", "STAR"}
    if left >= _STATEMENT:
        words.append("a statement")
        left -= _STATEMENT | {"NAME", "EXTRA_SEMICOLON", "DUAL"}
    if left & {"PLUS", "AND"}:
        words.append("an operator")
        left -= _OPERATORS | _CONNECTIVES | {"PRIME", "LPAR", "BARRED_ARGUMENTS", "TIGHT_BRACE"}
    words += [_WORDS[terminal] for terminal in _WORDS if terminal in left]
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
