"""Jacobians and higher Lie derivatives: against differences, and printed for the flows asked for."""

from fractions import Fraction
from pathlib import Path
from random import Random

import pytest
from differential import environment_of
from generators.random_models import variable
from selection import few_and_many
from symbolic.test_symbolic import FLOW, INCLUDES, SYMBOLS, expressions, leaves_of, place, run, unit

from dl2c.emit.leaf import Leaves
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.ode_c import ORDERS, jacobian_function, lie_function
from dl2c.ir.evaluate import Undefined, evaluate
from dl2c.ir.model import Add, Call, Mul, Number, Pow, Sub, Symbol, Term
from dl2c.lower.problem import lower
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS
from dl2c.options import Options
from dl2c.parse.parser import parse_archive
from dl2c.resolve.problem import resolve
from dl2c.source import Source
from dl2c.symbolic import terms as symbolic

X, Y, Z = (variable(name) for name in "xyz")


def difference(term: Term, by: Symbol, environment: dict[Symbol, float]) -> float | None:
    """The central difference, where the one-sided ones agree with it and it is of moderate size."""
    found: list[float] = []
    for low, high in ((-1, 0), (0, 1), (-1, 1)):
        try:
            ends = [
                float(evaluate(term, environment | {by: environment[by] + k * 1e-6})) for k in (low, high)
            ]
        except Undefined:
            return None
        if max(map(abs, ends)) > 1e3:
            return None
        found.append((ends[1] - ends[0]) / ((high - low) * 1e-6))
    left, right, middle = found
    return middle if abs(left - right) <= 1e-5 * (1 + abs(middle)) else None


@pytest.mark.parametrize("count", few_and_many(8, 40))
def test_partial_derivatives_are_limits_of_differences(count: int, tmp_path: Path) -> None:
    terms, _ = expressions(120)
    leaves = leaves_of(symbolic.Builder())
    asked = [(t, v) for t in terms for v in (X, Y, Z)]
    values = [leaves.partial(f"jac{k}", t, v, "", place) for k, (t, v) in enumerate(asked)]
    in_c = unit([value or "0.0" for value in values], leaves, tmp_path)
    assert 0.2 < values.count(None) / len(values) < 0.9
    rng, agreed = Random(3), 0
    for _ in range(count):
        state = [rng.uniform(-4, 4) for _ in SYMBOLS]
        environment = dict(zip(SYMBOLS, state, strict=True))
        for (term, by), value in zip(asked, in_c(state), strict=True):
            if (wanted := difference(term, by, environment)) is not None:
                assert value == pytest.approx(wanted, rel=1e-4, abs=1e-4), (term, by)
                agreed += 1
    assert agreed > 50 * count


def number(value: int) -> Term:
    return Number(Fraction(value))


def test_higher_lie_derivatives_are_derivatives_of_the_lower_ones(tmp_path: Path) -> None:
    """Each against the difference of the one before, between close points on the tangent of the flow."""
    terms: list[Term] = [
        Sub(Add(Pow(X, 2), Pow(Y, 2)), number(1)),
        Mul(Call("sin", (X,)), Z),
        Call("exp", (Mul(number(-1), Pow(Y, 2)),)),
        Call("sqrt", (Add(number(20), Mul(X, Y)),)),
        Call("abs", (Add(X, Mul(number(2), Y)),)),
        Call("min", (Mul(X, Z), Pow(Y, 3))),
        *expressions(40)[0][:40],
    ]
    leaves = leaves_of(symbolic.Builder())
    values = [leaves.term(f"value{k}", t, "", place) for k, t in enumerate(terms)]
    for order in range(1, ORDERS + 1):
        values += [leaves.lie(f"lie{k}_{order}", t, FLOW, "", place, order) for k, t in enumerate(terms)]
    in_c = unit(values, leaves, tmp_path)
    rng, n = Random(8), len(terms)
    agreed = dict.fromkeys(range(1, ORDERS + 1), 0)
    for _ in range(60):
        state = [rng.uniform(-3, 3) for _ in SYMBOLS]
        environment = dict(zip(SYMBOLS, state, strict=True))
        rates = {variable(v): float(evaluate(rate, environment)) for v, rate in FLOW.equations}
        before, after = (
            in_c([v + sign * 1e-6 * rates.get(s, 0.0) for s, v in environment.items()]) for sign in (-1, 1)
        )
        got = in_c(state)
        for order in agreed:
            for k in range((order - 1) * n, order * n):
                left, right = (got[k] - before[k]) / 1e-6, (after[k] - got[k]) / 1e-6
                if abs(left - right) <= 1e-4 * (1 + abs(left)) and abs(got[k]) < 1e3:
                    assert got[k + n] == pytest.approx((left + right) / 2, rel=1e-3, abs=1e-3), (k % n, order)
                    agreed[order] += 1
    assert all(count > 1000 for count in agreed.values()), agreed


MODEL = """ArchiveEntry "M"
ProgramVariables
  Real x, v, t;
End.
Problem
  x >= 0 & v = 0 & t = 0 -> [{ ?true; {x' = v, v' = 2, t' = 1 & t <= 1 & x >= 0} }*] x >= 0
End.
End.
"""


@pytest.fixture(scope="module")
def environment() -> BuildPlan:
    archive, _ = parse_archive(Source("m.kyx", MODEL))
    found = environment_of(lower(resolve(archive.entries[0]), Options()))
    assert found is not None
    return found


def test_only_entries_that_are_not_zero_are_printed(environment: BuildPlan) -> None:
    text = jacobian_function(environment, leaves_of_model(environment), {0})
    assert [line.strip() for line in text.splitlines() if "= 1.0" in line] == ["jac[X_x * NX + X_v] = 1.0;"]
    assert text.count("jac[X_") == 1
    assert "if (flow" not in jacobian_function(environment, leaves_of_model(environment), ())


def test_generated_functions_compile_without_warnings(environment: BuildPlan, tmp_path: Path) -> None:
    leaves = leaves_of_model(environment)
    functions = [
        jacobian_function(environment, leaves, {0}),
        lie_function(environment, leaves, {0: (Mul(variable("x"), variable("v")), variable("t"))}),
    ]
    head = '#include "numbers.h"\nenum { X_x, X_v, X_t, NX };\nenum { NMARGIN = 2 };\n'
    (tmp_path / "ode.c").write_text(head + "\n".join([*leaves.texts, *functions]), encoding="utf-8")
    run(["cc", *CODE_FLAGS, *EXACT_FLAGS, *STRICT_FLAGS, *INCLUDES, "-fsyntax-only", str(tmp_path / "ode.c")])


def leaves_of_model(environment: BuildPlan) -> Leaves:
    names = [v.name for v in environment.model.variables]
    return Leaves(symbolic.Builder(), lambda symbol: names.index(symbol.name))


def test_lie_derivatives_fill_one_row_for_each_order(environment: BuildPlan) -> None:
    leaves = leaves_of_model(environment)
    text = lie_function(environment, leaves, {0: (variable("x"),)})
    assert "lie[0] = x[X_v];" in text
    assert "lie[1 * NMARGIN + 0] = 2.0;" in text
    assert "lie[2 * NMARGIN + 0] = 0.0;" in text
