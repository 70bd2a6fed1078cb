"""Twenty slips, as they are typed into a model: what is there, what is typed instead, and what is said."""

from typing import NamedTuple

MODEL = """/* A tank: the level is measured, and a pump keeps it between two limits – "éèπ😀". */
ArchiveEntry "Tank"

Definitions
  /* @const: bound=[0.1:0.5], unit="s", def="longest time between two decisions" */
  Real ep;
  Real limit = 10;
  Real after(Real x, Real f) = x + f * ep;

  /* @safety: penalty=-10, on_failure=terminate:failure */
  Bool inside(Real x) <-> (0 <= x & x <= limit);

  HP ctrl ::= {
    /* @choice: name="pump" */
    { f := *; ?-1 <= f & f <= 1; ?inside(after(x, f)); ++ ?x > 0; f := 0; }
  };

  HP fill ::= { {x' = f, t' = 1 & t <= ep & x >= 0} };
End.

ProgramVariables
  /* @var: bound=[0:10], unit="m", plot=line, def="level" */
  Real x;
  /* @var: bound=[-1:1], unit="m/s" */
  Real f;
  Real t;
End.

/* @episode: max_steps=200 */
Problem
  inside(x) & ep > 0 -> [{ ctrl; t := 0; fill; }*@invariant(inside(x))] inside(x)
End.

End.
"""


class Slip(NamedTuple):
    """`typed` comes key by key in place of `there`, which stands once in the model."""

    there: str
    typed: str
    code: str


SLIPS = (
    Slip("f := 0;", "g := 0;", "undeclared-names"),
    Slip("f := 0;", "f = 0;", "syntax"),
    Slip("f := 0;", "f := ;", "syntax"),
    Slip("f := 0; }", "f := 0;", "never-closed"),
    Slip("x + f * ep;", "x + f ** ep;", "syntax"),
    Slip("x + f * ep;", "x + f * eps;", "undeclared-variable"),
    Slip("after(x, f)", "after(x)", "wrong-arity"),
    Slip("after(x, f)", "aftr(x, f)", "undeclared-function"),
    Slip("?x > 0;", "?x > ;", "syntax"),
    Slip("?x > 0;", "?x;", "wrong-sort"),
    Slip("t := 0; fill;", "t := 0; fil;", "undefined-program"),
    Slip("t := 0; fill;", "ep := 0; fill;", "constant-written"),
    Slip("Real limit = 10;", "Real limit = limit;", "recursive-definition"),
    Slip("Real t;", "Real t, t;", "duplicate-declaration"),
    Slip("plot=line", "plot=lines", "malformed-value"),
    Slip("bound=[-1:1]", "bound=[1:-1]", "malformed-value"),
    Slip("penalty=-10", "penalti=-10", "unknown-attribute"),
    Slip("max_steps=200", "max_step=200", "unknown-attribute"),
    Slip("/* @var: bound=[0:10]", "/* @vra: bound=[0:10]", "unknown-annotation"),
    Slip('def="level" */', 'def="level" ', "malformed-value"),
)
