"""A program for the host around an exported monitor: reads lines of numbers, prints what they lead to."""

from collections.abc import Sequence

from dl2c.emit import names
from dl2c.emit.cfile import function
from dl2c.emit.monitor.copied import copied
from dl2c.emit.monitor.monitor_h import Unit, title_of
from dl2c.monitor.check import Check

POLICY = ("policy", "asks")
"""Lines about a policy: what is done under the monitor, and what it asks for."""


def main_c(unit: Unit, policy: bool = False) -> str:
    """The whole file; with a policy beside the monitor."""
    model, stem, controller = unit.monitor.model, unit.stem, unit.monitor.controller
    states = [names.member(v.name) for v in model.variables]
    parameters = [names.member(c.name) for c in unit.parameters]
    inputs = [unit.field(i.key) for i in controller.inputs] if controller is not None else []
    taken = [unit.measured(d) for d in controller.measured] if controller is not None else []
    functions = [_reading(unit, "state", states), _reading(unit, "parameters", parameters)]
    sizes = {"state": len(states), "parameters": len(parameters), "input": len(inputs) + len(taken)}
    lines = {c.kind: ["state"] * (1 + c.transition) + ["parameters"] for c in unit.monitor.checks}
    choices = 0
    if controller is not None:
        choices = len(controller.decisions)
        functions += [_reading(unit, "input", inputs, taken), _printing(unit, "state", states)]
        functions += [_printing(unit, "input", inputs)] if policy else []
        sizes_of_policy = {"OBSERVATIONS": "OBSERVATIONS", "OUTPUTS": "OUTPUTS", "MADE": "CHOICES"}
        words = {word: f"{stem.upper()}_{size}" for word, size in sizes_of_policy.items()}
        words |= {"MODEL": stem, "CHOICES": str(choices)}
        functions.append(copied("host.h", ("controls", *(["acts"] if policy else [])), words))
        answered = ["fallback", "run", *(POLICY if policy else ())]
        lines |= {kind: ["state", "parameters", "input"] for kind in answered}
    counts = {k: sum(sizes[p] for p in parts) + choices * (k == "run") for k, parts in lines.items()}
    listed = {"state": states, "parameters": parameters, "input": inputs + taken}
    usage = [_line(kind, parts, listed, choices * (kind == "run")) for kind, parts in lines.items()]
    return "\n".join(
        [
            title_of(unit),
            f'#include "{stem}_{"policy" if policy else "monitor"}.h"\n',
            *(f"#include <{name}.h>" for name in ("stdio", "stdlib", "string")),
            f"\ntypedef {unit.real} real;\n",
            f"enum {{ MOST = {max(1, *counts.values())}, LENGTH = 64 * (MOST + 1) }};\n",
            f"#define STRTOREAL {'strtof' if unit.single else 'strtod'}",
            '#define BLANK " \\t\\r\\n"',
            "#define USAGE \\\n" + " \\\n".join(f'  "  {text}\\n"' for text in usage) + "\n",
            copied("host.h", ("numbers_of", "refuse")),
            *functions,
            function("static int expected(const char *word)", _expected(counts)),
            function("static void answer(const char *word, const real *from)", _answer(unit, policy)),
            copied("host.h", ("main",)),
        ]
    )


def _line(kind: str, parts: list[str], listed: dict[str, list[str]], choices: int) -> str:
    """The form of a line: the word and what its numbers are."""
    named: list[str] = []
    for k, part in enumerate(parts):
        after = "'" if part == "state" and k else ""
        named += [f"{name}{after}" for name in listed[part]]
    return " ".join([kind, *named, *(f"choice_{k}" for k in range(choices))])


def _expected(counts: dict[str, int]) -> list[str]:
    tests = [(f'if (strcmp(word, "{kind}") == 0)', f"  return {count};") for kind, count in counts.items()]
    return [*(line for pair in tests for line in pair), "return -1;"]


def _answer(unit: Unit, policy: bool) -> list[str]:
    stem = unit.stem
    form, value = ("d %d", "verdict.unknown") if unit.sound else ("d %.17g", "(double)verdict.val")
    both = any(check.transition for check in unit.monitor.checks)
    lines: list[str] = []
    if unit.monitor.controller is not None:
        asked = "controls(word, from)" + " || acts(word, from)" * policy
        lines += [f"if ({asked})", "  return;"]
    lines += [f"{stem}_state one{', two' * both};"]
    lines += [f"{stem}_parameters parameters;"]
    lines += [f"{stem}_verdict verdict = {{0, 0}};"]
    for check in unit.monitor.checks:
        lines += _asked(stem, check)
    return [*lines, f'printf("%{form}\\n", verdict.id, {value});']


def _asked(stem: str, check: Check) -> list[str]:
    reads = ["from = read_state(&one, from);"]
    reads += ["from = read_state(&two, from);"] if check.transition else []
    called = f"{stem}_check_{check.kind}({'&one, &two' if check.transition else '&one'}, &parameters)"
    return [
        f'if (strcmp(word, "{check.kind}") == 0) {{',
        *(f"  {line}" for line in reads),
        "  (void)read_parameters(&parameters, from);",
        f"  verdict = {called};",
        "}",
    ]


def _printing(unit: Unit, kind: str, members: list[str]) -> str:
    lines = [f'printf("%.17g ", (double){kind}->{name});' for name in members]
    return function(f"static void print_{kind}(const {unit.stem}_{kind} *{kind})", lines)


def _reading(unit: Unit, kind: str, members: list[str], whole: Sequence[str] = ()) -> str:
    """A function that takes the numbers of a struct, those that are `whole` at its end, and returns what
    follows them.
    """
    lines = [f"{kind}->{name} = *from++;" for name in members]
    lines += [f"{kind}->{name} = (int)*from++;" for name in whole]
    lines = lines or [f"{kind}->none = 0;"]
    signature = f"static const real *read_{kind}({unit.stem}_{kind} *{kind}, const real *from)"
    return function(signature, [*lines, "return from;"])
