"""roots.h as a library, with a model whose formulas are rows of a small table."""

import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cffi

from dl2c.ir.roots import MAX_DEGREE, Crossing, Exit
from dl2c.native.code import cgen_dir
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS

Atom = tuple[int, str]
"""A margin and what it must be: `>=`, `>`, `=` or `!=` zero."""

FORMULAS: tuple[tuple[tuple[Atom, ...], ...], ...] = (
    (((0, ">="),),),
    (((0, ">"),),),
    (((0, "!="),),),
    (((0, "="),),),
    (((0, ">="), (1, ">=")),),
    (((0, ">="), (1, ">"), (2, "!=")),),
    (((0, ">="),), ((1, ">="),)),
    (((0, ">"),), ((1, ">"), (2, ">="))),
    (((0, ">="), (1, "!=")), ((2, ">"),), ((0, "="), (1, ">"))),
)
"""Disjunctions of conjunctions of atoms over three margins."""

MARGINS = 3

DECLARATIONS = """
void curve_of(const double *c, int degree, double length, dl2c_curve *out);
double curve_at(const dl2c_curve *curve, double s);
int sign_after(const dl2c_curve *curve);
int crossings(const dl2c_curve *curves, int n, const int8_t *start, dl2c_crossing *out, int room);
int first_exit(int formula, const dl2c_crossing *crossings, int count, int n, const int8_t *at0,
               const int8_t *start, int8_t *sign_at, int8_t *sign_after, double *at);
double nanoseconds(const dl2c_curve *curves, int n, const int8_t *start, int rounds);
"""

TYPES = f"""
typedef struct dl2c_curve {{ int32_t degree; double noise; double b[{MAX_DEGREE + 1}]; }} dl2c_curve;
typedef struct dl2c_crossing {{ double at; int32_t margin; int8_t after; }} dl2c_crossing;
"""


MEANING: dict[str, Callable[[int], bool]] = {
    ">=": lambda s: s >= 0,
    ">": lambda s: s > 0,
    "=": lambda s: s == 0,
    "!=": lambda s: s != 0,
}


def holds(formula: int, sign: Sequence[int]) -> bool:
    """What the compiled `model_condition` must say."""
    return any(all(MEANING[op](sign[m]) for m, op in row) for row in FORMULAS[formula])


def _case(formula: int) -> str:
    rows = (
        " && ".join(f"sign[{m}] {'==' if op == '=' else op} 0" for m, op in row) for row in FORMULAS[formula]
    )
    return f"case {formula}: return {' || '.join(f'({row})' for row in rows)};"


SOURCE = r"""
#define _POSIX_C_SOURCE 199309L
#include <time.h>
#include "flow_exact.h"
#include "numbers.h"
static inline bool model_condition(int flow, int formula, const int8_t *sign)
{
  (void)flow;
  switch (formula) {
    CASES
    default: return false;
  }
}
#include "roots.h"
DECLARATIONS
void curve_of(const double *c, int degree, double length, dl2c_curve *out)
{
  dl2c_curve_of(c, degree, length, out);
}
double curve_at(const dl2c_curve *curve, double s) { return dl2c_curve_at(curve, s); }
int sign_after(const dl2c_curve *curve) { return dl2c_sign_after(curve); }
int crossings(const dl2c_curve *curves, int n, const int8_t *start, dl2c_crossing *out, int room)
{
  return dl2c_crossings(curves, n, start, out, room);
}
int first_exit(int formula, const dl2c_crossing *crossings, int count, int n, const int8_t *at0,
               const int8_t *start, int8_t *sign_at, int8_t *sign_after, double *at)
{
  const dl2c_exit leave =
      dl2c_first_exit(0, formula, crossings, count, n, at0, start, sign_at, sign_after);
  *at = leave.at;
  return leave.found + 2 * leave.holds;
}
double nanoseconds(const dl2c_curve *curves, int n, const int8_t *start, int rounds)
{
  struct timespec before;
  struct timespec after;
  dl2c_crossing out[64];
  volatile int found = 0;
  double best = (double)INFINITY;
  for (int r = 0; r < rounds; r++) {
    clock_gettime(CLOCK_MONOTONIC, &before);
    for (int k = 0; k < n; k++) found = dl2c_crossings(&curves[k], 1, &start[k], out, 64);
    clock_gettime(CLOCK_MONOTONIC, &after);
    const double seconds = (double)(after.tv_sec - before.tv_sec);
    best = fmin(best, seconds * 1e9 + (double)(after.tv_nsec - before.tv_nsec));
  }
  (void)found;
  return best / n;
}
"""


def source() -> str:
    cases = "\n    ".join(_case(k) for k in range(len(FORMULAS)))
    return SOURCE.replace("CASES", cases).replace("DECLARATIONS", DECLARATIONS)


def compile_roots(directory: Path, compiler: Sequence[str]) -> Path:
    """The library, compiled as models are, with every warning an error."""
    code, library = directory / "roots.c", directory / "libroots.so"
    code.write_text(source(), encoding="utf-8")
    flags = (*CODE_FLAGS, *EXACT_FLAGS, *STRICT_FLAGS, "-fvisibility=default", f"-I{cgen_dir() / 'runtime'}")
    command = (*compiler, *flags, "-shared", str(code), "-o", str(library), "-lm")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return library


class NativeRoots:
    """The functions of roots.h on the types of dl2c/ir/roots.py."""

    def __init__(self, library: Path) -> None:
        self.ffi: Any = cffi.FFI()
        self.ffi.cdef(TYPES + DECLARATIONS)
        self.lib: Any = self.ffi.dlopen(str(library))

    def curve_of(self, c: Sequence[float], length: float) -> list[float]:
        out = self.ffi.new("dl2c_curve *")
        self.lib.curve_of(c, len(c) - 1, length, out)
        return list(out.b[0 : len(c)])

    def curve_at(self, curve: Sequence[float], s: float) -> float:
        return self.lib.curve_at(self.curves([curve]), s)

    def sign_after(self, curve: Sequence[float]) -> int:
        return self.lib.sign_after(self.curves([curve]))

    def curves(self, curves: Sequence[Sequence[float]]) -> Any:
        return self.ffi.new("dl2c_curve[]", [{"degree": len(b) - 1, "b": list(b)} for b in curves])

    def crossings(
        self, curves: Sequence[Sequence[float]], start: Sequence[int], room: int = 512
    ) -> list[Crossing] | None:
        """None where they do not fit."""
        out = self.ffi.new("dl2c_crossing[]", max(1, room))
        count = self.lib.crossings(self.curves(curves), len(curves), start, out, room)
        return None if count < 0 else [Crossing(c.at, c.margin, c.after) for c in out[0:count]]

    def first_exit(
        self, formula: int, crossed: Sequence[Crossing], at0: Sequence[int], start: Sequence[int]
    ) -> Exit:
        n = len(at0)
        rows = self.ffi.new("dl2c_crossing[]", [(float(c.at), c.margin, c.after) for c in crossed])
        at, on, beyond = self.ffi.new("double *"), self.ffi.new("int8_t[]", n), self.ffi.new("int8_t[]", n)
        flags = self.lib.first_exit(formula, rows, len(crossed), n, at0, start, on, beyond, at)
        return Exit(bool(flags & 1), bool(flags & 2), at[0], tuple(on), tuple(beyond))

    def nanoseconds(self, curves: Sequence[Sequence[float]], start: Sequence[int], rounds: int) -> float:
        """Per curve, in the best of some rounds."""
        return self.lib.nanoseconds(self.curves(curves), len(curves), start, rounds)
