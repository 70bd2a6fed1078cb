"""How the speed of a batch depends on the size of the model: a family of models that grow in every way.

A model of size k has k vehicles on a line. Its agent chooses which of them accelerates, or none, so there are
3 k + 1 variables, k guarded alternatives and one more, and k conditions of safety.
"""

from collections.abc import Callable

from dl2c.experiments.bench.measure import measure
from dl2c.experiments.bench.rows import Row, batch_row, subject
from dl2c.source import Source

SIZES = (1, 2, 4, 8)
"""Vehicles of the models that are measured: all can be built within seconds."""

TOGETHER = 1024
"""Environments that are stepped together."""


def size_growth(seconds: float, note: Callable[[str], None]) -> dict[int, float]:
    """How many times longer an environment step takes than in the smallest model, by number of variables."""
    rows: list[Row] = []
    for k in SIZES:
        note(f"building a model of size {k}")
        what = subject(vehicles(k), {})
        variables = len(what.library.manifest.variables)
        row = batch_row(what, TOGETHER)
        rows.append(Row(str(variables), f"model of {variables} variables", row.n, row.run))
    results = measure(rows, seconds, note=note, baseline=rows[0].key)
    return {int(r.key): 1 / r.ratio for r in results}


def vehicles(k: int) -> Source:
    """The model of size k."""
    every = range(1, k + 1)
    declared = "\n".join(
        f"/* @var: bound=[-1:1] */\nReal x{i};\n/* @var: bound=[-1:1] */\nReal v{i};\nReal a{i};"
        for i in every
    )
    still = " ".join(f"a{i} := 0;" for i in every)
    chosen = " ++ ".join(f"?v{i} <= 0; a{i} := 1;" for i in every)
    motion = ", ".join(f"x{i}' = v{i}, v{i}' = a{i}" for i in every)
    near = " & ".join(f"x{i} <= 10" for i in every)
    return Source(
        f"{k} vehicles",
        f"""ArchiveEntry "Vehicles {k}"
ProgramVariables
{declared}
Real t;
End.
/* @safety: penalty=-1, on_failure=terminate:failure */
Problem
{near} -> [{{ {still} {{ {chosen} ++ ?true; }} t := 0; {{{motion}, t' = 1 & t <= 0.1}} }}*]({near})
End.
End.
""",
    )
