"""The only place where identifiers of generated C are made.

A dL name keeps its letters and their case. dL allows `_` only at the end of a name or
before its index, so every name made here that has `_` before a letter is new.
"""

from dl2c.ir.model import Symbol

C_WORDS = frozenset(
    [
        "auto",
        "break",
        "case",
        "char",
        "const",
        "continue",
        "default",
        "do",
        "double",
        "else",
        "enum",
        "extern",
        "float",
        "for",
        "goto",
        "if",
        "inline",
        "int",
        "long",
        "register",
        "restrict",
        "return",
        "short",
        "signed",
        "sizeof",
        "static",
        "struct",
        "switch",
        "typedef",
        "union",
        "unsigned",
        "void",
        "volatile",
        "while",
        "alignas",
        "alignof",
        "bool",
        "true",
        "false",
        "nullptr",
        "constexpr",
        "thread_local",
        "typeof",
        "asm",
        "fortran",
        "linux",
        "unix",
        "real",
        "NULL",
        "abs",
        "acos",
        "asin",
        "atan",
        "atan2",
        "cbrt",
        "ceil",
        "cos",
        "cosh",
        "div",
        "erf",
        "erfc",
        "exp",
        "exp2",
        "expm1",
        "fabs",
        "fdim",
        "floor",
        "fma",
        "fmax",
        "fmin",
        "fmod",
        "frexp",
        "gamma",
        "hypot",
        "ilogb",
        "isfinite",
        "isinf",
        "isnan",
        "isnormal",
        "j0",
        "j1",
        "jn",
        "labs",
        "ldexp",
        "ldiv",
        "lgamma",
        "llabs",
        "llrint",
        "llround",
        "log",
        "log10",
        "log1p",
        "log2",
        "logb",
        "lrint",
        "lround",
        "main",
        "modf",
        "nan",
        "nearbyint",
        "nextafter",
        "pow",
        "remainder",
        "remquo",
        "rint",
        "round",
        "scalbn",
        "signbit",
        "signgam",
        "signgam",
        "sin",
        "sinh",
        "sqrt",
        "tan",
        "tanh",
        "tgamma",
        "trunc",
        "y0",
        "y1",
        "yn",
        "I",
        "errno",
        "stdin",
        "stdout",
        "stderr",
        "DBL_MAX",
        "INFINITY",
        "NAN",
        "EOF",
        "x",
        "p",
        "u",
        "y",
        "NX",
        "NP",
        "NU",
        "NOBS",
        "NINPUT",
        "NENVINPUT",
        "NDECISION",
        "NCHOICE",
        "NENVCHOICE",
        "NSTEPDRAW",
        "NDRAW",
        "NMASK",
        "NPRED",
        "NPATH",
        "NFLOW",
        "NROOT",
        "NPOINT",
        "NFREE",
        "NBOX",
    ]
)
"""Words that C, its library or the runtime already use."""


def local(name: str) -> str:
    """A parameter or local variable."""
    return f"{name}_v" if name in C_WORDS else name


def index(symbol: Symbol) -> str:
    """The enumerator of a symbol's place in its array."""
    return f"{ {'variable': 'X', 'constant': 'P', 'input': 'U'}[symbol.kind] }_{symbol.name}"


def slot(symbol: Symbol, state: str = "x") -> str:
    """Where a symbol's value is kept."""
    array = {"variable": state, "constant": "p", "input": "u"}[symbol.kind]
    return f"{array}[{index(symbol)}]"


def lane(symbol: Symbol) -> str:
    """Where environment i of a batch keeps a symbol's value: rows of one symbol are `stride` apart."""
    return f"{'x' if symbol.kind == 'variable' else 'p'}[{index(symbol)} * stride + i]"


def after(symbol: Symbol) -> str:
    """Where a symbol's value is in the state `y` that a flow leads to."""
    return slot(symbol, "y")


def file_stem(model_name: str) -> str:
    """The base name of a model's generated files: letters, digits and `_`, not starting with a digit."""
    stem = "".join(c if c.isascii() and c.isalnum() else "_" for c in model_name) or "model"
    return f"m{stem}" if stem[0].isdigit() else stem
