"""A mistake of syntax hides no mistake of names elsewhere, and makes none of its own."""

from pathlib import Path
from random import Random

import pytest
from generators.kyx_builder import codes, model_text
from selection import few_and_many

from dl2c.diagnostics import CompileError
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.pipeline import check_model
from dl2c.source import Source

DEFINITIONS = """Real b;
Bool safe(Real y) <-> y <= 9;
Real twice(Real y) = 2*y;
HP ctrl ::= { v := twice(b); };"""
PROBLEM = """x = 0 & v = 0 & b = 1 ->
  [{
    ctrl; {x' = v, v' = -b & v >= 0}
  }*] safe(x)"""
OPTIONS = Options()


def found_in(text: str) -> list[str]:
    with pytest.raises(CompileError) as refused:
        check_model(Source("model.kyx", text), OPTIONS)
    return sorted(codes(refused.value))


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ((("2*y;", "2**y;"), ("v := twice(b)", "v := twice(q)")), ["syntax", "undeclared-variable"]),
        ((("2*y;", "2**y;"), ("safe(x)", "safe(x, v)")), ["syntax", "wrong-arity"]),
        ((("ctrl; {x'", "v :=; ctrl; {x'"), ("safe(x)", "sage(x)")), ["syntax", "undeclared-predicate"]),
        ((("ctrl; {x'", "v :=;\n ctr; {x'"),), ["syntax", "undefined-program"]),
        ((("y <= 9", "y <= "), ("twice(b)", "twice(v, b)")), ["syntax", "wrong-arity"]),
        ((("y <= 9", "y <= "), ("2*y", "2*z")), ["syntax", "undeclared-variable"]),
        ((("Real b;", "Real b b;"), ("2*y", "2*z")), ["syntax"]),
        ((("Real b;", "Real b c;"), ("twice(b)", "twice(c)")), ["syntax"]),
        ((("ctrl; {x'", "q := ; ctrl; {x'"), ("safe(x)", "safe(x + q)")), ["syntax"]),
        ((("x = 0 &", "x = = 0 &"), ("safe(x)", "safe(w)")), ["syntax", "undeclared-variable"]),
    ],
)
def test_mistakes_of_names_are_found_beside_those_of_syntax(
    changes: tuple[tuple[str, str], ...], found: list[str]
) -> None:
    text = model_text(PROBLEM, DEFINITIONS)
    check_model(Source("model.kyx", text), OPTIONS)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    assert sorted(set(found_in(text))) == found


@pytest.mark.parametrize("count", few_and_many(10, 40))
def test_a_mistake_of_syntax_alone_stays_alone(count: int) -> None:
    """Cut out or doubled characters of models that are right bring errors of reading only."""
    models = sorted((Path(__file__).parents[1] / "good").glob("*.kyx"))
    rng, broken = Random(3), 0
    for path in models[:12]:
        text = path.read_text(encoding="utf-8")
        begin = text.index("Definitions") if "Definitions" in text else text.index("ProgramVariables")
        signs = [k for k in range(begin, len(text)) if text[k] in ";()=<>{}[]*/+-&|:"]
        for at in rng.sample(signs, min(count, len(signs))):
            changed = text[:at] + rng.choice(("", text[at] * 2)) + text[at + 1 :]
            try:
                parse_archive(Source(path.name, changed))
            except CompileError:
                broken += 1
                found = found_in(changed)
                assert not any(c.startswith(("undeclared-", "undefined-")) for c in found), (changed, found)
    assert broken > 1.5 * count
