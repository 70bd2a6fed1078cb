"""Models written to do harm, and what must become of each: `builds`, or the code of a diagnostic.

All are made from one small model, so that nothing large lies in the repository.
"""

from dataclasses import dataclass
from random import Random


@dataclass(frozen=True)
class Case:
    name: str
    text: str | bytes
    expected: str

    @property
    def content(self) -> bytes:
        return self.text if isinstance(self.text, bytes) else self.text.encode("utf-8", "surrogatepass")


def model(
    *,
    name: str = "Plain",
    x: str = "x",
    v: str = "v",
    safe: str = "safe",
    const: str = '/* @const: bound=[1:2], unit="m", def="what" */',
    extra: str = "",
    start: str = "",
    control: str = "{ a := A; ++ a := -A; }",
    domain: str = "",
    shape: str = "y",
    episode: str = "",
    post: str = "",
) -> str:
    """A cart with one decision; every argument is text put where its name says."""
    return f"""Theorem "{name}"
Definitions
  {const}
  Real A;
  /* @safety: penalty=-1, shape={{{shape}}}, on_failure=terminate:failure */
  Bool {safe}(Real y) <-> y >= -5;
  {extra}
End.
ProgramVariables
  /* @var: bound=[-9:9] */
  Real {x};
  /* @var: bound=[-9:9] */
  Real {v};
  Real a;
  Real t;
End.
{episode}
Problem
  {x} >= 0 & {x} <= 1 & {v} >= 0 & {v} <= 1 {start}
  -> [{{ {control} t := 0; {{ {x}' = {v}, {v}' = a, t' = 1 & t <= 1 & {v} <= 20 {domain} }} }}*]
     ({safe}({x}) {post})
End.
End.
"""


def described(text: str) -> str:
    """A line comment, which may hold what would end a block comment."""
    return f'// @const: bound=[1:2], unit="{text}", def="{text}"'


def doubling(first: str, following: str, times: int = 40) -> str:
    """Definitions that each use the one before twice: `%0` is the number of this one, `%1` of that one."""
    lines = [following.replace("%0", str(k + 1)).replace("%1", str(k)) for k in range(times)]
    return "\n  ".join([first, *lines])


TEXTS = (
    Case("comment_end", model(const=described("*/ #error harm /*")), "builds"),
    Case("comment_trigraph", model(const=described("???/ " * 40)), "builds"),
    Case("comment_backslash", model(const=described("x\\")), "builds"),
    Case("comment_percent", model(const=described("%s%n {0} $HOME `id` #include <x>")), "builds"),
    Case("comment_unicode", model(const=described("Größe ??/ 你好 \u2028 \u00a0")), "builds"),
    Case("comment_in_condition", model(domain="& v <= /* \\ ??/ * / #error */ 30"), "builds"),
    Case("long_line", model(control="/* " + "y" * 1_000_000 + " */ a := A;"), "builds"),
    Case("entry_path", model(name="../../../etc/passwd"), "builds"),
    Case("entry_comment", model(name="*/ #include </etc/passwd> /*\\\\"), "builds"),
    Case("entry_long", model(name="n" * 5000), "builds"),
    Case("entry_runtime_header", model(name="batch"), "builds"),
    Case("entry_unicode", model(name="中文"), "builds"),
    Case("line_ends_crlf", model().replace("\n", "\r\n"), "builds"),
    Case("line_ends_cr", model().replace("\n", "\r"), "builds"),
    Case("byte_order_mark", b"\xef\xbb\xbf" + model().encode(), "builds"),
    Case("nul", model(const=described("a\0b")), "control-character"),
    Case("escape_sequence", model(name="\x1b[2J"), "control-character"),
    Case("bidirectional", model(const=described("\u202e x \u2066")), "control-character"),
    Case("surrogate", model(name="\ud800"), "not-utf8"),
    Case("latin_1", model().replace("what", "caf\xe9").encode("latin-1"), "not-utf8"),
    Case("utf_16", model().encode("utf-16"), "not-utf8"),
    Case("random_bytes", Random(1).randbytes(100_000), "not-utf8"),
    Case("empty", "", "no-entry"),
    Case("file_size", model() + " " * 3_000_000, "file-too-large"),
    Case("quotes", '"' * 1_000_001, "never-closed"),
    Case("comment_openers", "/*" * 900_001, "never-closed"),
)

NAMES = (
    *(
        Case(f"variable_{word}", model(x=word), "builds")
        for word in ("NX", "NFACT", "main", "real", "I", "errno", "EDOM", "INFINITY", "sin", "inline", "t0")
    ),
    Case("variable_of_margin", model(x="margin0", domain="& margin0 <= 300"), "builds"),
    *(
        Case(f"predicate_{word}", model(safe=word), "builds")
        for word in ("precondition", "postcondition", "flow0", "F", "model", "int")
    ),
    Case("names_long", model(x="x" * 300, v="v" * 5000, safe="s" * 300), "builds"),
    Case("variable_runtime", model(x="dl2c_x"), "bad-name"),
    Case("variable_type", model(x="int8_t"), "bad-name"),
    Case("variable_suffix", model(x="X_v"), "bad-name"),
)

NESTED = (
    ("parentheses", "a := " + "(" * 20_000 + "A" + ")" * 20_000 + ";", "too-deep"),
    ("parentheses_open", "a := " + "(" * 100_000, "syntax"),
    ("braces", "{" * 5000 + "a := A;" + "}" * 5000, "too-deep"),
    ("negations", "?" + "!" * 5000 + "(x > 0); a := A;", "too-deep"),
    ("minus_signs", "a := " + "-" * 5000 + "A;", "too-deep"),
    ("powers", "a := 2" + "^2" * 5000 + ";", "too-deep"),
    ("long_sum", "a := A" + "+A" * 5000 + ";", "too-deep"),
    ("long_sequence", "a := A;" * 5000, "too-deep"),
    ("long_choice", "{a := A;" + "++ a := -A;" * 5000 + "}", "too-deep"),
    ("long_values", "a := x;" + ("{" + "a := a * 0.5 + x;" * 50 + "}") * 20 + "?a <= 9;", "too-deep"),
    ("many_paths", "{a := A; ++ a := -A;}" * 40, "too-many-paths"),
    ("many_branches", "if (x > 0) {a := A;} else {a := -A;}" * 40, "too-many-paths"),
    ("many_alternatives", "{a := A;" + "++ a := -A;" * 150 + "}", "builds"),
    ("doubling_assignments", "a := A;" + "a := a + a;" * 60, "too-large"),
)

GROWING = (
    ("terms", "Real d0 = A;", "Real d%0 = d%1 + d%1;", "a := d40;"),
    ("arguments", "Real d0(Real y) = y;", "Real d%0(Real y) = d%1(y * y);", "a := d40(x);"),
    (
        "predicates",
        "Bool d0(Real y) <-> y > 0;",
        "Bool d%0(Real y) <-> d%1(y) & d%1(y+1);",
        "?d40(x); a := A;",
    ),
    (
        "arguments_under_quantifiers",
        "Real d0(Real y) = y; Bool exact(Real y) <-> \\exists z (z <= y & z >= y);",
        "Real d%0(Real y) = d%1(y * y);",
        "?exact(d40(x)); a := A;",
    ),
    ("programs", "HP d0 ::= { a := A; };", "HP d%0 ::= { d%1; d%1; };", "d40;"),
    ("choices", "HP d0 ::= { a := A; };", "HP d%0 ::= { d%1; ++ d%1; };", "d40;"),
    ("branches", "HP d0 ::= { a := A; };", "HP d%0 ::= { if (x > 0) {d%1;} else {d%1;} };", "d40;"),
)

NUMBERS = (
    Case("digits", model(control=f"a := {'9' * 5000};"), "too-many-digits"),
    Case("digits_of_bound", model(const=f"/* @const: bound=[1:{'9' * 5000}] */"), "too-many-digits"),
    Case("digits_of_option", model(episode=f"/* @episode: dt={'9' * 5000} */"), "too-many-digits"),
    Case("bound_beyond_doubles", model(const=f"/* @const: bound=[1:{'9' * 390}] */"), "number-out-of-range"),
    Case("number_beyond_doubles", model(control=f"a := {'9' * 399};"), "number-out-of-range"),
    Case("number_below_doubles", model(control=f"a := 0.{'0' * 395}1;"), "builds"),
    Case("exponent_literal", model(control="a := 1e999999999;"), "syntax"),
    Case("exponent_of_option", model(episode="/* @episode: dt=1e999 */"), "number-out-of-range"),
    Case(
        "exponent_of_penalty", model(episode="/* @episode: blocked_penalty=1e999 */"), "number-out-of-range"
    ),
    Case("power", model(control="a := A^1000000;"), "builds"),
    Case("power_of_number", model(control="a := 3^1000000;"), "builds"),
    Case("powers_of_fraction", model(control="a := " + "(" * 6 + "0.1" + "^64)" * 6 + ";"), "builds"),
    Case("powers_in_domain", model(domain="& (((x)^64)^64)^64 <= 1000"), "builds"),
    Case(
        "powers_in_precondition",
        model(start="& (((x+v)^64)^64)^64 <= 1000 & x^63*v^61 >= 0"),
        "unsampled-precondition",
    ),
    Case(
        "hard_for_z3",
        model(start="& x^13*v^11 + v^7*x^17*A^3 = x^7 + A^5*v + 0.01"),
        "unsampled-precondition",
    ),
)

AMOUNTS = (
    Case("equivalences", model(start="& (" + "(x >= 0 <-> " * 60 + "x >= 0" + ")" * 61), "too-large"),
    Case(
        "doubling_loops",
        model(extra=doubling("HP d0 ::= { a := A; };", "HP d%0 ::= {{{{ d%1; }*}*}};"), control="d40;"),
        "too-large",
    ),
    Case("blank_description", model(const=described("a" + " " * 200_000 + "b")), "builds"),
    Case("annotation_lines", model(const=described("a" + "\n// @var x" * 50_000)), "builds"),
    Case("annotations", model(extra="// @const: x=1\n" * 50_000), "too-many-annotations"),
    Case("declarations", model(extra="Real a; // c\n" * 50_000), "too-many-declarations"),
    Case("names", model(extra=f"Real {','.join(f'c{i}' for i in range(50_000))};"), "too-many-declarations"),
    Case("entries", model() * 600, "too-many-entries"),
    Case("recursion", model(extra="Real f(Real y) = g(y); Real g(Real y) = f(y);"), "recursive-definition"),
)

SLIPS = (
    Case("slips", model(control="a = 1; " * 14_000), "syntax"),
    Case("slips_deep", model(control="{" * 100 + "a = 1; ?0 <= a <= 1;" * 50 + "}" * 100), "syntax"),
    Case("slips_parentheses", model(control="(" * 3000 + "a = 1;" + ")" * 3000), "syntax"),
    Case("slip_at_the_end", model(control="a := 1; " * 100 + "a = 1;"), "syntax"),
    Case("stray_blanks", model(extra=" " * 200_000 + "int c;"), "syntax"),
    Case(
        "large_body_used_often",
        model(
            extra="Real big(Real y) = y" + " + y" * 150 + ";",
            control="a := " + " + ".join(["big(x)"] * 150) + ";" + "a := big(a);" * 180,
        ),
        "too-large",
    ),
)

OLD = """Functions. %s End.
ProgramVariables. R x. End.
Problem. x = 0 -> [{{%s} {x' = 1 & x <= 1}}*]x <= 1 End."""
"""A model in the dialect of KeYmaera X 4, without annotations."""

OLD_DIALECT = (
    Case("old_plain", OLD % ("", "x := 0;"), "builds"),
    Case("old_declarations", OLD % ("R a. " * 50_000, "?true;"), "too-many-declarations"),
    Case("old_sorts", OLD % ("R " * 500_000, "?true;"), "syntax"),
    Case("old_lines_of_sorts", OLD % ("R\n" * 500_000, "?true;"), "too-many-declarations"),
    Case("old_blanks", OLD % (("R" + " " * 2000) * 500, "?true;"), "syntax"),
    Case("old_sections", "Functions. R a. End.\n" * 50_000 + OLD % ("", "?true;"), "too-many-sections"),
    Case("old_dots", OLD % ("R f(R) = (" + "." * 100_000 + ").", "?true;"), "syntax"),
    Case("old_parameters", OLD % ("R f(" + "R," * 50_000 + "R).", "?true;"), "builds"),
    Case("old_sum_of_dots", OLD % ("R f(R) = (" + ".+" * 5000 + "1).", "?true;"), "too-deep"),
    Case("old_bare_ends", "Problem. x = 0 End." + " End." * 100_000, "too-many-sections"),
)

IMPLICIT = (
    Case(
        "implicit_deep",
        model(extra="implicit Real f(Real t) = {{f:=1;}; {f'=" + "(" * 20_000 + "}};"),
        "syntax",
    ),
    Case(
        "implicit_many",
        model(
            extra="implicit Real f(Real t) = {{f:=1;}; {f'=f1"
            + "".join(f", f{k}'=f{k + 1}" for k in range(1, 20_000))
            + ", f20000'=f}};",
            control="a := f(x);",
        ),
        "implicit-function",
    ),
    Case(
        "implicit_uses",
        model(
            extra="implicit Real f(Real t) = {{f:=1;}; {f'=f}};"
            + doubling("Real d0 = f(A);", "Real d%0 = d%1 + d%1;"),
            control="a := d40;",
        ),
        "too-large",
    ),
)

CASES = (
    *TEXTS,
    *SLIPS,
    *OLD_DIALECT,
    *IMPLICIT,
    *NAMES,
    *(Case(name, model(control=control), expected) for name, control, expected in NESTED),
    *(
        Case(f"doubling_{name}", model(extra=doubling(first, following), control=use), "too-large")
        for name, first, following, use in GROWING
    ),
    *NUMBERS,
    *AMOUNTS,
)


def mutated(content: bytes, seed: int) -> bytes:
    """A model with some bytes changed, or with something grown inside it."""
    rng = Random(seed)
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 5, 20))):
        at = rng.randrange(len(data))
        match rng.randrange(6):
            case 0:
                data[at] ^= 1 << rng.randrange(8)
            case 1:
                data[at:at] = rng.randbytes(rng.randint(1, 3))
            case 2:
                del data[at : at + rng.randint(1, 8)]
            case 3:
                piece = bytes(data[at : at + rng.randint(1, 200)])
                data[at:at] = piece * rng.choice((1, 3, 100))
            case 4:
                opener = rng.choice((b"(", b"{", b"[", b"!", b"-", b"/*", b'"'))
                data[at:at] = opener * rng.choice((1, 300, 5000))
            case _:
                digits = [i for i, byte in enumerate(data) if chr(byte).isdigit()]
                k = rng.choice(digits or [0])
                data[k : k + 1] = rng.choice(
                    (b"9" * 30, b"9" * 600, b"0", b"0." + b"0" * 300 + b"1", b"(1/3)^64")
                )
    return bytes(data)
