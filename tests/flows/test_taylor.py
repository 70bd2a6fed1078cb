"""Taylor models and hulls: they hold the truth, and C and Python compute the same bits."""

import math
import subprocess
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any

import cffi
import mpmath
import pytest

from dl2c.code import cgen_dir
from dl2c.flows import hull, taylor
from dl2c.flows.enclosed import Enclosed, in_doubles
from dl2c.ir.evaluate import Undefined, evaluate
from dl2c.ir.functions import FUNCTIONS
from dl2c.ir.logic import operands
from dl2c.ir.model import Add, Call, Div, Mul, Neg, Number, Pow, Sub, Symbol, Term
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS, find_compiler

X, Y = Symbol("x", "variable"), Symbol("y", "variable")
LIBRARY = tuple(name for name, row in FUNCTIONS.items() if row.arity == 1)
UNARY = ("neg", "square", *LIBRARY)
BINARY = ("add", "sub", "mul", "div", "min", "max", "pow")

precise = mpmath.mp.clone()
precise.dps = 40
PRECISE: dict[str, Callable[..., Any]] = {
    "abs": abs, "min": min, "max": max, "sqrt": precise.sqrt, "exp": precise.exp, "sin": precise.sin,
    "cos": precise.cos, "tan": precise.tan, "arcsin": precise.asin, "arctan": precise.atan,
    "tanh": precise.tanh, "pow": precise.power,
}  # fmt: skip


def truth_of(term: Term, at: dict[Symbol, Any]) -> Any:
    """The value with 40 digits, what does not move as doubles have it; None where there is none."""
    if not symbols_of(term):
        constant = in_doubles(term, {})
        return precise.mpf(constant) if math.isfinite(constant) else None
    match term:
        case Symbol():
            return at[term]
        case Pow(base, exponent):
            below = truth_of(base, at)
            return None if below is None else below**exponent
        case Neg(child):
            below = truth_of(child, at)
            return None if below is None else -below
        case Call(function, args):
            values = [truth_of(a, at) for a in args]
            if None in values or (function == "sqrt" and values[0] < 0):
                return None
            if (function == "arcsin" and abs(values[0]) > 1) or (function == "pow" and values[0] <= 0):
                return None
            return PRECISE[function](*values)
        case Add(left, right) | Sub(left, right) | Mul(left, right) | Div(left, right):
            a, b = truth_of(left, at), truth_of(right, at)
            if a is None or b is None or (isinstance(term, Div) and b == 0):
                return None
            return (
                {Add: a + b, Sub: a - b, Mul: a * b}.get(type(term)) if not isinstance(term, Div) else a / b
            )


def random_term(random: Random, depth: int) -> Term:
    if depth == 0 or random.random() < 0.15:
        return random.choice((X, Y, X, Number(Fraction(random.uniform(-3, 3)))))
    inner = random_term(random, depth - 1)
    match random.randrange(8):
        case 0:
            return Neg(inner)
        case 1:
            return Pow(inner, random.randint(1, 5))
        case 2:
            return Call(random.choice(LIBRARY), (inner,))
        case 3:
            return Call(random.choice(("min", "max", "pow")), (inner, random_term(random, depth - 1)))
        case _:
            kind = random.choice((Add, Sub, Mul, Div))
            return kind(inner, random_term(random, depth - 1))


def random_curve(random: Random) -> list[float]:
    degree = random.choice((1, 2, 5, 12))
    scale = 10 ** random.uniform(-2, 1)
    return [random.uniform(-3, 3), *(random.uniform(-1, 1) * scale / k for k in range(1, degree + 1))]


def horner(c: list[float], s: Any) -> Any:
    value = c[-1]
    for a in reversed(c[:-1]):
        value = value * s + a
    return value


def check(random: Random) -> bool:
    """Whether a random term's model, which must hold its values, says something."""
    curves = {X: random_curve(random), Y: random_curve(random)}
    half = 2.0 ** -random.randint(1, 30)
    middle = half * random.randrange(1, int(1 / half), 2)
    ends = {s: horner(c, 1.0) for s, c in curves.items()}
    models = {s: taylor.of_polynomial(c, ends[s], middle, half) for s, c in curves.items()}
    term = random_term(random, random.randint(1, 4))
    model = Enclosed(taylor.FUNCTIONS, taylor.number, models, {}, lambda t: bool(symbols_of(t))).term(term)
    for _ in range(6):
        s = random.choice((middle - half, middle, middle + half, middle + half * random.uniform(-1, 1)))
        u = (s - middle) / half
        state = {x: horner(c, s) for x, c in curves.items()}
        exact = truth_of(term, {x: horner(c, precise.mpf(s)) for x, c in curves.items()})
        try:
            rounded = precise.mpf(evaluate(term, state))
        except Undefined:
            rounded = None
        for value in (exact, rounded):
            if value is None:
                continue
            assert not model.lacks & taylor.LACKS_VALUE or exact is None, term
            if abs(value) < 1e290:
                at = sum(precise.mpf(c) * precise.mpf(u) ** k for k, c in enumerate(model.c))
                assert not abs(value - at) > model.r, (term, curves, middle, half, s)
                assert not value < model.hull[0] and not value > model.hull[1], (
                    term,
                    curves,
                    middle,
                    half,
                    s,
                )
    return model.r < 1e300


def symbols_of(term: Term) -> list[Symbol]:
    return [term] if isinstance(term, Symbol) else [s for t in operands(term) for s in symbols_of(t)]


def test_models_hold_what_terms_are_along_a_stretch() -> None:
    random = Random(5)
    assert sum(check(random) for _ in range(1500)) > 300


@pytest.mark.slow
def test_models_hold_what_many_terms_are() -> None:
    random = Random(7)
    assert sum(check(random) for _ in range(100_000)) > 20_000


# C and Python


SOURCE = """
#define DL2C_API
#include "functions.h"
#pragma GCC visibility push(default)
static dl2c_taylor read(const double *a)
{
  dl2c_taylor t = {.r = a[5], .e = a[6], .hull = {a[7], a[8]}, .lacks = (int32_t)a[9]};
  for (int i = 0; i < 5; i++) t.c[i] = a[i];
  return t;
}
static void write(const dl2c_taylor *t, double *a)
{
  for (int i = 0; i < 5; i++) a[i] = t->c[i];
  a[5] = t->r, a[6] = t->e, a[7] = t->hull.low, a[8] = t->hull.high, a[9] = t->lacks;
}
void of(double *b, int degree, double end, double middle, double half, double *out)
{
  dl2c_taylor t = dl2c_taylor_of(b, degree, end, middle, half);
  write(&t, out);
}
void with_number(int which, const double *a, double b, double *out)
{
  dl2c_taylor s = read(a);
  dl2c_taylor t = which == 0 ? dl2c_taylor_plus(&s, b) : which == 1 ? dl2c_taylor_plus(&s, -b)
                  : which == 2 ? dl2c_taylor_from(b, &s) : dl2c_taylor_times(&s, b);
  write(&t, out);
}
int sign(const double *a) { dl2c_taylor t = read(a); return dl2c_taylor_sign(&t); }
"""


@pytest.fixture(scope="session")
def native(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """taylor.h as a library."""
    folder: Path = tmp_path_factory.mktemp("taylor")
    text = SOURCE
    declared = (
        "void of(double *, int, double, double, double, double *); int sign(double *);"
        "void with_number(int, const double *, double, double *);"
    )
    for name in UNARY:
        head = f"void unary_{name}(double *a, double *out)"
        text += f"{head} {{ dl2c_taylor t = read(a); t = dl2c_taylor_{name}(&t); write(&t, out); }}\n"
        declared += f"{head};"
    for name in BINARY:
        head = f"void binary_{name}(double *a, double *b, double *out)"
        body = f"dl2c_taylor s = read(a), t = read(b); t = dl2c_taylor_{name}(&s, &t); write(&t, out);"
        text += f"{head} {{ {body} }}\n"
        declared += f"{head};"
    (folder / "taylor.c").write_text(text, encoding="utf-8")
    target = folder / "libtaylor.so"
    flags = [*CODE_FLAGS, *EXACT_FLAGS, *STRICT_FLAGS, "-O2", "-shared", "-fPIC"]
    command = [*find_compiler().command, *flags, f"-I{cgen_dir() / 'runtime'}"]
    subprocess.run([*command, "-o", str(target), str(folder / "taylor.c"), "-lm"], check=True)
    ffi = cffi.FFI()
    ffi.cdef(declared)
    return ffi, ffi.dlopen(str(target))


def as_row(t: taylor.Taylor) -> list[float]:
    return [*t.c, t.r, t.e, *t.hull, float(t.lacks)]


def test_c_and_python_compute_the_same_models(native: Any) -> None:
    ffi, lib = native
    random = Random(11)
    for _ in range(400):
        models: list[taylor.Taylor] = []
        for _ in range(2):
            c = random_curve(random)
            half = 2.0 ** -random.randint(1, 20)
            middle = half * random.randrange(1, int(1 / half), 2)
            models.append(taylor.of_polynomial(c, horner(c, 1.0), middle, half))
            out = ffi.new("double[10]")
            lib.of(ffi.new("double[]", c), len(c) - 1, horner(c, 1.0), middle, half, out)
            assert repr(list(out)) == repr(as_row(models[-1]))
        first, second = models
        results = [taylor.FUNCTIONS[name](first) for name in UNARY]
        calls = [(f"unary_{name}", (first,)) for name in UNARY]
        results += [taylor.FUNCTIONS[name](first, second) for name in BINARY]
        calls += [(f"binary_{name}", (first, second)) for name in BINARY]
        for (name, args), made in zip(calls, results, strict=True):
            out = ffi.new("double[10]")
            getattr(lib, name)(*(ffi.new("double[]", as_row(a)) for a in args), out)
            assert [x == y or (x != x and y != y) for x, y in zip(out, as_row(made), strict=True)] == [
                True
            ] * 10, name
            assert lib.sign(out) == taylor.sign(made)


def test_sums_and_products_with_numbers_have_the_bits_of_those_of_models(native: Any) -> None:
    ffi, lib = native
    random = Random(12)
    for _ in range(400):
        c = random_curve(random)
        a = taylor.of_polynomial(c, horner(c, 1.0), 0.25, 0.25)
        value = random.choice((0.0, 1.0, -3.0, random.gauss(0, 10), 1e300, math.inf, math.nan))
        b = taylor.number(value)
        results = (taylor.add(a, b), taylor.sub(a, b), taylor.sub(b, a), taylor.mul(a, b), taylor.mul(b, a))
        for which, made in zip((0, 1, 2, 3, 3), results, strict=True):
            out = ffi.new("double[10]")
            lib.with_number(which, ffi.new("double[]", as_row(a)), value, out)
            pairs = zip(out, as_row(made), strict=True)
            assert all(x == y or not (math.isfinite(x) or math.isfinite(y)) for x, y in pairs), (which, value)


def test_hulls_know_where_nothing_has_a_value() -> None:
    assert all(math.isnan(end) for end in hull.sqrt((-2.0, -1.0)))
    assert taylor.FUNCTIONS["sqrt"](taylor.number(-1.0)).lacks & taylor.LACKS_VALUE
    assert taylor.power(taylor.number(-1.0), taylor.number(0.5)).lacks & taylor.LACKS_VALUE
    assert not taylor.FUNCTIONS["sqrt"](taylor.of_polynomial([0.0, 1.0], 1.0, 0.5, 0.5)).lacks
