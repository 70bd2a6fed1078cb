"""The table of classic mistakes: what people write who know other languages, and the advice for it.

A mistake is recognised by the text right before and right after the place where the parser
stopped, and by a terminal of grammar.lark that could have followed there. The first one that fits counts.
What is shown begins at `(?P<shown>` of the text before, or else where that begins.
"""

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Classic:
    """A mistake: `before` ends at the place, `rest` begins there, and `accepts` could have followed."""

    before: re.Pattern[str]
    rest: re.Pattern[str]
    title: str
    help: str
    accepts: str


def _classic(before: str, rest: str, title: str, help: str = "", accepts: str = "") -> Classic:
    return Classic(re.compile(rf"(?:{before})\Z", re.DOTALL), re.compile(rest), title, help, accepts)


_NAME = r"[A-Za-z]\w*"
_TYPE = r"(?:int|float|double|real|bool|boolean|var|let|const|string)"
_QUANTIFIED = rf"\\(?:forall|exists)\s+{_NAME}\s*"

_HERE = r"(?P<shown>)"
_OPERAND = "LPAR"
_OPERATOR = "STAR"
_STATEMENT = "QMARK"
_AFTER_NAME = "_ASSIGN"
_AFTER_DECLARED = "_DEFINED"
_SEMICOLON = "EXTRA_SEMICOLON"

FORMULAS = (
    _classic(r"=", r"=", "`==` is not an operator of dL", "write `=` to compare, `:=` to assign"),
    _classic(r"", r"==?>|⇒|⟹", "`=>` is not an operator of dL", "write `->` for implication"),
    _classic(r"", r"==", "`==` is not an operator of dL", "write `=` to compare, `:=` to assign"),
    _classic(r"=\s*", r">", "`=>` is not an operator of dL", "write `->` for implication, `>=` to compare"),
    _classic(r"<=", r">", "`<=>` is not an operator of dL", "write `<->`"),
    _classic(r"", r"<==?>|⇔|⟺", "`<=>` is not an operator of dL", "write `<->`"),
    _classic(r"=\s*", r"<", "`=<` is not an operator of dL", "write `<=`"),
    _classic(r"<\s*", r">", "`<>` is not an operator of dL", "write `!=`"),
    _classic(r"=\s*", r"!", "`=!` is not an operator of dL", "write `!=`"),
    _classic(r"", r"~=|=/=", "this is not an operator of dL", "write `!=`"),
    _classic(r"<", r"<", "interpreted functions `f<<...>>` cannot be run", "import it from kyx.math"),
    _classic(r"\*", r"\*", "`**` is not an operator of dL", "write `^` for powers"),
    _classic(r"'\s*", r"[<>≤≥]", "only differential equations can be run", "write `x' = e`"),
    _classic(
        r"", r"<-(?!>)", "`<-` needs blanks around it", "write `x < -5` to compare, `p <- q` for implication"
    ),
    _classic(r"", r"(?:and|AND)\b", "`and` is not an operator of dL", "write `&`"),
    _classic(r"", r"(?:or|OR)\b", "`or` is not an operator of dL", "write `|`"),
    _classic(r"\b(?:not|NOT)\s+", r"", "`not` is not an operator of dL", "write `!`"),
    _classic(r"", r"(?:implies|IMPLIES)\b", "`implies` is not an operator of dL", "write `->`"),
    _classic(
        r"",
        r"mod\b|%\s*[\w(]",
        "dL has no remainder of a division",
        "comments are written `/* ... */`",
        _OPERATOR,
    ),
    _classic(r"", r"in\s*\[", "`in` is not an operator of dL", "write `a <= x & x <= b`"),
    _classic(r"", r"\\/", "`\\/` is not an operator of dL", "write `|`"),
    _classic(r"/", r"\\", "`/\\` is not an operator of dL", "write `&`"),
    _classic(
        r"\b(?:forall|exists)\s+", r"", "quantifiers start with a backslash", "write `\\forall x (...)`"
    ),
    _classic(rf"{_QUANTIFIED}\.\s*", r"", "no `.` follows a quantifier", "write `\\forall x (...)`"),
    _classic(rf"{_QUANTIFIED}", r":", "quantified variables have no sort", "write `\\forall x (...)`"),
    _classic(
        rf"{_QUANTIFIED},\s*{_NAME}\s*",
        r"[<>=!≤≥≠]",
        "no `,` follows a quantifier",
        "write `\\forall x (...)`",
    ),
    _classic(
        r"", r"\\(?:forall|exists)|[∀∃]", "a blank must follow a quantifier", "write `\\forall x (...)`"
    ),
    _classic(r"", r"\\", "unknown symbol `\\`", "quantifiers are written `\\forall` and `\\exists`"),
    _classic(r"", r"\|[^|;]*\|", "absolute values have no bars in dL", "write `abs(x)`", _OPERAND),
    _classic(
        r"\+",
        rf"\+\s*{_NAME}'",
        "`++` stands between programs, not between differential equations",
        "write `{x' = 1 & P} ++ {x' = 2 & Q}`",
        _OPERAND,
    ),
    _classic(
        rf"[-+*/^=<>(,≤≥≠]\s*{_HERE}", r"\+\s*[\w(]", "numbers have no sign `+`", "leave it out", _OPERAND
    ),
)

PROGRAMS = (
    _classic(r"", r"then\b", "dL has no `then`", "write `if (c) {...} else {...}`"),
    _classic(
        r"\b(?P<shown>if)\s*\([^;{}]*\)\s*",
        r"[\w(]",
        "`if` chooses a program, not a value",
        "write `if (c) {x := 1;} else {x := 2;}`",
        _OPERATOR,
    ),
    _classic(
        r"", r"\?[^;]*?:(?!=)", "dL has no `? :`", "write `if (c) {x := 1;} else {x := 2;}`", _SEMICOLON
    ),
    _classic(r"\belse\s+", r"if\b", "`else if` needs braces", "write `else { if (...) {...} else {...} }`"),
    _classic(
        r"\b(?:elif|elseif|elsif)\s*",
        r"\(",
        "`else if` needs braces",
        "write `else { if (...) {...} else {...} }`",
    ),
    _classic(r"\belse\s+", r"[\w?(]", "`else` needs braces", "write `else { ... }`", _AFTER_NAME),
    _classic(rf"\bif\s*\(.*\)\s*{_HERE}", r"[\w?]", "`if` needs braces", "write `if (c) { ... }`", "LBRACE"),
    _classic(
        r"\bif\s+", r"\S", "the condition of `if` needs parentheses", "write `if (c) {...}`", _AFTER_NAME
    ),
    _classic(r"\bwhile\s*", r"[(\w!]", "dL has no `while`", "write `{?c; ...}* ?!c;`", _AFTER_NAME),
    _classic(r"\bfor\s*", r"\(", "dL has no `for`", "write `{...}*` to repeat a program"),
    _classic(r"\breturn\s+", r"\w", "dL has no `return`", "assign the value to a variable"),
    _classic(
        rf"\b{_TYPE}\s+",
        r"\w",
        "a program declares no variables",
        "declare it in ProgramVariables",
        _AFTER_NAME,
    ),
    _classic(
        r"", r"Real\b|Bool\b", "a program declares no variables", "declare it in ProgramVariables", _STATEMENT
    ),
    _classic(
        rf"\w\s*{_HERE}",
        r"\+\+\s*[;)}\]]",
        "`++` chooses between programs, it does not count",
        "write `x := x + 1;`",
    ),
    _classic(
        r"\w\s*\+", r"\+\s*[;)}\]]", "`++` chooses between programs, it does not count", "write `x := x + 1;`"
    ),
    _classic(rf"\w\s*{_HERE}", r"--\s*[;)}\]]", "`--` does not count", "write `x := x - 1;`"),
    _classic(
        rf"\w\s*{_HERE}",
        r"[-+*/]=",
        "this is not an assignment of dL",
        "write for example `x := x + 1;`",
        _AFTER_NAME,
    ),
    _classic(
        rf"\w\s*{_HERE}",
        r"\(",
        "a program has no arguments",
        "write `ctrl;` to run a program, `?p(x);` to test a formula",
        _AFTER_NAME,
    ),
    _classic(
        rf"[}}*]\s*\w+\s*{_HERE}",
        r"<(?!-)|<=|>=?|!=|[≤≥≠]",
        "a test begins with `?`, a postcondition follows `]`",
        "write for example `?x > 0;`",
        _AFTER_NAME,
    ),
    _classic(
        rf"\w\s*{_HERE}",
        r"<(?!-)|<=|>=?|!=|[≤≥≠]",
        "a test begins with `?`",
        "write for example `?x > 0;`",
        _AFTER_NAME,
    ),
    _classic(
        r"", r",\s*[A-Za-z]\w*\s*'?\s*:=", "assignments end with `;`", "write `x := 1; v := 2;`", _SEMICOLON
    ),
    _classic(
        rf"(?:[{{\[]|\+\+)\s*{_HERE}",
        r"[}\]]",
        "this program is empty",
        "write `?true;` to do nothing",
        _STATEMENT,
    ),
    _classic(
        rf"(?:[{{\[]|\+\+)\s*{_HERE}",
        r"\+\+",
        "a choice needs a program on both sides of `++`",
        "write `?true;` to do nothing",
        _STATEMENT,
    ),
    _classic(r"", r"\(", "programs are grouped by braces", "write `{ ... }`", _STATEMENT),
    _classic(
        rf"(?:\A|[^}}\s])\s*{_HERE}", r"\*", "only a block can be repeated", "write `{ ... }*`", _STATEMENT
    ),
    _classic(
        rf"\}}\s*{_HERE}",
        r"\+(?!\+)",
        "a choice is written `++`, a loop `{ ... }*`",
        "write `{ ... }*` to repeat, `{ a; ++ b; }` to choose",
        _STATEMENT,
    ),
    _classic(r"", r"\|\|?|∨|\+(?!\+)", "a choice is written `++`", "write `{ a; ++ b; }`", _STATEMENT),
    _classic(r"", r"&", "a domain follows differential equations", "write `{x' = e & Q}`", _STATEMENT),
    _classic(r"\belse\s*", r"\{", "`else` without `if`", "write `if (c) {...} else {...}`", _AFTER_NAME),
)

EQUATIONS = (
    _classic(
        rf",\s*{_NAME}\s*{_HERE}",
        r"<(?!-)|<=|>=?|!=|[≤≥≠]",
        "the domain follows `&`",
        "write `{x' = e & Q}`",
        "COMMA",
    ),
    _classic(
        rf",\s*{_NAME}\s*{_HERE}", r"=", "a differential equation needs its `'`", "write `x' = e`", "COMMA"
    ),
    _classic(
        r"",
        rf"{_NAME}\s*'\s*=",
        "`,` is missing between differential equations",
        "write `{x' = v, t' = 1}`",
        "COMMA",
    ),
    _classic(r"", r"\|\|?|∨", "the domain follows `&`", "write `{x' = e & Q}`", "COMMA"),
    _classic(rf",\s*{_HERE}", r"[&}]", "a differential equation is missing after `,`", "leave out the `,`"),
    _classic(r"&\s*", r"\}", "the domain is missing after `&`", "leave out the `&`", _OPERAND),
)

DECLARATIONS = (
    _classic(
        r"",
        r"\.\s+\w",
        "no declaration follows this one",
        "declarations begin with `Real`, `Bool` or `HP`",
        _SEMICOLON,
    ),
    _classic(rf"[(,]\s*{_HERE}", _NAME, "a parameter needs its sort", "write `f(Real x)`", "SORT"),
    _classic(
        rf",\s*{_HERE}", r"(?:Real|Bool|HP)\b", "the sort is written once", "write `Real c, d;`", "NAME"
    ),
    _classic(
        rf"\A\s*Real\s[^;(]*=[^;]*{_HERE}",
        r",",
        "a declaration defines one name",
        "write `Real c = 1; Real d = 2;`",
        _SEMICOLON,
    ),
    _classic(
        rf"\w\s+{_HERE}",
        rf"{_NAME}\s*[,;]",
        "names are separated by `,`",
        "write `Real c, d;`",
        _AFTER_DECLARED,
    ),
    _classic(rf"\w\s*{_HERE}", r"'", "derivatives are not declared", "declare only `x`", _AFTER_DECLARED),
    _classic(
        rf"::=\s*{_HERE}",
        r"[\w?]",
        "the definition of a program needs braces",
        "write `HP a ::= { ... };`",
        "LBRACE",
    ),
)

TOKENS = (
    _classic(r"\A\s*", r":", "no `:` follows a section word", "leave it out"),
    _classic(r"\d", r"[eE][+-]?\d", "numbers have no exponent", "write for example `1000` for `1e3`"),
    _classic(r"\d", r",\d", "numbers have a point, no comma", "write for example `0.5`"),
    _classic(r"\d", r"\.\d", "a number has one point"),
    _classic(r"\d", r"\.", "digits must follow the point of a number", "write for example `5.0`"),
    _classic(_NAME, r"\.\w", "names have no `.`", "write for example `carv`"),
    _classic(r"", r"\.\d", "digits must precede the point of a number", "write for example `0.5`"),
    _classic(r"", r"\.|•|⎵", "`.` and `•` are syntax of axioms, not of models"),
    _classic(r"[0-9]", r"[A-Za-z(]", "a product needs its `*`", "write for example `2*x`", _OPERATOR),
    _classic(r"\)\s*", r"[0-9A-Za-z(]", "an operator is missing", "write for example `(a)*b`", _OPERATOR),
    _classic(r"\w", r"\[", "dL has no arrays", "give each element a name, for example `x_0`", _OPERATOR),
    _classic(r"", r"[−–—]", "this is not the minus sign `-`", "write `-`"),
    _classic(r"", r"[·⋅∗×✕]", "this is not the product sign `*`", "write `*`"),
    _classic(r"", r"[÷∕]", "this is not the division sign `/`", "write `/`"),
    _classic(r"", r"[⩽≦⩾≧]", "this is not a comparison of dL", "write `<=` or `>=`"),
    _classic(r"", r"≔", "this is not an assignment of dL", "write `:=`"),
    _classic(r"", r"[’‘′´]", "this is not the prime `'`", "write `'`"),
    _classic(r"", r"[“”„«»\"]", "dL has no text", "write descriptions in annotations or comments"),
    _classic(r"", r"[²³¹⁰⁴-⁹]", "powers are written `^`", "write for example `x^2`"),
    _classic(r"", r"[₀-₉]", "an index is written `_`", "write for example `x_1`"),
    _classic(
        r"", r"[\u00a0\u2000-\u200b\u202f\u3000\ufeff]", "this is not a blank of dL", "write a plain blank"
    ),
    _classic(r"\w*", r"(?=[^\x00-\x7f])\w+", "names consist of the letters A to Z and digits", "rename it"),
    _classic(r"", r"¬|~", "this is not an operator of dL", "write `!`"),
    _classic(r"", r"[%#]", "this character is not part of dL", "comments are written `/* ... */`"),
    _classic(r"", r"[$`]", "this character is not part of dL", "leave it out"),
)

ENDS = (
    _classic(r"", r",", "conditions are joined by `&`", "write `p & q`", "$END"),
    _classic(r"", r";", "no `;` follows this", "leave it out", "$END"),
)
"""Where nothing more could follow."""

CLASSICS = (*DECLARATIONS, *PROGRAMS, *FORMULAS, *EQUATIONS, *TOKENS, *ENDS)
