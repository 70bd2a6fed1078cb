"""From terms to C by way of CasADi: the same bits, no warnings, and derivatives that are derivatives."""

import ctypes
import math
import re
import shutil
import struct
import subprocess
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from differential import compiled, environment_of, same
from generators.random_models import (
    CLOCK,
    CONSTANTS,
    VARIABLES,
    Builder,
    random_model,
    random_state,
    variable,
)
from selection import few_and_many

from dl2c.code import cgen_dir
from dl2c.emit.leaf import Leaves
from dl2c.emit.plan import BuildPlan
from dl2c.emit.simulator.model_c import model_sources
from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.logic import atoms
from dl2c.ir.margins import margin_of
from dl2c.ir.model import TRUE, Call, Div, Flow, Formula, Mul, Number, Symbol, Term
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS
from dl2c.options import Options
from dl2c.pipeline import Compilation
from dl2c.source import Source
from dl2c.symbolic import terms as symbolic
from dl2c.symbolic.tape import function

WAYPOINT = Path(__file__).resolve().parents[2] / "examples" / "waypoint.kyx"
INCLUDES = tuple(f"-I{cgen_dir() / folder}" for folder in ("include", "runtime"))
SYMBOLS = [*map(variable, (*VARIABLES, CLOCK)), *(Symbol(c, "constant") for c in CONSTANTS)]
UNARY: tuple[str, ...] = ("abs", "sqrt", "exp", "sin", "cos", "tan", "arcsin", "arctan", "tanh")
FLOW = Flow(
    (("x", variable("y")), ("y", Mul(variable("z"), variable("u"))), ("z", Number(Fraction(-1, 2)))),
    TRUE,
    TRUE,
    (),
    Fraction(1),
)
"""An ODE whose rates are neither constant nor all different from zero."""


def place(symbol: Symbol) -> str:
    return f"v[{SYMBOLS.index(symbol)}]"


def expressions(count: int) -> tuple[list[Term], list[Formula]]:
    builder = Builder(Random(7))
    terms = [builder.term(3) for _ in range(count)]
    nested: list[Term] = [Call(name, (builder.term(1),)) for name in UNARY for _ in range(4)]
    return terms + nested, [builder.formula(2) for _ in range(count)]


def states(count: int) -> list[list[float]]:
    rng = Random(11)
    drawn = (random_state(rng) for _ in range(count))
    return [[*state.values(), *constants.values()] for state, constants in drawn]


def unit(values: Sequence[str], leaves: Leaves, folder: Path) -> Any:
    """`evaluate(v, out)` of a library whose one file has all leaves, compiled as a model is but at -O2."""
    body = "\n".join(f"  out[{k}] = {value};" for k, value in enumerate(values))
    head = "void evaluate_all(const real *v, real *out);\nvoid evaluate_all(const real *v, real *out)"
    text = "\n".join(['#include "numbers.h"', *leaves.texts, f"{head}\n{{\n{body}\n}}\n"])
    (folder / "leaves.c").write_text(text, encoding="utf-8")
    flags = [{"-O3": "-O2", "-fvisibility=hidden": ""}.get(f, f) for f in CODE_FLAGS]
    command = ["cc", *filter(None, flags), *EXACT_FLAGS, *STRICT_FLAGS, *INCLUDES, "-shared"]
    library = folder / "libleaves.so"
    run([*command, str(folder / "leaves.c"), "-o", str(library), "-lm"])
    evaluate_all = ctypes.CDLL(str(library)).evaluate_all

    def call(state: list[float]) -> list[float]:
        out = (ctypes.c_double * len(values))()
        evaluate_all((ctypes.c_double * len(state))(*state), out)
        return list(out)

    return call


def run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]


def leaves_of(builder: symbolic.Builder) -> Leaves:
    return Leaves(builder, SYMBOLS.index)


def bits(value: float) -> bytes:
    """Both zeros are one value: dL's `min` and CasADi's may choose differently between them."""
    return struct.pack("<d", value + 0.0)


def graph_values(builder: symbolic.Builder, graphs: list[Any], state: list[float]) -> list[float]:
    """CasADi's own evaluation."""
    environment = dict(zip(SYMBOLS, state, strict=True))
    found: list[float] = []
    for order, compute in graphs:
        found.append(float(compute.call([environment[s] for s in order])[0]))
    return found


@pytest.mark.parametrize("count", few_and_many(30, 150))
def test_printed_c_has_the_bits_of_casadi_and_of_the_interpreter(count: int, tmp_path: Path) -> None:
    terms, formulas = expressions(250)
    builder = symbolic.Builder()
    leaves = leaves_of(builder)
    values = [leaves.term(f"term{k}_value", t, "", place) for k, t in enumerate(terms)]
    values += [leaves.condition(f"formula{k}_holds", f, "", place) for k, f in enumerate(formulas)]
    graphs = [function(builder, builder.term(t)) for t in terms]
    graphs += [function(builder, builder.holds(f)) for f in formulas]
    in_c = unit(values, leaves, tmp_path)
    compared = held = 0
    for state in states(count):
        environment = dict(zip(SYMBOLS, state, strict=True))
        got, casadi = in_c(state), graph_values(builder, graphs, state)
        for k, term in enumerate(terms):
            try:
                want = evaluate(term, environment)
            except Undefined:
                continue
            compared += 1
            assert bits(got[k]) == bits(casadi[k]) == bits(float(want)), (term, state)
        for k, formula in enumerate(formulas, len(terms)):
            holds = truth(formula, environment)
            held += holds
            assert got[k] == casadi[k] == holds, (formula, state)
    assert compared > 0.7 * count * len(terms)
    assert 0.2 < held / (count * len(formulas)) < 0.8


@pytest.mark.parametrize("count", few_and_many(12, 60))
def test_lie_derivatives_are_limits_of_differences(count: int, tmp_path: Path) -> None:
    """Between close points on the tangent of the flow, where the differences say something."""
    terms, _ = expressions(150)
    x = variable("x")
    terms += [Call("pow", (Call("abs", (x,)), Number(Fraction(k, 2)))) for k in range(-3, 6)]
    terms += [Call("pow", (Number(Fraction(2)), x)), Div(Call("sin", (x,)), x)]
    leaves = leaves_of(symbolic.Builder())
    values = [leaves.lie(f"lie{k}", t, FLOW, "", place) for k, t in enumerate(terms)]
    in_c = unit(values, leaves, tmp_path)
    agreed = 0
    rng = Random(12)
    for _ in range(count):
        state = [rng.uniform(-4, 4) for _ in SYMBOLS]
        got = in_c(state)
        environment = dict(zip(SYMBOLS, state, strict=True))
        rates = {variable(v): float(evaluate(rate, environment)) for v, rate in FLOW.equations}
        for k, term in enumerate(terms):
            if (wanted := slope(term, environment, rates)) is not None:
                assert got[k] == pytest.approx(wanted, rel=1e-4, abs=1e-4), (term, state)
                agreed += 1
    assert agreed > 2000 / 60 * count


def slope(term: Term, environment: dict[Symbol, float], rates: dict[Symbol, float]) -> float | None:
    """The central difference along `rates`, where both sides agree on it and it is of moderate size."""
    found: list[float] = []
    for steps in ((-1, 0), (0, 1), (-1, 1)):
        ends = [environment | {s: environment[s] + r * k * 1e-6 for s, r in rates.items()} for k in steps]
        try:
            first, last = (float(evaluate(term, end)) for end in ends)
        except Undefined:
            return None
        if max(abs(first), abs(last)) > 1e3:
            return None
        found.append((last - first) / ((steps[1] - steps[0]) * 1e-6))
    left, right, middle = found
    return middle if abs(left - right) <= 1e-5 * (1 + abs(middle)) else None


# Whole models -----------------------------------------------------------------

ENVIRONMENTS = [e for seed in range(200, 240) if (e := environment_of(random_model(seed))) is not None]


@pytest.mark.parametrize("count", few_and_many(4, 20))
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_generated_c_has_no_warnings(count: int, compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    waypoint = Compilation(Source.read(WAYPOINT), Options()).planned.build
    texts: list[str] = []
    for environment in [waypoint, *ENVIRONMENTS[:count]]:
        for name, text in model_sources(environment).items():
            if name.endswith(".h"):
                (tmp_path / name).write_text(text, encoding="utf-8")
            else:
                texts.append(text)
    for k, text in enumerate(texts):
        path = tmp_path / f"model{k}.c"
        path.write_text(text, encoding="utf-8")
        flags = [f for f in CODE_FLAGS if f != "-O3"]
        output = ["-O1", "-DDL2C_NO_TARGET_CLONES", "-c", "-o", str(tmp_path / "model.o")]
        mode = output if k < 4 else ["-fsyntax-only"]
        idle = ["-Wno-unused-function"] if compiler == "clang" else []  # inline ones, of models without flows
        run([compiler, *flags, *EXACT_FLAGS, *STRICT_FLAGS, *idle, *INCLUDES, *mode, str(path)])
    for name in ("model0.c", "Waypoint_rewards.h"):  # in two units
        apart = ["-DDL2C_REWARDS_APART=1", "-fsyntax-only", "-x", "c", str(tmp_path / name)]
        run([compiler, *CODE_FLAGS, *EXACT_FLAGS, *STRICT_FLAGS, *INCLUDES, *apart])


def test_each_rate_and_margin_is_below_its_dl_text() -> None:
    text = "\n".join(text for e in ENVIRONMENTS for text in model_sources(e).values())
    for leaf, about in (("flow0_rate_y", "y' = "), ("flow0_margin0", " 0"), ("flow0_lie0", "d/dt")):
        comments = re.findall(rf"/\*((?:(?!\*/).)*)\*/\nstatic inline real {leaf}\(", text, re.S)
        assert comments and all(about in c for c in comments)


@pytest.fixture(scope="module", params=few_and_many(4, 10))
def libraries(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> list[tuple[BuildPlan, Any]]:
    chosen = [e for e in ENVIRONMENTS if any(f.watches for f in e.flows)][: request.param]
    return list(zip(chosen, compiled(chosen, tmp_path_factory.mktemp("rates")), strict=True))


def test_rates_and_roots_belong_to_the_solution(libraries: list[tuple[BuildPlan, Any]]) -> None:
    """At the start of a flow: rates are c1 of its solution, margins c0 of theirs, Lie derivatives c1."""
    rng = Random(5)
    margins = moving = 0
    for environment, library in libraries:
        for _ in range(40):
            state, constants = random_state(rng)
            values = {Symbol(n, "variable"): v for n, v in state.items()}
            values |= {Symbol(n, "constant"): v for n, v in constants.items()}
            x, p = list(state.values()), list(constants.values())
            for k, flow in enumerate(environment.flows):
                dx = dict(zip(state, library.rates(k, x, p).tolist(), strict=True))
                g, dg = (a.tolist() for a in library.roots(k, x, p))
                for name in state:
                    curve = flow.solution.variables.get(name, (variable(name),))
                    assert close(dx[name], first(curve, values))
                listed = list(atoms(flow.flow.watched))
                assert g[len(listed) :] == [1.0] * (len(g) - len(listed))
                assert dg[len(listed) :] == [0.0] * (len(g) - len(listed))
                for j, atom in enumerate(listed):
                    curve = flow.solution.compose(margin_of(atom))
                    assert curve is not None
                    assert close(g[j], value(margin_of(atom), values), 0.0)
                    assert close(dg[j], first(curve, values))
                    margins, moving = margins + 1, moving + (dg[j] != 0)
    assert moving > 0.5 * margins > 20 * len(libraries)


def first(curve: Sequence[Term], values: dict[Symbol, float]) -> float | None:
    """The derivative of a polynomial motion at its start; None where undefined."""
    return value(curve[1], values) if len(curve) > 1 else 0.0


def value(term: Term, values: dict[Symbol, float]) -> float | None:
    try:
        return float(evaluate(term, values))
    except Undefined:
        return None


def close(got: float, want: float | None, relative: float = 1e-12) -> bool:
    """Whether it is the value; where there is none, anything is."""
    return want is None or same(got, want) or math.isclose(got, want, rel_tol=relative)


def test_margins_are_positive_inside(libraries: list[tuple[BuildPlan, Any]]) -> None:
    rng = Random(6)
    seen = {True: 0, False: 0}
    for environment, library in libraries:
        for _ in range(40):
            state, constants = random_state(rng)
            values = {Symbol(n, "variable"): v for n, v in state.items()}
            values |= {Symbol(n, "constant"): v for n, v in constants.items()}
            for k, flow in enumerate(environment.flows):
                g, _ = library.roots(k, list(state.values()), list(constants.values()))
                for margin, atom in zip(g, atoms(flow.flow.watched), strict=False):
                    if atom.op in ("<", "<=", ">", ">="):
                        inside = margin > 0 if atom.op in ("<", ">") else margin >= 0
                        assert inside == truth(atom, values)
                        seen[bool(inside)] += 1
    assert min(seen.values()) > 15


def test_a_flow_that_does_not_exist_is_refused(libraries: list[tuple[BuildPlan, Any]]) -> None:
    environment, library = libraries[0]
    x, p = np.zeros(library.sizes.nx), np.zeros(library.sizes.np)
    assert library.sizes.nflow == len(environment.flows) > 0
    assert library.sizes.nroot == max(len(list(atoms(f.watched))) for f in environment.model.flows)
    for flow in (-1, library.sizes.nflow):
        for ask in (library.rates, library.roots):
            with pytest.raises(IndexError):
                ask(flow, x, p)
        memory = library.ffi.new("double[]", 16)
        assert library.lib.dl2c_flow_rates(flow, memory, memory, memory) == library.lib.DL2C_ERR_ARG
        assert library.lib.dl2c_flow_roots(flow, memory, memory, memory, memory) == library.lib.DL2C_ERR_ARG
    with pytest.raises(ValueError, match="expected"):
        library.rates(0, x[:-1], p)
