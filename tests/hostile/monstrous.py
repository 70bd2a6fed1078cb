"""Models that are wrong, or far too large in one respect: none needs to compile, each has to be answered.

Every way takes random numbers and a size of 0, 1 or 2.
"""

from collections.abc import Callable
from pathlib import Path
from random import Random

from hostile.cases import doubling, model, mutated
from hostile.enlarged import EXAMPLES

Monster = Callable[[Random, int], str | bytes]


def monstrous(number: int, examples: Path) -> bytes:
    """Model `number`, whose way and size follow from the number."""
    rng = Random(f"monstrous {number}")
    ways = [*WAYS, *SPOILT]
    way, size = ways[number % len(ways)], number // len(ways) % 3
    if way in WAYS:
        made = WAYS[way](rng, size)
        return made if isinstance(made, bytes) else made.encode()
    path = examples / f"{EXAMPLES[number // len(ways) % len(EXAMPLES)]}.kyx"
    return SPOILT[way](path.read_bytes(), rng)


def way_of(number: int) -> str:
    """How model `number` is made."""
    ways = [*WAYS, *SPOILT]
    return ways[number % len(ways)]


def _about(rng: Random, size: int) -> int:
    """A size near this one, no less than 1."""
    return max(1, round(size * rng.uniform(0.75, 1.25)))


# Length and depth --------------------------------------------------------------


def _terms(rng: Random, size: int) -> str:
    """In groups, so that nothing is deep."""
    group = "(" + " + ".join(f"{rng.randint(1, 99)} * x * v" for _ in range(90)) + ")"
    rows = "(" + " + ".join([group] * (3, 10, 30)[size]) + ")"
    return model(control="a := " + " + ".join([rows] * (2, 6, 20)[size]) + ";")


def _statements(rng: Random, size: int) -> str:
    block = "{" + " ".join(f"a := a * 0.{rng.randint(1, 9)} + x;" for _ in range(100)) + "}"
    part = "{" + block * (2, 10, 50)[size] + "}"
    return model(control="a := A; " + part * (2, 10, 20)[size])


def _deep(rng: Random, size: int) -> str:
    depth = _about(rng, (190, 2000, 100_000)[size])
    opening, closing = rng.choice((("(", ")"), ("{", "}"), ("(-(", "))"), ("if (x > 0) {", "}")))
    inner = "A" if closing[0] == ")" else "a := A;"
    text = opening * depth + inner + closing * depth
    return model(control=f"a := {text};" if inner == "A" else text)


def _formulas(rng: Random, size: int) -> str:
    """Conjunctions of disjunctions."""
    count = (8, 20, 120)[size]
    pairs = [f"(x <= {rng.randint(1, 9)} | v >= {rng.randint(1, 9)} & x * v <= {k})" for k in range(count)]
    return model(start="& " + " & ".join(pairs))


def _domains(rng: Random, size: int) -> str:
    count = (6, 15, 80)[size]
    return model(
        domain="& "
        + " & ".join(
            f"(x <= {rng.randint(5, 50)} | v * x <= {k + 5} | x^2 + v^2 <= {k})" for k in range(count)
        )
    )


def _implications(rng: Random, size: int) -> str:
    depth = _about(rng, (60, 180, 20_000)[size])
    sign = rng.choice(("->", "<->"))
    return model(start=f"& (x <= 1 {sign} (" + f"x <= 2 {sign} (" * depth + "v >= 0" + ")" * depth + "))")


# Definitions -------------------------------------------------------------------


def _recursive(rng: Random, size: int) -> str:
    count = _about(rng, (1, 20, 400)[size])
    kind = rng.choice(("Real", "Bool", "HP"))
    match kind:
        case "Real":
            lines = [
                f"Real f{k}(Real y) = f{(k + 1) % count}(y) + {rng.randint(1, 99)};" for k in range(count)
            ]
            return model(extra="\n".join(lines), control="a := f0(x);")
        case "Bool":
            lines = [
                f"Bool f{k}(Real y) <-> f{(k + 1) % count}(y + {rng.randint(1, 99)});" for k in range(count)
            ]
            return model(extra="\n".join(lines), control="?f0(x); a := A;")
        case _:
            lines = [f"HP f{k} ::= {{ f{(k + 1) % count}; }};" for k in range(count)]
            return model(extra="\n".join(lines), control=f"f0; a := {rng.randint(1, 99)};")


def _doubling(rng: Random, size: int) -> str:
    times = _about(rng, (8, 13, 100)[size])
    first, following, use = rng.choice(
        (
            ("Real d0(Real y) = y + v;", "Real d%0(Real y) = d%1(y) * d%1(y + 1);", f"a := d{times}(x);"),
            (
                "Bool d0(Real y) <-> y > 0;",
                "Bool d%0(Real y) <-> d%1(y) | d%1(-y);",
                f"?d{times}(x); a := A;",
            ),
            ("HP d0 ::= { a := a + x; };", "HP d%0 ::= { d%1; ++ d%1; };", f"d{times};"),
            ("HP d0 ::= { a := a + x; };", "HP d%0 ::= { d%1; if (a > 1) { d%1; } };", f"d{times};"),
        )
    )
    return model(extra=doubling(first, following, times), control=f"{use} a := a + {rng.randint(1, 999)};")


def _declarations(rng: Random, size: int) -> str:
    count = _about(rng, (500, 990, 20_000)[size])
    if rng.random() < 0.5:
        return model(extra="\n".join(f"Real c{k};" for k in range(count)))
    return model(extra="Real " + ", ".join(f"c{k}" for k in range(count)) + ";")


def _annotations(rng: Random, size: int) -> str:
    count = _about(rng, (500, 4000, 50_000)[size])
    if rng.random() < 0.5:
        return model(extra="".join(f"/* @unknown{k}: x=1 */\n" for k in range(count)))
    return model(const=f"/* @const: {', '.join(f'a{k}=1' for k in range(count))} */")


# What Z3, the sampler and the flows are given ----------------------------------


def _quantifiers(rng: Random, size: int) -> str:
    count = (2, 4, 8)[size]
    binders = " ".join(f"\\{rng.choice(('forall', 'exists'))} y{k} (" for k in range(count))
    names = [f"y{k}" for k in range(count)]
    terms = " & ".join(
        f"{y}^{rng.randint(2, 6)} * x + {z} >= v * {y}" for y, z in zip(names, [*names[1:], "x"], strict=True)
    )
    return model(start=f"& {binders} {terms} {')' * count}")


def _exponents(rng: Random, size: int) -> str:
    power = _about(rng, (64, 1000, 10**9)[size])
    text = rng.choice(
        (f"(x + v + A)^{power}", f"(x^{power} + v^{power})^{power}", f"2^{power}^x", f"x^-{power}")
    )
    place = rng.choice(("control", "domain", "start"))
    return model(
        **{
            place: f"a := {text} - {rng.randint(1, 99)};"
            if place == "control"
            else f"& {text} <= {rng.randint(100, 9999)}"
        }
    )


def _equalities(rng: Random, size: int) -> str:
    """Of higher degree, coupled."""
    count = (3, 6, 12)[size]
    names = ["x", "v", "A"]
    lines = []
    for k in range(count):
        powers = " + ".join(f"{rng.randint(1, 9)} * {y}^{rng.randint(1, 4)}" for y in names)
        lines.append(
            f"{powers} = {rng.randint(1, 20)} + {rng.choice(names)} * {rng.choice(names)}^{k % 4 + 1}"
        )
    return model(start="& " + " & ".join(lines))


def _equations(rng: Random, size: int) -> str:
    """A coupled system that has no closed form."""
    count = (10, 60, 300)[size]
    names = [f"y{k}" for k in range(count)]
    declared = "".join(f"/* @var: bound=[0:1] */ Real {y};\n" for y in names)
    rows = ", ".join(
        f"{y}' = {rng.choice(names)} * {rng.choice(names)} - {rng.randint(1, 3)} * {y}^{rng.randint(1, 3)}"
        for y in names
    )
    text = model(domain=f"& {names[0]} * {names[-1]} <= 5").replace("t' = 1", f"t' = 1, {rows}")
    return text.replace("Real a;", f"{declared} Real a;")


def _paths(rng: Random, size: int) -> str:
    count = _about(rng, (5, 9, 40)[size])
    part = rng.choice(
        (
            "{ a := A; ++ a := -A; ++ a := x; }",
            "if (x > a) { a := a + 1; } else { a := -A; }",
            "{ ?x > a; a := a + v; ++ ?x <= a; }",
        )
    )
    return model(control=f"a := A + {rng.randint(1, 999)}; " + part * count)


def _loops(rng: Random, size: int) -> str:
    depth = _about(rng, (2, 5, 30)[size])
    return model(control="a := A; " + f"{{ ?x > 0; a := a - {rng.randint(1, 999)}; " * depth + "}*" * depth)


def _wrong(rng: Random, size: int) -> str:
    """Mistakes, many of them."""
    count = (1, 50, 3000)[size]
    mistakes = (
        "nosuch := 1;", "a = 1;", "a := nosuch(1, 2);", "?x;", "a := safe;", "x' := ;", "}", "{", "a := 1 +;",
        "?forall y (y > 0);", "@;", "a := $1;", "if x then a;", "a := x y;", "while (true) {a := 1;}",
    )  # fmt: skip
    return model(control=" ".join(rng.choice(mistakes) for _ in range(count)))


def _entries(rng: Random, size: int) -> str:
    return "\n".join(
        model(name=f"M{k}") for k in range(_about(rng, (4, 40, 420)[size]))
    ) + model() * rng.randint(0, 1)


WAYS: dict[str, Monster] = {
    "terms": _terms,
    "statements": _statements,
    "deep": _deep,
    "formulas": _formulas,
    "domains": _domains,
    "implications": _implications,
    "recursive": _recursive,
    "doubling": _doubling,
    "declarations": _declarations,
    "annotations": _annotations,
    "quantifiers": _quantifiers,
    "exponents": _exponents,
    "equalities": _equalities,
    "equations": _equations,
    "paths": _paths,
    "loops": _loops,
    "wrong": _wrong,
    "entries": _entries,
}


# Files -------------------------------------------------------------------------


def _cut(content: bytes, rng: Random) -> bytes:
    return content[: rng.randrange(len(content))]


def _mixed(content: bytes, rng: Random) -> bytes:
    """Lines in another order."""
    lines = content.splitlines(keepends=True)
    for _ in range(rng.choice((1, 5, 50))):
        k = rng.randrange(len(lines))
        lines.insert(rng.randrange(len(lines)), lines.pop(k))
    return b"".join(lines)


def _junk(content: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(content))
    return content[:at] + rng.randbytes(rng.choice((1, 100, 100_000))) + content[at:]


SPOILT: dict[str, Callable[[bytes, Random], bytes]] = {
    "cut": _cut,
    "mixed": _mixed,
    "junk": _junk,
    "mutated": lambda content, rng: mutated(content, rng.getrandbits(32)),
}
