"""The C that exported monitors hold copies of compiles as it stands, without a model."""

import subprocess

from dl2c.code import cgen_dir
from dl2c.native.toolchain import STRICT_FLAGS, find_compiler

FILES = ("arithmetic", "intervals", "functions", "values", "decide", "policy")

PREAMBLE = """
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
typedef double real;
typedef struct { real x; } MODEL_state;
typedef struct { real p; } MODEL_parameters;
typedef struct { real u; } MODEL_input;
typedef struct { int id; real val; } MODEL_verdict;
typedef struct { MODEL_state post; MODEL_verdict wanted, verdict; bool overruled; } MODEL_decision;
typedef MODEL_state MODEL_ctrl(MODEL_state, const MODEL_parameters *, const MODEL_input *);
MODEL_verdict MODEL_check_controller(const MODEL_state *, const MODEL_state *, const MODEL_parameters *);
MODEL_ctrl MODEL_fallback, MODEL_policy_ctrl, MODEL_policy_monitored;
MODEL_state MODEL_monitored_ctrl(MODEL_state, const MODEL_parameters *, const MODEL_input *, MODEL_ctrl *,
                                 MODEL_ctrl *);
bool MODEL_run(MODEL_state, const MODEL_parameters *, const MODEL_input *, const int *, MODEL_state *);
void MODEL_policy_observe(MODEL_state, const MODEL_parameters *, const MODEL_input *, real *);
void MODEL_policy_outputs(const real *, real *);
void MODEL_policy_asks(MODEL_state, const MODEL_parameters *, const MODEL_input *, MODEL_input *, int *);
enum { OBSERVATIONS = 1, OUTPUTS = 4, MADE = 2, CHOICES = 2, ALTERNATIVES = 4, RUNS = 2, POLICY_PATHS = 2 };
static const int START[CHOICES + 1] = {0, 2, 4};
static const int TAKEN[RUNS][CHOICES] = {{0, -1}, {1, 1}}, PATHS[POLICY_PATHS][CHOICES] = {{0, 0}, {1, 1}};
MODEL_decision MODEL_decide(MODEL_state, const MODEL_parameters *, const MODEL_input *, MODEL_ctrl *,
                            MODEL_ctrl *);
#define IV_EPSILON DBL_EPSILON
#define IV_SMALLEST DBL_MIN
#define IV_LARGEST DBL_MAX
#define IV_TINY 1e-100
#define IV_SHORT 67108864.0
#define IV_SHORT_SCALE 64.0
#define IV_EXP_MOST 700
#define IV_ANGLE_MOST 1000000
#define IV_SQRT sqrt
#define IV_LDEXP ldexp
#define IV_FREXP frexp
static const real iv_half_pi[4], iv_log_2[4];
enum { VALUES_MOST = 4, VALUES_HALVINGS = 55 };
#define VALUES_SQRT sqrt
#define VALUES_ABS fabs
"""

CHECK = """
#define STATES const MODEL_state *state, const MODEL_parameters *parameters
#define GIVEN state, parameters
#define USABLE state->x <= 1 && parameters->p <= 1
#define COUNTS margin < least
#define LARGEST 1e100
#define DL2C_SMALLEST DBL_MIN
enum { OUT_OF_RANGE = 1, FIRST = 2, END = 4, CASES = 1 };
static const short firsts[2] = {FIRST, END};
"""

PLAIN = """
MODEL_verdict KIND_check_one(STATES);
MODEL_verdict KIND_check_any(STATES);
static bool KIND_holds(int id, STATES) { return state->x < id + parameters->p; }
static real KIND_margin(int id, STATES) { return id + parameters->p - state->x; }
#include "check.h"
"""

SOUND = """
#include <float.h>
#include <stdbool.h>
typedef double real;
typedef struct { real x; } MODEL_state;
typedef struct { real p; } MODEL_parameters;
typedef struct { int id; bool unknown; } MODEL_verdict;
enum { IV_FALSE, IV_UNKNOWN, IV_TRUE };
"""

SOUND_CHECK = """
MODEL_verdict KIND_check_one(STATES);
MODEL_verdict KIND_check_any(STATES);
static int KIND_truth(int id, STATES) { return state->x < id + parameters->p ? IV_TRUE : IV_UNKNOWN; }
#include "sound_check.h"
"""

HOST = """
enum { LINE = 4, LENGTH = 64 };
#undef MOST
#define MOST LINE
#define STRTOREAL strtod
#define BLANK " "
#define USAGE "none"
static const real *read_state(MODEL_state *state, const real *from) { state->x = *from; return from + 1; }
static const real *read_parameters(MODEL_parameters *p, const real *from) { p->p = *from; return from + 1; }
static const real *read_input(MODEL_input *input, const real *from) { input->u = *from; return from + 1; }
static void print_state(const MODEL_state *state) { printf("%g ", state->x); }
static void print_input(const MODEL_input *input) { printf("%g ", input->u); }
#include "host.h"
static int expected(const char *word) { return word[0] == 'x' ? 1 : -1; }
static void answer(const char *word, const real *from) { printf("%s %g", word, from[0]); }
"""


def compiled(text: str) -> None:
    """Warnings are errors, but that nothing here calls all of it."""
    flags = ("-std=c99", *STRICT_FLAGS, "-Wno-unused-function", f"-I{cgen_dir() / 'monitor'}")
    command = [*find_compiler().command, *flags, "-fsyntax-only", "-x", "c", "-"]
    found = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr


def test_they_compile_under_strict_flags() -> None:
    """Those of monitors of numbers, of policies and of the program for the host."""
    included = "".join(f'#include "{name}.h"\n' for name in FILES)
    compiled(PREAMBLE + included + CHECK + PLAIN + HOST)


def test_the_sound_check_compiles_under_strict_flags() -> None:
    """Its verdict is another type."""
    compiled(SOUND + CHECK + SOUND_CHECK)


def test_all_of_them_are_compiled_here() -> None:
    """A file that is added is added here."""
    there = {path.stem for path in (cgen_dir() / "monitor").glob("*.h")}
    assert there == {*FILES, "check", "sound_check", "host"}
