"""The only place where identifiers of generated C and Python are made.

A dL name keeps its letters and their case. dL allows `_` only at the end of a name or
before its index, so every name made here that has `_` before a letter is new.
"""

import keyword
import re
from collections.abc import Collection
from functools import cache

from dl2c.code import cgen_dir
from dl2c.ir.model import Symbol

C_WORDS = frozenset(
    [
        *("alignas", "alignof", "asm", "auto", "bool", "break", "case", "char", "const", "constexpr"),
        *("continue", "default", "do", "double", "else", "enum", "extern", "false", "float", "for"),
        *("fortran", "goto", "if", "inline", "int", "long", "nullptr", "register", "restrict", "return"),
        *("short", "signed", "sizeof", "static", "struct", "switch", "thread_local", "true", "typedef"),
        *("typeof", "union", "unsigned", "void", "volatile", "while"),
        *("abs", "acos", "asin", "assert", "atan", "atan2", "cbrt", "ceil", "cos", "cosh", "div", "erf"),
        *("erfc", "exp", "exp2", "expm1", "fabs", "fdim", "floor", "fma", "fmax", "fmin", "fmod", "frexp"),
        *("gamma", "hypot", "ilogb", "isfinite", "isinf", "isnan", "isnormal", "j0", "j1", "jn", "labs"),
        *("ldexp", "ldiv", "lgamma", "llabs", "llrint", "llround", "log", "log10", "log1p", "log2"),
        *("logb", "lrint", "lround", "main", "modf", "nan", "nearbyint", "nextafter", "pow", "remainder"),
        *("remquo", "rint", "round", "scalbn", "signbit", "signgam", "sin", "sinh", "sqrt", "tan", "tanh"),
        *("tgamma", "trunc", "y0", "y1", "yn"),
        *("BUFSIZ", "DBL_MAX", "EOF", "I", "INFINITY", "NAN", "NULL", "errno", "linux", "stderr", "stdin"),
        *("stdout", "unix"),
        *("NBLOCK", "NBOX", "NCHART", "NCHOICE", "NCONSTANT", "NCRITICAL", "NDECISION", "NDRAW"),
        *("NENVCHOICE", "NENVINPUT", "NFACT", "NFIXED", "NFLOW", "NFREE", "NFROZEN", "NINPUT"),
        *("NMARGIN", "NMASK", "NOBS", "NP", "NPATH", "NPOINT", "NPRED", "NPROJECTION", "NROOT"),
        *("NSTEPDRAW", "NU", "NVARYING", "NWATCH", "NX"),
        *("p", "real", "u", "x", "y"),
    ]
)
"""Words that C, its library or the runtime already use."""

ERROR_NUMBER = re.compile(r"E[A-Z0-9]")
"""C keeps such names for errno.h."""


def local(name: str) -> str:
    """A parameter or local variable."""
    return f"{name}_v" if name in C_WORDS or ERROR_NUMBER.match(name) else name


PARAMETERS = frozenset(
    [
        *("bounded", "c", "defined", "duration", "end", "first", "flow", "g", "inside", "k", "margin"),
        *("met", "moves", "reach", "tau", "there", "watch", "z"),
    ]
)
"""Names of functions beside which they have locals that are called like variables of the model."""

NUMBERED = re.compile(r"(doubt|exit|hit|left|until)\d+")
"""The same, with numbers."""


def beside(name: str) -> str:
    """A local variable of a function that has names of its own."""
    return f"{name}_v" if name in PARAMETERS or NUMBERED.fullmatch(name) else local(name)


def stem(wanted: str, taken: Collection[str]) -> str:
    """What numbered names begin with, so that none of them is taken."""
    while any(re.fullmatch(rf"{wanted}\d+", name) for name in taken):
        wanted += wanted[-1]
    return wanted


def member(name: str) -> str:
    """A member of a structure: names of the runtime's arrays are free there."""
    return name if name in ("p", "u", "x", "y") else local(name)


def index(symbol: Symbol) -> str:
    """The enumerator of a symbol's place in its array."""
    return f"{ {'variable': 'X', 'constant': 'P', 'input': 'U', 'start': 'S'}[symbol.kind] }_{symbol.name}"


def slot(symbol: Symbol, state: str = "x") -> str:
    """Where a symbol's value is kept."""
    array = {"variable": state, "constant": "p", "input": "u", "start": "p"}[symbol.kind]
    return f"{array}[{index(symbol)}]"


def lane(symbol: Symbol) -> str:
    """Where environment i of a batch keeps a symbol's value: from row to row it is `stride`."""
    return f"{'x' if symbol.kind == 'variable' else 'p'}[{index(symbol)} * stride + i]"


def after(symbol: Symbol) -> str:
    """Where a symbol's value is in the state `y` that a flow leads to."""
    return slot(symbol, "y")


LONGEST_STEM = 60


@cache
def runtime_headers() -> frozenset[str]:
    """Headers of the runtime, which a model's own header must not hide."""
    folders = (cgen_dir() / folder for folder in ("include", "runtime"))
    return frozenset(path.stem for folder in folders for path in folder.glob("*.h"))


def file_stem(model_name: str) -> str:
    """The base name of a model's generated files: letters, digits and `_`, not starting with a digit."""
    stem = "".join(c if c.isascii() and c.isalnum() else "_" for c in model_name[:LONGEST_STEM]) or "model"
    if stem.lower() in runtime_headers():
        stem = f"{stem}_model"
    return f"m{stem}" if stem[0].isdigit() else stem


def python_attribute(name: str) -> str:
    """What a variable or constant is called in generated Python."""
    return f"{name}_v" if keyword.iskeyword(name) else name


def python_value(symbol: Symbol) -> str:
    """Where generated Python finds a value: in the state `s`; inputs and time are local variables."""
    return symbol.name if symbol.kind in ("input", "time") else f"s.{python_attribute(symbol.name)}"


def python_predicate(name: str, what: str = "holds") -> str:
    """The function of a predicate: no dL name has `_` before a letter."""
    return f"{what}_{name}"
