"""Names and definitions: expansion keeps the meaning, annotated predicates find their arguments."""

from fractions import Fraction

import pytest
from generators.kyx_builder import codes, holds, lowered, model_text, resolved, value
from hypothesis import assume
from hypothesis import strategies as st
from selection import few_and_many_examples

from dl2c.diagnostics import CompileError
from dl2c.ir.printer import print_formula, print_term
from dl2c.parse import tree
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_formula as print_tree
from dl2c.parse.printer import print_term as print_tree_term
from dl2c.resolve.problem import resolve
from dl2c.resolve.symbols import nodes
from dl2c.source import Source

# Expansion --------------------------------------------------------------------

DEFINITIONS = """
  /* @const: bound=[0:9] */
  Real A;
  Real five = 5;
  Real double(Real y) = y + y;
  Real twist(Real y, Real x) = double(x) - y / five;
  Bool positive(Real x) <-> x > 0;
  Bool apart(Real x, Real y) <-> !(positive(x - y) <-> positive(y - x)) | double(x) = y & A >= five();
"""

BODIES = {
    d.name: (tuple(p.name for p in d.parameters or ()), d.body)
    for d in resolved("true -> [v := 1;] v = 1", DEFINITIONS).entry.definitions
    if d.body is not None
}

leaves = st.one_of(
    st.builds(tree.Number, st.fractions(0, 9, max_denominator=4)),
    st.sampled_from(["x", "v", "A", "five"]).map(tree.Variable),
)


def _calls(inner: st.SearchStrategy[tree.Term]) -> st.SearchStrategy[tree.Term]:
    binary = st.sampled_from((tree.Plus, tree.Minus, tree.Times, tree.Divide))
    return st.one_of(
        st.builds(lambda make, a, b: make(a, b), binary, inner, inner),
        inner.map(tree.Neg),
        inner.map(lambda a: tree.FuncOf("double", (a,))),
        st.builds(lambda a, b: tree.FuncOf("twist", (a, b)), inner, inner),
        st.just(tree.FuncOf("five", ())),
    )


terms = st.recursive(leaves, _calls, max_leaves=5)
atoms = st.one_of(
    st.builds(tree.Compare, st.sampled_from(("=", "!=", "<", "<=", ">", ">=")), terms, terms),
    leaves.map(lambda a: tree.PredOf("positive", (a,))),
    st.builds(lambda a, b: tree.PredOf("apart", (a, b)), leaves, leaves),
)
formulas = st.recursive(
    atoms,
    lambda inner: st.one_of(
        inner.map(tree.Not),
        st.builds(
            lambda make, a, b: make(a, b),
            st.sampled_from((tree.And, tree.Or, tree.Imply, tree.Equiv)),
            inner,
            inner,
        ),
    ),
    max_leaves=4,
)
points = st.fixed_dictionaries(dict.fromkeys(("x", "v", "A"), st.fractions(-6, 6, max_denominator=4)))


def expansion(formula: tree.Formula) -> tree.Formula:
    """A state formula after expansion, as the assumption of a problem."""
    (assumption, *_) = resolved(f"({print_tree(formula)}) -> [v := 1;] v = 1", DEFINITIONS).shape.assumptions
    return assumption


@few_and_many_examples(25, 100, formulas)
def test_expansion_removes_all_definitions(formula: tree.Formula) -> None:
    for node in nodes(expansion(formula)):
        assert not isinstance(node, (tree.PredOf, tree.ProgramConst, tree.FuncOf))
        assert not (isinstance(node, tree.Variable) and node.name in BODIES)


@few_and_many_examples(25, 100, formulas, points)
def test_expansion_keeps_the_meaning(formula: tree.Formula, at: dict[str, Fraction]) -> None:
    for wanted in (True, False):
        assert holds(expansion(formula), at, {}, wanted) == holds(formula, at, BODIES, wanted)


@few_and_many_examples(25, 100, terms, points)
def test_expansion_keeps_values(term: tree.Term, at: dict[str, Fraction]) -> None:
    assume(not isinstance(term, tree.Number))
    expanded = expansion(tree.Compare("=", term, tree.Variable("v")))
    assert isinstance(expanded, tree.Compare)
    assert value(expanded.left, at, {}) == value(term, at, BODIES)


def test_expansion_twice_is_expansion_once() -> None:
    problem = "apart(x, v) -> [{{x := twist(v, x);} {?positive(v); ++ v := five;}}*] apart(v, x)"
    once = resolved(problem, DEFINITIONS).expanded
    assert resolved(print_tree(once), "Real A;").expanded == once


IMPLICIT = """
  implicit Real grow(Real t) = {{grow := 1; t := 0;}; {grow' = grow, t' = 1}};
  implicit Real si(Real s), co(Real s) = {{co := 1; si := 0;}; {co' = -si, si' = co}};
  implicit Real th(Real t) = {{th := 0;}; {th' = 1 - th^2}};
  implicit Real at(Real t) = {{at := 0; t := 0;}; {at' = 1/(1 + t^2), t' = 1}};
  implicit Real as(Real u) = {{as := 0; u := 0;}; {as' = 1/sqrt(1 - u^2), u' = 1}};
"""


def test_functions_of_time_are_those_of_the_library_with_the_same_equation() -> None:
    given = resolved("true -> [v := grow(x) + si(x)*co(x) - th(x) + at(x)/as(x);] v = 1", IMPLICIT)
    known = resolved("true -> [v := exp(x) + sin(x)*cos(x) - tanh(x) + arctan(x)/arcsin(x);] v = 1")
    assert given.expanded == known.expanded


@pytest.mark.parametrize(
    ("equations", "solution"),
    [
        ("{f := 3;}; {f' = A}", "3 + A*x"),
        ("{f := 2;}; {f' = -f}", "2*exp((-1)*x)"),
        ("{f := A;}; {f' = 3*f*A/2}", "A*exp((1.5*A)*x)"),
        ("{f := 1; g := A;}; {f' = A*g, g' = -A*f}", "1*cos(A*x) + A*sin(A*x)"),
        ("{f := 1; g := 0;}; {f' = -(g/2), g' = 0.5*f}", "1*cos((-0.5)*x) + 0*sin((-0.5)*x)"),
        ("{f := double(five); g := 0;}; {f' = 0, g' = f}", "5 + 5 + 0*x"),
    ],
)
def test_linear_functions_of_time_are_solved(equations: str, solution: str) -> None:
    problem = "true -> [v := {};] v = 1"
    given = resolved(problem.format("f(x)"), f"{DEFINITIONS} implicit Real f(Real t) = {{{equations}}};")
    assert given.expanded == resolved(problem.format(solution), DEFINITIONS).expanded


@pytest.mark.parametrize(
    "equations",
    [
        "{f := 1; t := 1;}; {f' = f, t' = 1}",
        "{f := 1; t := 0;}; {f' = f, t' = 2}",
        "{f := 1; g := 1;}; {f' = g, g' = f}",
        "{f := 1; g := 1;}; {f' = g, g' = -2*f}",
        "{f := 1; g := f;}; {f' = g, g' = -f}",
        "{f := 1;}; {f' = f^2}",
        "{f := 1; g := 1; h := 1;}; {f' = g, g' = h, h' = f}",
    ],
)
def test_other_functions_of_time_are_refused(equations: str) -> None:
    with pytest.raises(CompileError) as refused:
        resolved("true -> [v := f(x);] v = 1", f"implicit Real f(Real t) = {{{equations}}};")
    assert codes(refused.value) == ["implicit-function"]


def test_the_whole_library_can_be_used() -> None:
    term = "abs(x) + min(x, 1) + max(x, 1) + sqrt(x) + exp(x) + sin(x) + cos(x) + tan(x)"
    term += " + arcsin(x) + arctan(x) + tanh(x) + div(x, 2) + pi + e()"
    for imported in ("import kyx.math.*;", "import kyx.math.{pi, e};"):
        assert lowered(f"x = 0 -> [v := {term};] v = 1", imported)


def test_parameters_shadow_variables_and_constants() -> None:
    expanded = expansion(
        tree.Compare("=", tree.FuncOf("twist", (tree.Variable("x"), tree.Variable("A"))), tree.Variable("v"))
    )
    assert isinstance(expanded, tree.Compare)
    assert print_tree_term(expanded.left) == "A + A - x/5"


def test_programs_expand_where_they_are_called() -> None:
    problem = resolved("true -> [{a; b;}*] x > 0", "HP a ::= { x := 1; }; HP b ::= { a; ++ v := x; };")
    assert print_tree(problem.expanded) == "true -> [{x := 1; {x := 1; ++ v := x;}}*](x > 0)"


def test_a_library_function_gives_way_to_a_definition() -> None:
    assert (
        lowered("true -> [x := abs(v);] x > 0", "Real abs(Real y) = y + 1;").body[0]
        == (lowered("true -> [x := v + 1;] x > 0").body[0])
    )
    assert (
        lowered("true -> [x := abs(v);] x > 0").body
        == lowered("true -> [x := abs(v);] x > 0", "Real abs(Real y);").body
    )


def test_e_and_pi_are_numbers_only_when_imported() -> None:
    imported = lowered("true -> [x := e + pi;] x > 0", "import kyx.math.e; import kyx.math.pi;")
    (assign,) = imported.body
    assert "input" not in repr(assign) and "Symbol" not in repr(assign)
    with pytest.raises(CompileError) as refused:
        resolved("true -> [x := e;] x > 0")
    assert codes(refused.value) == ["undeclared-variable"]
    (own,) = lowered("true -> [x := e;] x > 0", "/* @const: bound=[1:2] */ Real e;").body
    assert "constant" in repr(own)


def test_a_function_without_parameters_and_body_is_a_constant() -> None:
    with_parentheses = lowered("true -> [x := c() + c;] x > 0", "/* @const: bound=[1:2] */ Real c();")
    assert (
        with_parentheses.body
        == lowered("true -> [x := c + c();] x > 0", "/* @const: bound=[1:2] */ Real c;").body
    )


# Arguments of annotated predicates --------------------------------------------


def bound(problem: str, predicate: str = "Bool p(Real y) <-> y >= 1;", more: str = "") -> str:
    """The condition that the annotated predicate stands for."""
    model = lowered(problem, f"{more}\n/* @safety: penalty=-1 */\n{predicate}")
    return print_formula(model.predicates[0].formula)


def test_a_call_in_the_postcondition_binds_first() -> None:
    assert bound("p(v) -> [{x := v;}*@invariant(p(x + v))] (x > 0 & p(2 * x))") == "2 * x >= 1"
    assert bound("p(v) -> [{x := v;}*] x > 0 & <{x := v;}*> p(x)") == "x >= 1"


def test_a_call_in_the_invariant_binds_next() -> None:
    assert bound("p(v) -> [{x := v;}*@invariant(x > 0, p(x + v))] x > 0") == "x + v >= 1"
    assert bound("x > 0 -> [{x := v;}*@invariant(old(x) = x & p(x))] x > 0") == "x >= 1"


def test_a_call_in_the_assumptions_binds_last() -> None:
    assert bound("x > 0 -> p(v) -> [{x := v;}*@invariant(x > 0)] x > 0") == "v >= 1"


def test_calls_inside_other_definitions_count() -> None:
    more = "Bool q(Real a, Real b) <-> p(a - b) | a = b;"
    assert bound("true -> [{x := v;}*] q(v, x)", more=more) == "v - x >= 1"


def test_without_a_call_parameters_are_their_namesakes() -> None:
    assert bound("true -> [{x := v;}*] x > 0", "Bool p(Real v, Real x) <-> v > x;") == "v > x"


def test_arguments_are_expanded() -> None:
    assert bound("true -> [{x := v;}*] p(two * x)", more="Real two = 2;") == "2 * x >= 1"


def test_equal_argument_lists_are_one() -> None:
    assert bound("p(x) -> [{x := v;}*] (p(x) & (v > 0 -> p(x)))") == "x >= 1"


@pytest.mark.parametrize(
    ("problem", "predicate", "code"),
    [
        ("true -> [{x := v;}*] (p(x) & p(v))", "Bool p(Real y) <-> y >= 1;", "ambiguous-arguments"),
        ("true -> [{x := v;}*] x > 0", "Bool p(Real y) <-> y >= 1;", "unbound-parameter"),
        ("true -> [{x := v;}*@invariant(p(x, v))] x > 0", "Bool p(Real y) <-> y >= 1;", "wrong-arity"),
        (
            "true -> [{x := v;}*@invariant(p(old(x)))] x > 0",
            "Bool p(Real y) <-> y >= 1;",
            "undeclared-function",
        ),
        ("true -> [{x := v;}*] p(x)", "Bool p(Real y) <-> <{v := v;}*>v > y;", "modality-in-state"),
    ],
)
def test_predicates_that_stand_for_nothing_are_refused(problem: str, predicate: str, code: str) -> None:
    with pytest.raises(CompileError) as refused:
        bound(problem, predicate)
    assert set(codes(refused.value)) == {code}


def shaped(shape: str, more: str = "") -> str:
    model = lowered(
        "true -> [{x := v;}*] (p(x) & q(v, x))",
        f"{more}\nBool q(Real a, Real x) <-> a < x;\n"
        f"/* @safety: shape={{{shape}}} */\nBool p(Real y) <-> y >= 1 & y <= 9;",
    )
    found = model.predicates[0].shape
    assert found is not None
    return print_term(found)


def test_rewards_see_the_parameters_of_their_predicate() -> None:
    assert shaped("-abs(y - v)") == "-abs(x - v)"
    assert shaped("twice(y)", "Real twice(Real v) = v + v;") == "x + x"


def test_a_predicate_used_as_a_value_is_its_distance() -> None:
    assert shaped("p") == shaped("p(y)") == shaped("y >= 1 & y <= 9") == "min(x - 1, 9 - x)"
    assert shaped("2 * q(1, y)") == "2 * (x - 1)"
    assert shaped("q") == "x - v"


def test_a_function_may_shape_the_reward() -> None:
    definitions = "/* @stability: shape={-V(y)} */\nReal V(Real y) = y^2;"
    model = lowered("true -> [{x := v;}*@invariant(V(x - v) <= 4)] V(x) <= 1", definitions)
    (lyapunov,) = model.predicates
    assert lyapunov.shape is not None
    assert (print_formula(lyapunov.formula), print_term(lyapunov.shape)) == ("true", "-x^2")
    with pytest.raises(CompileError) as refused:
        lowered("true -> [{x := v;}*] V(x) <= 1", definitions.replace("shape", "reward"))
    assert codes(refused.value) == ["attribute-not-on-function"]


# Obligations ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("postcondition", "due"),
    [
        ("v <= 0 -> p(x)", "v <= 0"),
        ("!(v <= 0) | p(x)", "v <= 0"),
        ("p(x) | v > 0", "v <= 0"),
        ("!(v <= 0 & !p(x))", "v <= 0"),
        ("v <= 0 -> (x < 2 -> p(x))", "v <= 0 & x < 2"),
        ("v <= 0 & x < 2 -> p(x)", "v <= 0 & x < 2"),
        ("x < 9 & (v <= 0 -> p(x)) & (v = 5 -> x < 2 & p(x))", "v <= 0 | v = 5"),
        ("v <= 0 <-> p(x)", "v <= 0"),
        ("late(v, x)", "v <= 0"),
        ("p(x)", None),
        ("x < 9 & p(x)", None),
        ("p(x) -> v > 0", None),
        ("x < 9", None),
    ],
)
def test_obligations_are_found_in_the_postcondition(postcondition: str, due: str | None) -> None:
    definitions = (
        "Bool late(Real t, Real y) <-> (t <= 0 -> p(y));\n"
        "/* @progress: on_failure=terminate:failure */\nBool p(Real y) <-> y > 8;"
    )
    model = lowered(f"p(x) -> [{{x := v;}}*] ({postcondition})", definitions)
    found = model.predicates[0].due
    assert (None if found is None else print_formula(found)) == due


def test_old_values_belong_to_invariants() -> None:
    """As in KeYmaera X, also in definitions that only invariants call."""
    definitions = "Bool grows(Real y) <-> y >= old(y);"
    assert lowered("true -> [{x := v;}*@invariant(grows(x), x >= old(x))] x > 0", definitions)
    for problem, code in (
        ("true -> [{x := v;}*] grows(x)", "old-value"),
        ("true -> [{x := old(v);}*] x > 0", "undeclared-function"),
    ):
        with pytest.raises(CompileError) as refused:
            resolved(problem, definitions)
        assert codes(refused.value) == [code]


def test_only_progress_falls_due() -> None:
    definitions = "/* @safety: on_failure=terminate:failure */\nBool p(Real y) <-> y > 8;"
    assert lowered("true -> [{x := v;}*] (v <= 0 -> p(x))", definitions).predicates[0].due is None


def test_the_literal_reading_is_always_due() -> None:
    definitions = "/* @progress: on_failure=terminate:failure */\nBool p(Real y) <-> y > 8;"
    model = lowered("true -> [{x := v;}*] p(x)", definitions, options={"progress_failure": "literal"})
    due = model.predicates[0].due
    assert due is not None and print_formula(due) == "true"


# Shapes -----------------------------------------------------------------------


def test_modalities_in_a_row_are_one_program() -> None:
    two = resolved("x > 0 -> v > 0 -> [{x := 1;}*][v := 2;] x > 0").shape
    one = resolved("x > 0 -> v > 0 -> [{x := 1;}* v := 2;] x > 0").shape
    assert (two.body, two.suffix, two.postcondition) == (one.body, one.suffix, one.postcondition)
    assert len(two.assumptions) == 2


def test_braces_do_not_make_programs_different() -> None:
    problem = "[{{x := 1; v := 2;} {v := 3;}}*] x > 0 & <{x := 1; {v := 2; v := 3;}}*@invariant(x > 0)> v > 2"
    shape = resolved(problem).shape
    assert shape.loop is not None and shape.progress is not None and shape.postcondition is not None


def test_box_and_diamond_may_call_definitions() -> None:
    definitions = "HP a ::= { {b;}* }; HP b ::= { x := v; };"
    assert resolved("true -> [a;] x > 0 & <{x := v;}*> x > 0", definitions).shape.body


def test_a_definition_may_hold_the_whole_problem() -> None:
    shape = resolved(
        "all(x)", "Bool all(Real y) <-> (y > 0 -> [{y1 := 1;}*] y > 0);", "Real x; Real y1;"
    ).shape
    assert len(shape.assumptions) == 1 and shape.loop is not None


def test_an_error_in_one_part_does_not_hide_another() -> None:
    text = model_text(
        "true -> [{x := y; v := *;}*] p(x)", "Real c; Real c;\n/* @var: bound=[0:1] */\nReal d;"
    )
    archive, _ = parse_archive(Source("model.kyx", text))
    with pytest.raises(CompileError) as refused:
        resolve(archive.entries[0])
    assert sorted(codes(refused.value)) == [
        "duplicate-declaration",
        "undeclared-predicate",
        "undeclared-variable",
        "wrong-annotation",
    ]
