"""The diagnostics of reading a model: one function per mistake, facts in, message out."""

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

from dl2c.diagnostics import Diagnostic, error, warning
from dl2c.source import Span

REJECTS = "keymaera-rejects"
"""Code of every warning about text that dl2c reads and KeYmaera X does not."""


def suggestion(word: str, known: Sequence[str]) -> str:
    """`did you mean ...?`, or the list of what is known."""
    close = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"did you mean `{close[0]}`?" if close else "known are " + listing(known)


def listing(words: Sequence[str]) -> str:
    quoted = [f"`{word}`" for word in words]
    return quoted[0] if len(quoted) == 1 else ", ".join(quoted[:-1]) + " and " + quoted[-1]


# ---------------------------------------------------------------- text


def file_too_large(span: Span, limit: int) -> Diagnostic:
    return error(
        "file-too-large",
        f"a model of more than {limit:,} characters",
        span,
        "",
        "keep what is needed for one environment",
    )


def not_utf8(span: Span, byte: int) -> Diagnostic:
    return error(
        "not-utf8",
        "this is not UTF-8 text",
        span,
        f"the byte 0x{byte:02X} does not belong here",
        "save the file as UTF-8",
    )


def not_text(span: Span) -> Diagnostic:
    beside = "the model is the file without `._` in its name" if "/._" in f"/{span.source.name}" else ""
    return error("not-text", "this file is not text", span, "", beside or "save the model as UTF-8 text")


def control_character(span: Span, code: int) -> Diagnostic:
    return error(
        "control-character",
        f"the invisible character U+{code:04X}",
        span,
        "",
        "remove it: it makes the text look different from what it says",
    )


def control_character_aside(span: Span, code: int) -> Diagnostic:
    """One where nothing is read."""
    return warning(
        "control-character",
        f"the invisible character U+{code:04X}",
        span,
        "in a comment or tactic",
        "remove it: other tools may refuse it",
    )


def never_closed(span: Span, opener: str) -> Diagnostic:
    what, closer = {"/*": ("comment", "*/"), '"': ("string", '"')}.get(opener, (f"`{opener}`", ""))
    closer = closer or {"(": ")", "[": "]", "{": "}"}[opener]
    return error("never-closed", f"{what} is never closed", span, "opened here", f"close it with `{closer}`")


def nothing_there(span: Span, symbol: str) -> Diagnostic:
    wanted = symbol.removeprefix("start_")
    return error("syntax", f"a {wanted} is missing", span, f"expected a {wanted}")


def too_deep(span: Span, limit: int) -> Diagnostic:
    return error(
        "too-deep",
        f"text is nested deeper than {limit} levels",
        span,
        "too deep from here",
        "group the operands of long chains with parentheses, or name parts of them in Definitions",
    )


def too_many_digits(span: Span, limit: int) -> Diagnostic:
    return error("too-many-digits", f"number with more than {limit} digits", span)


def beyond_doubles(span: Span) -> Diagnostic:
    return error(
        "number-out-of-range",
        "this number is too large",
        span,
        "no floating-point number is as large",
        "choose other units",
    )


def too_many(what: str, span: Span, limit: int) -> Diagnostic:
    return error(
        f"too-many-{what}", f"more than {limit:,} {what}", span, "too many from here", "leave some out"
    )


def unexpected(span: Span, found: str, expected: str, help: str = "") -> Diagnostic:
    return error("syntax", f"unexpected {found}", span, f"expected {expected}" if expected else "", help)


def missing(span: Span, what: str, help: str = "") -> Diagnostic:
    return error("syntax", f"missing `{what}`", span, f"expected `{what}` here", help)


# ---------------------------------------------------------------- sorts


def wrong_sort(span: Span, wanted: str, found: str) -> Diagnostic:
    help = {
        "term": "a term is a number, a formula is true or false",
        "formula": "compare it, for example with `= 0`",
    }
    return error(
        "wrong-sort", f"expected a {wanted}, found a {found}", span, f"this is a {found}", help[wanted]
    )


def stray_tuple(span: Span) -> Diagnostic:
    return error("wrong-sort", "a tuple is only allowed as arguments of a call", span)


def axiom_dot(span: Span) -> Diagnostic:
    return error("syntax", "`.` and `•` are syntax of axioms, not of models", span)


def stray_dot(span: Span) -> Diagnostic:
    return error(
        "syntax",
        "there is no such argument",
        span,
        "`.` means the only argument, `._0` the first of several",
        "give the parameters names",
    )


def not_defined_with(span: Span, sort: str, found: str, wanted: str) -> Diagnostic:
    return error(
        "wrong-sort", f"`{sort}` is not defined with `{found}`", span, "", f"write `{sort} ... {wanted} ...;`"
    )


def parameter_sort(span: Span, sort: str) -> Diagnostic:
    return error("wrong-sort", "parameters are of sort Real", span, f"found `{sort}`")


def program_parameters(span: Span) -> Diagnostic:
    return error("wrong-sort", "programs have no parameters", span, "", "use program variables instead")


# ---------------------------------------------------------------- what KeYmaera X rejects


def doubled_connective(span: Span) -> Diagnostic:
    return warning(
        REJECTS,
        f"KeYmaera X rejects `{span.text}`",
        span,
        f"read as `{span.text[0]}`",
        f"write `{span.text[0]}`",
    )


def open_statement(span: Span) -> Diagnostic:
    return warning(
        REJECTS, "KeYmaera X rejects a statement without `;`", span, "", "end every statement with `;`"
    )


def misspelt_package(span: Span) -> Diagnostic:
    return warning(REJECTS, "KeYmaera X has no package `keyx`", span, "read as `kyx`", "write `kyx`")


def entry_not_ended(span: Span, name: str) -> Diagnostic:
    return warning(
        REJECTS,
        "KeYmaera X rejects an entry without its own `End.`",
        span,
        f"entry {name} ends here",
        "end every entry with `End.`",
    )


def line_comment(span: Span) -> Diagnostic:
    return warning(
        REJECTS,
        "KeYmaera X rejects `//` comments inside formulas and programs",
        span,
        "",
        "write `/* ... */`, which is allowed everywhere",
    )


# ---------------------------------------------------------------- archives


def no_entry(span: Span) -> Diagnostic:
    return error(
        "no-entry",
        "no model in this file",
        span,
        "",
        'a model is written `ArchiveEntry "Name" ... Problem ... End. End.`',
    )


def old_dialect(span: Span, what: str) -> Diagnostic:
    return warning(
        REJECTS,
        "KeYmaera X 5 rejects this file: it is written in the dialect of version 4",
        span,
        what,
        "`dl2c emit --stage tree` writes it in the dialect of version 5",
    )


def no_problem(span: Span, name: str) -> Diagnostic:
    return error(
        "no-problem", f"entry {name} has no Problem", span, "", "add `Problem <formula> End.` at its end"
    )


def second_problem(span: Span) -> Diagnostic:
    return error("syntax", "a second Problem in one entry", span, "", "start a new entry for it")


def no_name(span: Span, kind: str, unquoted: str) -> Diagnostic:
    title = "the name of an entry needs quotes" if unquoted else "an entry needs a name"
    name = "".join(c for c in unquoted if c.isalnum()) or "Name"
    return error("syntax", title, span, "", f'write for example `{kind} "{name}"`')


def misspelt_end(span: Span) -> Diagnostic:
    return error("syntax", f"`{span.text}` is not `End.`", span, "expected `End.`", "write `End.`")


def misspelt_section(span: Span, word: str) -> Diagnostic:
    return error("syntax", f"unexpected `{span.text}`", span, f"expected `{word}`", f"did you mean `{word}`?")


def section_not_ended(span: Span, section: str, following: str) -> Diagnostic:
    return error(
        "section-not-ended",
        f"{section} is not ended",
        span,
        f"expected `End.` before {following}",
        f"end {section} with `End.`",
    )


def misplaced_text(span: Span, expected: str) -> Diagnostic:
    shown = span.text.split()[0] if span.text.split() else ""
    return error("syntax", f"unexpected `{shown}`", span, f"expected {expected}")


_STRAY = {
    **dict.fromkeys(("real", "int", "integer", "float", "double", "number", "var", "let"), "write `Real`"),
    **dict.fromkeys(("bool", "boolean"), "write `Bool`"),
    **dict.fromkeys(("hp", "program"), "write `HP`"),
    "const": "what stands in Definitions is constant: write `Real c = 1;`",
    **dict.fromkeys(("def", "function", "fun"), "write for example `Real f(Real x) = x + 1;`"),
    ":": "no `:` follows the section word",
    ";": "one `;` ends a declaration",
    **dict.fromkeys((")", "]", "}"), "it closes nothing: leave it out"),
    **dict.fromkeys(("#", "%"), "comments are written `/* ... */`"),
}


def not_a_declaration(span: Span) -> Diagnostic:
    word, expected = span.text, "a declaration (`Real`, `Bool`, `HP`) or `End.`"
    otherwise = f"begin with its sort, for example `Real {word};`" if word.isalnum() else "leave it out"
    return unexpected(span, f"`{word}`", expected, _STRAY.get(word.lower(), otherwise))


def defined_variable(span: Span) -> Diagnostic:
    return error(
        "defined-variable",
        "a program variable has no definition",
        span,
        "",
        "give its initial value in the Problem, or move it to Definitions",
    )


def not_a_real(span: Span) -> Diagnostic:
    if "(" in span.text:
        advice = "leave out the parentheses, or move it to Definitions"
        return error("wrong-sort", "a program variable has no arguments", span, "", advice)
    return error("wrong-sort", "program variables are of sort Real", span, "", "move it to Definitions")


def undefined_program(span: Span, name: str) -> Diagnostic:
    return error(
        "undefined-program",
        f"program `{name}` has no definition",
        span,
        "",
        f"write `HP {name} ::= {{ ... }};`",
    )


def implicit_shape(span: Span) -> Diagnostic:
    return error(
        "implicit-definition",
        "this does not define a function of time",
        span,
        "",
        "write first the values at time 0, then the differential equation: "
        "`implicit Real f(Real t) = {{f := 1;}; {f' = f}};`",
    )


def implicit_sort(span: Span, sort: str) -> Diagnostic:
    return error(
        "wrong-sort", "functions of time are of sort Real", span, f"found `{sort}`", "write `implicit Real`"
    )


def implicit_parameter(span: Span, name: str) -> Diagnostic:
    return error(
        "implicit-definition", f"`{name}` needs one parameter, the time", span, "", f"write `{name}(Real t)`"
    )


def implicit_unsolved(span: Span, name: str) -> Diagnostic:
    return error(
        "implicit-definition",
        f"nothing defines `{name}`",
        span,
        "",
        f"give its value at time 0, `{name} := ...;`, and its rate, `{name}' = ...`",
    )


def malformed_import(span: Span) -> Diagnostic:
    return error(
        "syntax", "malformed import", span, "", "write `import kyx.math.abs;` or `import kyx.math.{abs,min};`"
    )


def unknown_import(span: Span, name: str, known: Sequence[str]) -> Diagnostic:
    help = suggestion(name, [f"kyx.math.{other}" for other in known])
    return error("unknown-import", f"the library has no `{name}`", span, "", help)


def strictly(diagnostic: Diagnostic) -> Diagnostic:
    """A warning as an error."""
    return replace(diagnostic, severity="error")


# ---------------------------------------------------------------- annotations


def unknown_annotation(span: Span, name: str, known: Sequence[str]) -> Diagnostic:
    return error(
        "unknown-annotation",
        f"unknown annotation `@{name}`",
        span,
        "",
        suggestion(f"@{name}", [f"@{other}" for other in known]),
    )


def no_colon(span: Span, name: str) -> Diagnostic:
    return error("malformed-annotation", f"`:` is missing after `@{name}`", span, "", f"write `@{name}: ...`")


def malformed_attribute(span: Span) -> Diagnostic:
    return error(
        "malformed-annotation",
        "malformed attribute",
        span,
        "expected `attribute=value`",
        "separate attributes with `,`",
    )


def unbalanced_value(span: Span) -> Diagnostic:
    return error("malformed-annotation", "a bracket or quote does not close", span)


def misplaced_annotation(span: Span, name: str, place: str) -> Diagnostic:
    return error("misplaced-annotation", f"misplaced `@{name}`", span, "", f"write it {place}")


def repeated_annotation(span: Span, name: str) -> Diagnostic:
    return error(
        "repeated-annotation",
        f"`@{name}` is given twice",
        span,
        "",
        "write one annotation with all attributes",
    )


def wrong_kind(span: Span, name: str, declared: str, kind: str, wanted: str, instead: str) -> Diagnostic:
    help = f"for `{declared}` write `@{instead}`" if instead else ""
    return error("wrong-annotation", f"`@{name}` is for {wanted}", span, f"`{declared}` is a {kind}", help)


def unknown_attribute(span: Span, annotation: str, name: str, known: Sequence[str]) -> Diagnostic:
    title = f"`@{annotation}` has no attribute `{name}`"
    help = suggestion(name, known) if known else f"write `@{annotation}` alone"
    return error("unknown-attribute", title, span, "", help)


def repeated_attribute(span: Span, name: str) -> Diagnostic:
    return error("repeated-attribute", f"attribute `{name}` is given twice", span)


def no_value(span: Span, name: str) -> Diagnostic:
    return error("malformed-value", f"attribute `{name}` needs a value", span, "", f"write `{name}=...`")


def malformed_bound(span: Span) -> Diagnostic:
    return error(
        "malformed-value",
        "malformed bound",
        span,
        "expected `[low:high]`",
        "ends are decimals, `-inf` or `inf`",
    )


def empty_bound(span: Span) -> Diagnostic:
    return error("malformed-value", "the bound is empty", span, "its lower end is above its upper end")


def not_a_string(span: Span) -> Diagnostic:
    return error("malformed-value", "text needs quotes", span, 'expected `"..."`')


def unknown_value(span: Span, word: str, known: Sequence[str]) -> Diagnostic:
    return error("malformed-value", f"unknown value `{word}`", span, "", suggestion(word, known))


def malformed_trigger(span: Span) -> Diagnostic:
    return error(
        "malformed-value",
        "malformed trigger",
        span,
        "expected `action:status`",
        "write for example `terminate:success`",
    )


def wrong_number(span: Span, name: str, kind: str, least: int | None, open: bool) -> Diagnostic:
    limit = "" if least is None else f" above {least}" if open else f" of at least {least}"
    article = "an" if kind[0] in "aeiou" else "a"
    return error("malformed-value", f"`{name}` is {article} {kind}{limit}", span)


def bound_of_defined(span: Span, name: str) -> Diagnostic:
    return error(
        "wrong-annotation",
        f"`{name}` is defined, so it cannot be sampled",
        span,
        "",
        "drop the bound or the definition",
    )
