"""Annotations: where they are found, and what they say."""

import re
from dataclasses import replace
from fractions import Fraction

import pytest
from conftest import shared
from hypothesis import given
from hypothesis import strategies as st

from dl2c.diagnostics import CompileError
from dl2c.parse.annotations import (
    ChoiceAnnotation,
    ConstantAnnotation,
    FallbackAnnotation,
    PredicateAnnotation,
    Trigger,
    VariableAnnotation,
    decode_declaration,
    decode_problem,
    decode_program,
)
from dl2c.parse.parser import parse_archive, parse_formula, parse_term
from dl2c.parse.printer import print_archive
from dl2c.parse.tree import Entry
from dl2c.source import NOWHERE, Source


def entry(
    definitions: str = "", variables: str = "", above_problem: str = "", problem: str = "true"
) -> Entry:
    text = (
        f'Theorem "T"\nDefinitions\n{definitions}\nEnd.\nProgramVariables\n{variables}\nEnd.\n'
        f"{above_problem}\nProblem\n{problem}\nEnd.\nEnd.\n"
    )
    archive, _ = parse_archive(Source("model.kyx", text))
    return archive.entries[0]


def variable(comment: str) -> VariableAnnotation:
    (decoded,) = decode_declaration(entry(variables=f"{comment}\nReal x;").variables[0], "variable")
    assert isinstance(decoded, VariableAnnotation)
    return decoded


def predicate(comment: str) -> PredicateAnnotation:
    (decoded,) = decode_declaration(
        entry(f"{comment}\nBool p(Real x) <-> x > 0;").definitions[0], "definition"
    )
    assert isinstance(decoded, PredicateAnnotation)
    return decoded


def codes_of(
    definitions: str = "", variables: str = "", above_problem: str = "", problem: str = "true"
) -> list[str]:
    with pytest.raises(CompileError) as refused:
        read = entry(definitions, variables, above_problem, problem)
        for declaration in read.definitions:
            decode_declaration(declaration, "definition")
        for declaration in read.variables:
            decode_declaration(declaration, "variable")
        decode_program(read.program_annotations)
        decode_problem(read.problem_annotations)
    return [diagnostic.code for diagnostic in refused.value.diagnostics]


# ---------------------------------------------------------------- the paper's own examples


def test_the_variable_annotations_of_the_paper() -> None:
    read = entry(
        '// @const: bound=[0.8:1.2], def="friction coefficient"\nReal mu;',
        '// @var: bound=[0:100], plot=line, def="vehicle position"\nReal x;',
    )
    (const,) = decode_declaration(read.definitions[0], "definition")
    (var,) = decode_declaration(read.variables[0], "variable")
    assert replace(const, span=NOWHERE) == ConstantAnnotation(
        (Fraction(4, 5), Fraction(6, 5)), "friction coefficient", "none", "", True, NOWHERE
    )
    assert replace(var, span=NOWHERE) == VariableAnnotation(
        (Fraction(0), Fraction(100)), "vehicle position", "line", None, "", True, NOWHERE
    )


def test_the_predicate_annotations_of_the_paper() -> None:
    safe = predicate("// @safety: penalty=-1000, shape=x, on_failure=truncate:failure")
    assert (safe.category, safe.penalty, safe.shape, safe.reward) == (
        "safety",
        parse_term("-1000"),
        parse_term("x"),
        None,
    )
    assert safe.on_failure is not None
    assert (safe.on_failure.action, safe.on_failure.status) == ("truncate", "failure")
    goal = predicate("// @progress: reward=500, shape={-abs(x - gx)}, on_success=terminate:success")
    assert (goal.reward, goal.shape) == (parse_term("500"), parse_term("-abs(x - gx)"))


def test_an_annotation_goes_on_in_the_next_line_while_something_is_open() -> None:
    safe = predicate(
        "// @safety: penalty=-1000, shape={(abs(x-xo) - stopDist(v)) +\n"
        "//   (abs(y-yo) - stopDist(v))}, on_failure=truncate:status=failure,\n"
        "//   on_success=continue:status=none"
    )
    assert safe.shape == parse_term("(abs(x-xo) - stopDist(v)) + (abs(y-yo) - stopDist(v))")
    assert safe.on_success is not None and safe.on_success.action == "continue"
    assert variable('// @var: def="far\n//   too long"').description == "far too long"
    assert variable("// @var: bound=[0:1]\n//   , plot=hist").plot == "hist"


def test_prose_below_an_annotation_is_not_part_of_it() -> None:
    assert variable("// @var: bound=[0:1]\n// plot=hist is not meant here").plot == "none"


@pytest.mark.parametrize(
    "comment",
    [
        '// @var: bound=[0:1], def="d", unit="m/s"',
        '/* @var: bound=[0:1], def="d", unit="m/s" */',
        '/* @var: bound=[0:1];\n *  def="d";\n *  unit="m/s"\n */',
        '/*\n   @var: bound=[0:1]; def="d",\n   unit="m/s" */',
        '// @var: bound=[ 0 : 1.0 ] ;; def = "d" , unit="m/s",',
    ],
)
def test_the_forms_of_comments_say_the_same(comment: str) -> None:
    found = variable(comment)
    assert (found.bound, found.description, found.unit) == ((0, 1), "d", "m/s")


def test_separators_inside_brackets_and_quotes_do_not_separate() -> None:
    assert variable('// @var: def="a, b; c=d", role=env').description == "a, b; c=d"
    assert predicate("// @safety: shape=max(x, y)").shape == parse_term("max(x, y)")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("shape=x - 1", "x - 1"),
        ("shape={x - 1}", "x - 1"),
        ("shape=(x - 1)", "x - 1"),
        ("shape={max(x,\n//   1)}", "max(x, 1)"),
    ],
)
def test_expressions_may_stand_in_braces(text: str, value: str) -> None:
    assert predicate(f"// @safety: {text}").shape == parse_term(value)


def test_an_expression_may_be_a_formula() -> None:
    assert predicate("// @progress: shape={x > 0 & p(x)}").shape == parse_formula("x > 0 & p(x)")


def test_spans_of_values_are_exact() -> None:
    read = entry("// @safety: penalty=-1000, shape={x +\n//  bad}\nBool p <-> true;").definitions[0]
    (_, _, penalty), (_, text, shape) = read.annotations[0].attributes
    assert penalty.text == "-1000"
    assert text == "{x + bad}"
    assert shape.text == "{x +\n//  bad}"
    (decoded,) = decode_declaration(read, "definition")
    assert isinstance(decoded, PredicateAnnotation) and decoded.shape is not None
    assert decoded.shape.span.text == "x +\n//  bad"


@given(st.decimals(-(10**6), 10**6, places=3), st.decimals(0, 10**6, places=3))
def test_bounds_are_exact(low: object, width: object) -> None:
    first, last = Fraction(str(low)), Fraction(str(low)) + Fraction(str(width))
    found = variable(f"// @var: bound=[{float(first):.3f}:{float(last):.3f}]").bound
    assert found == (first, last)


def test_infinite_ends_of_bounds_are_none() -> None:
    assert variable("// @var: bound=[-inf:3]").bound == (None, 3)
    assert variable("// @var: bound=[-3:inf]").bound == (-3, None)


def test_the_status_of_a_trigger_may_be_named_or_absent() -> None:
    found = predicate("// @progress: on_success=terminate:status=success, on_failure=continue")
    assert (found.on_success, found.on_failure) == (
        Trigger("terminate", "success", found.on_success.span if found.on_success else NOWHERE),
        Trigger("continue", "none", found.on_failure.span if found.on_failure else NOWHERE),
    )


def test_the_listing_of_the_paper_is_read_with_its_annotations() -> None:
    """Listing 1.1 without the wrapping of its lines and with the brace that the extracted text lost."""
    paper = shared("paper/gymnasium-dl.txt").read_text(encoding="utf-8")
    listing = paper[paper.index("Listing 1.1") :].split("```")[1::2]
    lines = [line for page in listing[:4] for line in page.splitlines()]
    text = "\n".join(re.sub(r"^ *\d+ ?", "", line) for line in lines)
    text = re.sub(r"\s*\n\s*(?://\s*)?↪ *", " ", text).replace("HP dwppdl ::= {", "HP dwppdl ::= { {")
    archive, warnings = parse_archive(Source("listing.kyx", text))
    (read,) = archive.entries
    decoded = [a for d in read.definitions for a in decode_declaration(d, "definition")]
    assert [type(a).__name__ for a in decoded] == ["ConstantAnnotation"] * 5 + ["PredicateAnnotation"] * 2
    assert [decode_declaration(d, "variable")[0].span.line for d in read.variables]
    assert [d.name for d in read.variables] == ["xr", "vr", "ar", "xg", "t", "T"]
    assert {warning.code for warning in warnings} == {"keymaera-rejects"}


# ---------------------------------------------------------------- places


def test_one_annotation_above_a_list_belongs_to_every_name() -> None:
    assert [
        len(v.annotations) for v in entry(variables="// @var: role=env\nReal x, y;\nReal z;").variables
    ] == [
        1,
        1,
        0,
    ]


def test_several_categories_may_stand_above_one_predicate() -> None:
    read = entry("// @safety: penalty=-1\n// @progress: reward=1\nBool p <-> true;").definitions[0]
    assert [
        a.category for a in decode_declaration(read, "definition") if isinstance(a, PredicateAnnotation)
    ] == [
        "safety",
        "progress",
    ]


def test_annotations_inside_programs_keep_their_order() -> None:
    read = entry(
        'HP ctrl ::= { /* @choice: role=env, name="mode" */ { a; ++ /* @fallback */ b; } };',
        problem='[ // @choice: name="other"\n a; ++ b; ]true',
    )
    first, second, third = decode_program(read.program_annotations)
    assert isinstance(first, ChoiceAnnotation) and (first.role, first.name) == ("env", "mode")
    assert isinstance(second, FallbackAnnotation)
    assert isinstance(third, ChoiceAnnotation) and (third.role, third.name) == (None, "other")


def test_episode_options_have_types() -> None:
    read = entry(
        above_problem="// @episode: max_episode_steps=500, dt=0.05; duration=agent,\n"
        "//   on_blocked=truncate, observe_constants=false, tolerance=1e-9, blocked_penalty=-2.5"
    )
    episode = decode_problem(read.problem_annotations)
    assert episode is not None
    assert [(name, value) for name, value, _ in episode.options] == [
        ("max_episode_steps", 500),
        ("dt", Fraction(1, 20)),
        ("duration", "agent"),
        ("on_blocked", "truncate"),
        ("observe_constants", False),
        ("tolerance", Fraction(1, 10**9)),
        ("blocked_penalty", Fraction(-5, 2)),
    ]
    assert [span.text for _, _, span in episode.options][:3] == ["500", "0.05", "agent"]


def test_without_an_episode_annotation_there_is_none() -> None:
    assert decode_problem(entry().problem_annotations) is None


@pytest.mark.parametrize(
    "comment",
    ["/* @author me */", "/* @author: me */", "/* @invariant(x > 0) */", "// mail@home: x", "/* see @var */"],
)
def test_other_comments_are_ignored(comment: str) -> None:
    assert entry(variables=f"{comment}\nReal x;").variables[0].annotations == ()


def test_printed_archives_keep_the_annotations_of_declarations() -> None:
    read = entry(
        "// @safety: penalty=-1, shape={x +\n// 1}\nBool p(Real x) <-> x > 0;",
        "// @var: bound=[0:1]\nReal x;",
        "// @episode: dt=0.1",
    )
    text = print_archive(parse_archive(Source("m.kyx", read.span.source.text))[0])
    again = parse_archive(Source("printed.kyx", text))[0].entries[0]

    def said(e: Entry) -> list[object]:
        found = [a for d in (*e.definitions, *e.variables) for a in d.annotations]
        return [(a.name, [(n, v) for n, v, _ in a.attributes]) for a in (*found, *e.problem_annotations)]

    assert said(again) == said(read)


# ---------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("comment", "code"),
    [
        ("// @vra: bound=[0:1]", "unknown-annotation"),
        ("// @var bound=[0:1]", "malformed-annotation"),
        ("// @var: bnd=[0:1]", "unknown-attribute"),
        ("// @var: reward=1", "unknown-attribute"),
        ("// @var: bound=[0:1], bound=[0:2]", "repeated-attribute"),
        ("// @var: bound=[0:1]\n// @var: plot=line", "repeated-annotation"),
        ("// @var: bound=[1:0]", "malformed-value"),
        ("// @var: bound=[0,1]", "malformed-value"),
        ("// @var: bound=[0:1e3]", "malformed-value"),
        ("// @var: bound=[inf:1]", "malformed-value"),
        ("// @var: bound", "malformed-value"),
        ("// @var: plot=lines", "malformed-value"),
        ("// @var: role=nature", "malformed-value"),
        ("// @var: def=position", "malformed-value"),
        ("// @var: observe=maybe", "malformed-value"),
        ('// @var: def="open', "malformed-annotation"),
        ("// @var: =3", "malformed-annotation"),
        ("// @const: bound=[0:1]", "wrong-annotation"),
        ("// @safety: penalty=-1", "wrong-annotation"),
        ("// @episode: dt=1", "misplaced-annotation"),
        ("// @choice: role=env", "misplaced-annotation"),
    ],
)
def test_mistakes_above_a_variable_are_named(comment: str, code: str) -> None:
    assert codes_of(variables=f"{comment}\nReal x;") == [code]


@pytest.mark.parametrize(
    ("definition", "code"),
    [
        ("// @var: bound=[0:1]\nReal c;", "wrong-annotation"),
        ("// @var: bound=[0:1]\nBool p <-> true;", "wrong-annotation"),
        ("// @const: bound=[0:1]\nReal f(Real x) = x;", "wrong-annotation"),
        ("// @const: bound=[0:1]\nReal c = 1;", "wrong-annotation"),
        ("// @safety: penalty=-1\nBool p(Real x);", "wrong-annotation"),
        ("// @safety: penalty=-1\nReal f(Real x) = x;", "wrong-annotation"),
        ("// @progress: reward=1\nHP a ::= { x := 1; };", "wrong-annotation"),
        ("// @safety: on_failure=stop\nBool p <-> true;", "malformed-value"),
        ("// @safety: on_failure=truncate:crash\nBool p <-> true;", "malformed-value"),
        ("// @safety: penalty=\nBool p <-> true;", "malformed-value"),
        ("// @safety: penalty=1e3\nBool p <-> true;", "syntax"),
        ("// @safety: shape={x +}\nBool p <-> true;", "syntax"),
        ("Bool p <-> true; // @safety: penalty=-1\nBool q <-> true;", "misplaced-annotation"),
        ("Bool p <-> true;\n// @safety: penalty=-1", "misplaced-annotation"),
        ("Bool p <-> ( /* @safety: penalty=-1 */ true);", "misplaced-annotation"),
    ],
)
def test_mistakes_above_a_definition_are_named(definition: str, code: str) -> None:
    assert codes_of(definition) == [code]


@pytest.mark.parametrize(
    ("comment", "code"),
    [
        ("// @episode: steps=3", "unknown-attribute"),
        ("// @episode: max_steps=0", "malformed-value"),
        ("// @episode: max_steps=1.5", "malformed-value"),
        ("// @episode: dt=0", "malformed-value"),
        ("// @episode: dt=fast", "malformed-value"),
        ("// @episode: duration=min", "malformed-value"),
        ("// @episode: dt=1, dt=2", "repeated-attribute"),
        ("// @episode: max_steps=1, max_episode_steps=2", "repeated-attribute"),
        ("// @episode: dt=1\n// @episode: duration=max", "repeated-annotation"),
        ("// @var: bound=[0:1]", "misplaced-annotation"),
    ],
)
def test_mistakes_above_the_problem_are_named(comment: str, code: str) -> None:
    assert codes_of(above_problem=comment) == [code]


def test_stability_may_stand_above_a_real_function() -> None:
    read = entry("// @stability: shape=-x^2\nReal V(Real x) = x^2;").definitions[0]
    (decoded,) = decode_declaration(read, "definition")
    assert isinstance(decoded, PredicateAnnotation) and decoded.category == "stability"


def test_all_mistakes_of_one_annotation_are_reported() -> None:
    assert codes_of(variables="// @var: bound=[2:1], plot=pie, colour=red\nReal x;") == [
        "malformed-value",
        "malformed-value",
        "unknown-attribute",
    ]
