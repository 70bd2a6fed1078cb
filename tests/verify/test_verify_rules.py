"""What the prover may use of the rest: nothing that restricts or relaxes what an environment does."""

import ast
import re
from pathlib import Path

VERIFY = Path(__file__).resolve().parents[2] / "dl2c" / "verify"
MODULES = sorted(VERIFY.rglob("*.py"))

ALLOWED = {
    *("diagnostics", "inputs", "outputs", "source", "code", "options", "work"),
    *("ir.functions", "ir.logic", "ir.model", "ir.polynomial", "ir.printer", "parse", "parse.tree"),
    *("parse.parser", "parse.printer"),
    *(
        "parse.annotations",
        "resolve.bind",
        "resolve.errors",
        "resolve.expand",
        "resolve.infer",
        "resolve.problem",
    ),
    *("resolve.shape", "resolve.symbols", "resolve.unreadable", "flows.solution", "lower.terms"),
    *("smt.lines", "smt.portfolio", "storage", "native.notes", "ir.arrays"),
}
"""Modules that verify imports. With `storage` and `native.notes` it keeps results; `ir.arrays` gives
numbers from which guesses are made.
"""

TERMS_AND_FORMULAS = {
    *("Add", "And", "Bound", "Call", "Compare", "Div", "FALSE", "Flow", "Formula", "Mul", "Neg", "Number"),
    *("ONE", "Or", "Pow", "Sub", "Symbol", "TRUE", "Term", "Truth", "ZERO"),
}
"""Of `ir.model`: no programs, variables, constants, predicates or models."""

FUNCTIONS_OF = {
    "resolve.problem": {"resolve"},
    "resolve.errors": {"unknown_constants"},
    "lower.terms": {"lower_formula", "lower_term"},
    "flows.solution": {"NotPolynomial", "solve"},
    "resolve.shape": {"conjuncts", "statements", "written_variables"},
}
"""The only names that verify takes from these modules."""

ENVIRONMENTS = {
    *("lead", "prefix", "postcondition", "max_loop", "max_repeat", "watched", "horizons", "cap", "relaxed"),
    *("initial", "admissions", "paths", "slacks", "along", "tolerance", "max_flow", "dt"),
}
"""Attributes of environments, which mean nothing in a theorem."""


def imports(tree: ast.Module) -> list[tuple[str, str]]:
    return [
        (node.module.removeprefix("dl2c."), name.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("dl2c.")
        for name in node.names
    ]


def test_the_prover_knows_nothing_of_environments() -> None:
    wrong: list[str] = []
    for path in MODULES:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for module, name in imports(tree):
            allowed = module in ALLOWED or module.startswith("verify")
            if module == "ir.model":
                allowed = name in TERMS_AND_FORMULAS
            if not allowed or name not in FUNCTIONS_OF.get(module, {name}):
                wrong.append(f"{path.name} imports {name} of {module}")
        used = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
        wrong += [f"{path.name} reads .{name}" for name in sorted(used & ENVIRONMENTS)]
    assert not wrong, "\n".join(wrong)


def test_flows_are_solved_by_their_equations_alone() -> None:
    """A `Flow` is made for `solve`, with neither domain nor horizon."""
    texts = {path.name: path.read_text(encoding="utf-8") for path in MODULES}
    assert {name: n for name, t in texts.items() if (n := len(re.findall(r"\bFlow\(", t)))} == {
        "motion.py": 1
    }
    text = texts["motion.py"]
    assert "Flow(equations, TRUE, TRUE, (), None)" in text


def test_only_given_values_are_taken_from_options() -> None:
    wrong: list[str] = []
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Attribute)
                and isinstance(node.value, ast.Name)
                and node.value.id == "options"
                and node.attr not in ("constants", "entry")
            ):
                wrong.append(f"{path.name}: options.{node.attr}")
    assert not wrong, "\n".join(wrong)
