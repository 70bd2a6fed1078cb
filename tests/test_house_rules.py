"""What a reader of the project may rely on: its layers, sizes and names. See ARCHITECTURE.md."""

import ast
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

LAYERS = (
    *(
        "version",
        "code",
        "interruption",
        "inputs",
        "outputs",
        "storage",
        "source",
        "diagnostics",
        "work",
        "options",
        "configuration",
        "progress",
    ),
    *("ir", "parse", "resolve", "quantifiers", "flows", "lower", "interval", "paths", "interp"),
    *("smt", "sampling", "symbolic", "monitor", "policy", "emit"),
    *("native", "verify", "policy_proof", "pipeline", "picture", "env", "training", "ray"),
    *("lint", "report", "lsp", "play", "commands", "cli", "experiments", "__main__"),
)
"""Everything in dl2c, in the order of the way through. A layer imports only what stands before it."""

OWNERS = {
    "lark": "parse",
    "z3": "smt",
    "cvc5": "smt",
    "flint": "verify",
    "casadi": "symbolic",
    "cffi": "native",
    "pygls": "lsp",
    "lsprotocol": "lsp",
}
"""Libraries that one layer alone may import."""

EXTRAS = {
    *("matplotlib", "stable_baselines3", "sb3_contrib", "torch", "ray", "pyarrow", "yaml", "onnx"),
    *("pygame", "imageio_ffmpeg", "pygls", "lsprotocol"),
}
EXTRAS_ARE_NEEDED = {
    *("env/sb3.py", "report/callback.py"),
    *("lsp/serve.py", "lsp/server.py", "lsp/answers.py", "lsp/convert.py"),
    *(
        "training/learning.py",
        "training/callbacks.py",
        "training/activations.py",
        "training/standardised.py",
        "training/teaching.py",
        "training/ppo/heads.py",
        "training/ppo/networks.py",
        "training/ppo/update.py",
    ),
}
"""Optional libraries, and the modules that are of no use without them: others import these lazily."""

FORBIDDEN_NAMES = {"utils", "helpers", "common", "misc", "base", "core", "manager"}

FORBIDDEN_WORDS = {"fleet", "convoy", "sail", "roam", "recruit", "blink", "room", "abreast"}
"""Words that the glossary of ARCHITECTURE.md replaces, in names and sentences of Python and C."""

ONE_CLASS = {"Problem", "Environment", "Target", "Options", "Manifest", "Source"}
"""Names that one class alone may have, and no alias of a type."""

MAX_MODULES = 20
MAX_FILE = 400
MAX_FUNCTION = 40
MAX_MATCH = 120
MAX_C_FUNCTION = 80
MAX_EXAMPLE = 120

PYTHON = sorted((ROOT / "dl2c").rglob("*.py"))
LICENCE = "/* SPDX-License-Identifier: MIT-0 */\n"
"""The first line of all C: the runtime becomes part of what users build."""

C = sorted(path for path in (ROOT / "cgen").rglob("*.[ch]"))
OTHER = sorted(path for folder in ("tests", "examples") for path in (ROOT / folder).rglob("*.py"))

Function = ast.FunctionDef | ast.AsyncFunctionDef


def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def layer(dotted: str) -> str:
    """`dl2c.ir.model` is in layer `ir`; the package itself is in none."""
    return (*dotted.split("."), "")[1]


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module="dl2c", names=names):
                yield from (f"dl2c.{alias.name}" for alias in names)
            case ast.ImportFrom(module=str(name)):
                yield name
            case _:
                pass


def imported_at_once(tree: ast.Module) -> Iterator[str]:
    """What importing the module imports: nothing in functions or under `if TYPE_CHECKING`."""
    for statement in tree.body:
        guarded = isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.unparse(statement.test)
        if not guarded and not isinstance(statement, Function | ast.ClassDef):
            yield from imported(statement)


def without_docstring(node: Function) -> tuple[list[ast.stmt], int]:
    """The body of a function without its docstring, and how many lines the docstring has."""
    if ast.get_docstring(node, clean=False) is None:
        return node.body, 0
    first = node.body[0]
    return node.body[1:], (first.end_lineno or 0) - first.lineno + 1


def too_long(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, Function):
            body, docstring = without_docstring(node)
            limit = MAX_MATCH if len(body) == 1 and isinstance(body[0], ast.Match) else MAX_FUNCTION
            length = (node.end_lineno or 0) - node.lineno + 1 - docstring
            if length > limit:
                yield f"{node.lineno} {node.name} has {length} lines"


def declares_only(path: Path) -> bool:
    """Whether a module is a table: data types and constants, functions of three lines at most."""
    return path.suffix == ".py" and all(
        len(without_docstring(node)[0]) <= 3 for node in ast.walk(parsed(path)) if isinstance(node, Function)
    )


def test_layers_name_every_module() -> None:
    there = {path.relative_to(ROOT / "dl2c").parts[0].removesuffix(".py") for path in PYTHON}
    assert there <= {*LAYERS, "__init__"}


def test_imports_point_backwards() -> None:
    wrong: list[str] = []
    for path in PYTHON:
        here = layer(module_of(path))
        for name in imported(parsed(path)):
            there = layer(name) if name.startswith("dl2c.") else ""
            if here and there in LAYERS and LAYERS.index(there) > LAYERS.index(here):
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong, "\n".join(wrong)


def test_each_solver_has_one_door() -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in PYTHON
        for name in imported(parsed(path))
        if OWNERS.get(name.split(".")[0], here := layer(module_of(path))) != here
    ]
    assert not wrong, "\n".join(wrong)


def test_extras_are_imported_where_they_are_used() -> None:
    wrong = [
        f"{path.relative_to(ROOT)} imports {name} at once"
        for path in PYTHON
        for name in imported_at_once(parsed(path))
        if name.split(".")[0] in EXTRAS
        and path.relative_to(ROOT / "dl2c").as_posix() not in EXTRAS_ARE_NEEDED
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("module", ["dl2c", "dl2c.cli"])
def test_import_is_light(module: str) -> None:
    slow = EXTRAS | {"casadi", "z3", "scipy"}
    code = f"import sys, {module}; print(*sorted({slow!r} & set(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stdout.split()) == (0, []), result.stderr


def test_files_fit() -> None:
    sizes = {p: len(p.read_text(encoding="utf-8").splitlines()) for p in (*PYTHON, *C, *OTHER)}
    wrong = [
        f"{path.relative_to(ROOT)} has {size} lines"
        for path, size in sizes.items()
        if size > (MAX_EXAMPLE if path.is_relative_to(ROOT / "examples") else MAX_FILE)
        and not declares_only(path)
    ]
    assert not wrong, "\n".join(wrong)


def test_functions_fit() -> None:
    wrong = [f"{p.relative_to(ROOT)}:{line}" for p in (*PYTHON, *OTHER) for line in too_long(parsed(p))]
    assert not wrong, "\n".join(wrong)


def test_c_functions_fit() -> None:
    wrong: list[str] = []
    for path in C:
        lines = path.read_text(encoding="utf-8").splitlines()
        braces = [number for number, line in enumerate(lines) if re.match(r"[{}]$", line)]
        wrong += [
            f"{path.relative_to(ROOT)}:{start + 1} is a function of {end - start - 1} lines"
            for start, end in pairwise(braces)
            if lines[start] == "{" and end - start - 1 > MAX_C_FUNCTION
        ]
    assert not wrong, "\n".join(wrong)


def test_names_say_what_is_inside() -> None:
    paths = [*PYTHON, *C, *OTHER]
    assert not [
        p for p in paths if FORBIDDEN_NAMES & {part.partition(".")[0] for part in p.relative_to(ROOT).parts}
    ]


def test_words_are_those_of_the_glossary() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{number} says {word}"
        for path in (*PYTHON, *C)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for word in re.findall(r"[a-z]+", line.lower())
        if word in FORBIDDEN_WORDS or word.removesuffix("s") in FORBIDDEN_WORDS
    ]
    assert not wrong, "\n".join(wrong)


def test_one_class_has_each_name() -> None:
    found = Counter(
        node.name if isinstance(node, ast.ClassDef) else ast.unparse(node.target)
        for path in PYTHON
        for node in parsed(path).body
        if isinstance(node, ast.ClassDef | ast.AnnAssign)
    )
    assert not [name for name in ONE_CLASS if found[name] > 1]


def test_folders_fit() -> None:
    counts = Counter(path.parent for path in PYTHON)
    assert not [folder for folder, count in counts.items() if count > MAX_MODULES]


def test_files_of_tests_have_names_of_their_own() -> None:
    """As pytest asks of folders that are no packages."""
    counts = Counter(path.name for path in (ROOT / "tests").rglob("test_*.py"))
    assert not [name for name, count in counts.items() if count > 1]


def test_nothing_imports_in_a_circle() -> None:
    """Neither modules, nor layers; imports inside functions count too."""
    modules = {module_of(path): path for path in PYTHON}
    graph = {name: set(imports_of(path, modules)) for name, path in modules.items()}
    layers: dict[str, set[str]] = {}
    for name, others in graph.items():
        layers.setdefault(layer(name), set()).update(layer(o) for o in others if layer(o) != layer(name))
    for edges in (graph, {name: others - {""} for name, others in layers.items() if name}):
        list(TopologicalSorter(edges).static_order())  # raises CycleError


def imports_of(path: Path, modules: Mapping[str, Path]) -> Iterator[str]:
    """The modules that a module imports, wherever in it; a name from a package may be a module of it."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                if (found := full if full in modules else node.module) in modules:
                    yield found


def test_modules_say_what_they_do() -> None:
    assert not [p for p in PYTHON if p.read_text(encoding="utf-8") and not ast.get_docstring(parsed(p))]


def test_nothing_names_a_machine() -> None:
    """No path of the machine that something was written on."""
    pattern = re.compile(r"(?<![\w.])/(work|home|root|Users)/\w")
    assert not [p for p in (*PYTHON, *C) if pattern.search(p.read_text(encoding="utf-8"))]


def test_rules_see_what_they_look_for() -> None:
    tree = ast.parse("import z3\nif TYPE_CHECKING:\n    import torch\ndef f():\n    from dl2c import cli\n")
    assert set(imported(tree)) == {"z3", "torch", "dl2c.cli"}
    assert list(imported_at_once(tree)) == ["z3"]
    lines = ["def f(x):", '    """Doc."""', *["    x += 1"] * MAX_FUNCTION]
    assert list(too_long(ast.parse("\n".join(lines)))) == ["1 f has 41 lines"]
    assert list(too_long(ast.parse("\n".join(lines[:-1])))) == []


def test_c_files_say_under_which_licence_they_are() -> None:
    generated = sorted((ROOT / "tests" / "golden" / "c").glob("*.c"))
    assert generated
    assert not [p for p in (*C, *generated) if not p.read_text(encoding="utf-8").startswith(LICENCE)]
