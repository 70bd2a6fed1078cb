"""What users are told about models that cannot be compiled, word for word."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest
from generators.syntax_strategies import archives
from hypothesis import given, settings
from hypothesis import strategies as st

from dl2c.configuration import resolve_options
from dl2c.diagnostics import CompileError
from dl2c.parse.printer import print_archive
from dl2c.pipeline import check_model
from dl2c.source import NOWHERE, Source

FAMILIES = ("name", "sort", "definition", "shape", "fragment", "episode", "scene", "input")
BAD = sorted(p for family in FAMILIES for p in (Path(__file__).parent / "bad").glob(f"{family}_*.kyx"))
EXAMPLE = Path(__file__).parent.parent / "examples" / "waypoint.kyx"


def options_of(text: str) -> dict[str, object]:
    """A file may name its options: `/* options: {...} */` in its first line, in JSON."""
    found = re.match(r"/\* options: (\{.*\}) \*/\n", text)
    return json.loads(found.group(1)) if found else {}


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_mistakes_are_explained(path: Path, golden: Callable[[Path, str], None]) -> None:
    text = path.read_text(encoding="utf-8")
    with pytest.raises(CompileError) as refused:
        check_model(Source(path.name, text), resolve_options(options_of(text)))
    for diagnostic in refused.value.diagnostics:
        assert diagnostic.severity == "error"
        assert diagnostic.span != NOWHERE, "every message has a place"
        assert diagnostic.label or diagnostic.help, "every message says more than its title"
    golden(path.with_name(path.name + ".expected"), f"{refused.value}\n")


def test_there_are_bad_files_for_many_mistakes() -> None:
    assert len(BAD) >= 50
    assert {path.stem.split("_")[0] for path in BAD} == set(FAMILIES)


# Whatever is written is compiled or explained ---------------------------------


def explained(text: str) -> None:
    try:
        check_model(Source("any.kyx", text), resolve_options({}))
    except CompileError as refused:
        assert str(refused)


@given(archives())
def test_any_archive_is_compiled_or_explained(archive: object) -> None:
    explained(print_archive(archive))  # pyright: ignore[reportArgumentType]


SMALL = """Theorem "Small"
Definitions
  /* @const: bound=[1:2] */
  Real A;
  Real half(Real y) = y / 2;
  /* @safety: penalty=-1, shape={y - 1}, on_failure=terminate:failure */
  Bool safe(Real y) <-> y >= 0;
  /* @progress: reward=1, on_success=terminate:success */
  Bool there(Real y) <-> y > 5;
  HP ctrl ::= { { ?x > 1; v := A; ++ v := -A; } a := *; ?-A <= a & a <= half(A); };
End.
ProgramVariables
  /* @var: bound=[0:9] */
  Real x;
  /* @var: bound=[0:3] */
  Real v;
  Real a;
  Real t;
End.
Problem
  safe(x) & v < x + A -> [{ ctrl; t := 0; {x' = v, v' = a, t' = 1 & t <= 1 & v >= 0} }*@invariant(safe(x))]
    (safe(x) & (v <= 0 -> there(x)))
End.
End.
"""

TOKEN = re.compile(r"/\*.*?\*/|[A-Za-z_0-9.]+|\s+|:=|<=|>=|<->|->|\+\+|!=|.", re.DOTALL)
NAMES = (
    "x",
    "v",
    "a",
    "t",
    "A",
    "y",
    "half(x)",
    "half",
    "safe(x)",
    "there",
    "ctrl;",
    "ctrl",
    "nope",
    "e",
    "0",
    "1.5",
)
NAMES += (
    "1/0",
    "(1/x)",
    "x^0",
    "x^-1",
    "2^x",
    "(10^60)^6",
    "abs(v)",
    "sqrt(x)",
    "sin(t)",
    "x'",
    "(x)'",
    "old(x)",
    "f(||)",
)
STATEMENTS = (
    "a := *;",
    "x := *; ?x = 1;",
    "?false;",
    "x := 1/0;",
    "{v := 1; ++ v := 2;}",
    "if (v > 0) {v := 1;}",
)
STATEMENTS += (
    "{x' = v}",
    "{v' = 1/v}",
    "{x' = x}",
    "{v' = 1, x' = v^3}",
    "{v' = 0 * (1/x)}",
    "{v := 1;}*",
    "{ctrl}",
)
STATEMENTS += (
    "{v := 1;}^@",
    "?[ctrl;]x > 0;",
    "?\\exists y y > x;",
    "x' := 1;",
    "__________;",
    "x := __________;",
)
FORMULAS = (
    "true",
    "false",
    "1/x > 0",
    "\\forall y y > x",
    "[ctrl;]x > 0",
    "safe(v)",
    "(x > 0 <-> v > 0)",
    "0/0 = 0/0",
)
FORMULAS += (
    "x^x > 1",
    "x * x = 2",
    "x > 10",
    "ctrl",
    "there(1, 2)",
    "__________",
    "old(x) = x",
    "x' = 1",
    "{x > 0}",
)
ATTRIBUTES = (
    "shape={there}",
    "shape={safe(v)}",
    "reward={x'}",
    "shape={true}",
    "penalty={[ctrl;]true}",
    "role=env",
)
ATTRIBUTES += (
    "bound=[0:0]",
    "bound=[-inf:inf]",
    "on_failure=continue:success",
    "shape={\\forall y y > 0}",
    "observe=false",
)


def mutated(text: str, rng: Random) -> str:
    """The text with up to three changes that mostly leave it grammatical."""
    tokens = TOKEN.findall(text)
    begin = tokens.index("Definitions")
    for _ in range(rng.choice((1, 1, 2, 3))):
        k = rng.randrange(begin, len(tokens))
        match tokens[k]:
            case ";" | "{":
                tokens[k] += f" {rng.choice(STATEMENTS)} "
            case "&" | "->" | "|":
                tokens[k] += f" {rng.choice(FORMULAS)} & "
            case "<" | "<=" | ">" | ">=" | "=":
                tokens[k] = rng.choice(("<", "<=", ">", ">=", "=", "!="))
            case "+" | "-" | "*" | "/":
                tokens[k] = rng.choice("+-*/^")
            case token if token.startswith("/* @"):
                tokens[k] = (
                    token.replace(": ", f": {rng.choice(ATTRIBUTES)}, ", 1) if rng.random() < 0.7 else ""
                )
            case token if re.fullmatch(r"[a-z0-9A-Z.]{1,5}", token) and token not in (
                "Real",
                "Bool",
                "HP",
                "End.",
            ):
                tokens[k] = rng.choice(NAMES)
            case token if token.strip() and rng.random() < 0.1:
                tokens[k] = ""
            case _:
                pass
    return "".join(tokens)


def test_the_unchanged_models_compile() -> None:
    for text in (SMALL, EXAMPLE.read_text(encoding="utf-8")):
        check_model(Source("model.kyx", text), resolve_options({}))


@settings(max_examples=120)
@given(st.integers(0, 10**9))
def test_a_mutated_model_is_compiled_or_explained(seed: int) -> None:
    explained(mutated(SMALL, Random(seed)))


@settings(max_examples=6)
@given(st.integers(0, 10**9))
def test_a_mutated_example_is_compiled_or_explained(seed: int) -> None:
    explained(mutated(EXAMPLE.read_text(encoding="utf-8"), Random(seed)))
