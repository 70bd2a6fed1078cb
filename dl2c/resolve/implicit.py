"""Which functions, defined by differential equations, are those of the library.

Comes in: an implicit definition. Goes out: the name of the library function that solves it, or
None. Equations are compared as written, names of variables aside.
"""

from dl2c.parse import tree
from dl2c.parse.parser import parse_term
from dl2c.resolve.symbols import mentioned, nodes

LIBRARY = {
    "exp": (("1", "{f}"),),
    "sin": (("0", "{g}"), ("1", "-{f}")),
    "cos": (("1", "-{g}"), ("0", "{f}")),
    "tanh": (("0", "1 - {f}^2"),),
    "arctan": (("0", "1/(1 + {t}^2)"),),
    "arcsin": (("0", "1/sqrt(1 - {t}^2)"),),
}
"""The value at time 0 and the rate, first of the function `f`, then of another variable `g` it needs."""


def library_function(function: tree.Declaration) -> str | None:
    """The library function that `function`, an implicit definition with one parameter, is."""
    assert function.implicit and function.parameters
    time = function.parameters[0].name
    start = {n.name: n.term for n in nodes(function.body) if isinstance(n, tree.Assign)}
    rates = {n.name: n.term for n in nodes(function.body) if isinstance(n, tree.AtomicODE)}
    if start.pop(time, ZERO) != ZERO or rates.pop(time, ONE) != ONE:
        return None
    names = _needed(function.name, rates)
    if len(names) > max(map(len, LIBRARY.values())):
        return None
    system = tuple((start.get(name), rates[name]) for name in names)
    letters = dict(zip("fg", names, strict=False)) | {"t": time}
    for known, equations in LIBRARY.items():
        if len(equations) == len(names) and system == tuple(
            (parse_term(value), parse_term(rate.format(**letters))) for value, rate in equations
        ):
            return known
    return None


ZERO, ONE = parse_term("0"), parse_term("1")


def _needed(first: str, rates: dict[str, tree.Term]) -> list[str]:
    """The variables that the motion of the first depends on, the first before them."""
    found = {first: None}
    waiting = [first]
    while waiting:
        more = [n for n in mentioned(rates[waiting.pop()]) if n in rates and n not in found]
        found |= dict.fromkeys(more)
        waiting += dict.fromkeys(more)
    return list(found)
