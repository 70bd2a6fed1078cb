"""A program for the host around an exported monitor: reads lines of numbers, prints what they lead to."""

from dl2c.emit import names
from dl2c.emit.cfile import function
from dl2c.emit.monitor_h import Unit, title_of
from dl2c.monitor.check import Check

ABOUT = (
    "Reads lines `KIND state [state] parameters`, numbers in the order of the header, and prints for each "
    "the verdict."
)
CONTROL = (
    " For `fallback state parameters input` it prints the state that this leads to, for `run state "
    "parameters input choices` whether there is one too."
)


POLICY = (
    " For `policy state parameters input` it prints the outputs of its network, and after them the state "
    "that the monitored policy leads to."
)


def main_c(unit: Unit, policy: bool = False) -> str:
    """The whole file; with a policy beside the monitor."""
    model, stem, controller = unit.monitor.model, unit.stem, unit.monitor.controller
    states = [names.member(v.name) for v in model.variables]
    functions = [
        _reading(unit, "state", states),
        _reading(unit, "parameters", [names.member(c.name) for c in unit.parameters]),
    ]
    if controller is not None:
        functions.append(_reading(unit, "input", [unit.field(i.key) for i in controller.inputs]))
        functions.append(_printing(unit, states))
        functions.append(_controlling(unit, len(controller.decisions), policy))
    about = ABOUT + CONTROL * (controller is not None) + POLICY * policy
    includes = ["stdio", "string"]
    return "\n".join(
        [
            title_of(unit),
            f'#include "{stem}_{"policy" if policy else "monitor"}.h"\n',
            *(f"#include <{name}.h>" for name in includes),
            "",
            *functions,
            function("int main(void)", _main(unit), about),
        ]
    )


def _main(unit: Unit) -> list[str]:
    stem = unit.stem
    form, value = ("d %d", "verdict.unknown") if unit.sound else ("d %.17g", "(double)verdict.val")
    both = any(check.transition for check in unit.monitor.checks)
    lines = ["char word[16];", 'while (scanf("%15s", word) == 1) {']
    if unit.monitor.controller is not None:
        lines += ["  if (controls(word))", "    continue;"]
    lines += [f"  {stem}_state one = {{0}}{', two = {0}' * both};"]
    lines += [f"  {stem}_parameters parameters = {{0}};"]
    lines += [f"  {stem}_verdict verdict = {{0}};"]
    for check in unit.monitor.checks:
        lines += [f"  {line}" for line in _asked(stem, check)]
    return [*lines, f'  printf("%{form}\\n", verdict.id, {value});', "}", "return 0;"]


def _asked(stem: str, check: Check) -> list[str]:
    reads = ["read_state(&one)", *(["read_state(&two)"] if check.transition else [])]
    called = f"{stem}_check_{check.kind}({'&one, &two' if check.transition else '&one'}, &parameters)"
    return [
        f'if (strcmp(word, "{check.kind}") == 0) {{',
        f"  if (!({' && '.join([*reads, 'read_parameters(&parameters)'])}))",
        "    return 2;",
        f"  verdict = {called};",
        "}",
    ]


def _controlling(unit: Unit, decisions: int, policy: bool) -> str:
    """A function that answers lines about controllers."""
    stem = unit.stem
    known = ["!run", 'strcmp(word, "fallback") != 0', *(["!policy"] if policy else [])]
    lines = [
        f"{stem}_state state = {{0}}, post = {{0}};",
        f"{stem}_parameters parameters = {{0}};",
        f"{stem}_input input = {{0}};",
        f"int choices[{max(1, decisions)}] = {{0}};",
        'const bool run = strcmp(word, "run") == 0;',
        *(['const bool policy = strcmp(word, "policy") == 0;'] if policy else []),
        f"if ({' && '.join(known)})",
        "  return false;",
        "if (!(read_state(&state) && read_parameters(&parameters) && read_input(&input)))",
        "  return false;",
        "if (run) {",
        *(f"  {line}" for line in _reading_choices(decisions)),
        f'  printf("%d ", {stem}_run(state, &parameters, &input, choices, &post));',
        *(["} else if (policy) {", *(f"  {line}" for line in _policy(unit))] if policy else []),
        "} else {",
        f"  post = {stem}_monitored_ctrl(state, &parameters, &input, 0, 0);",
        "}",
        "print_state(&post);",
        'puts("");',
        "return true;",
    ]
    return function("static bool controls(const char *word)", lines)


def _policy(unit: Unit) -> list[str]:
    stem, upper = unit.stem, unit.stem.upper()
    return [
        f"{unit.real} observation[{upper}_OBSERVATIONS], output[{upper}_OUTPUTS];",
        f"{stem}_policy_observe(state, &parameters, &input, observation);",
        f"{stem}_policy_outputs(observation, output);",
        f"post = {stem}_policy_monitored(state, &parameters, &input);",
        f"for (int k = 0; k < {upper}_OUTPUTS; k++)",
        '  printf("%.17g ", (double)output[k]);',
    ]


def _reading_choices(decisions: int) -> list[str]:
    if decisions == 0:
        return []
    loop = f"for (int k = 0; k < {decisions}; k++)"
    return [loop, '  if (scanf("%d", &choices[k]) != 1)', "    return false;"]


def _printing(unit: Unit, states: list[str]) -> str:
    lines = [f'printf("%.17g ", (double)state->{name});' for name in states]
    return function(f"static void print_state(const {unit.stem}_state *state)", lines)


def _reading(unit: Unit, kind: str, members: list[str]) -> str:
    form = "%f" if unit.single else "%lf"
    lines = [
        line for m in members for line in (f'if (scanf("{form}", &{kind}->{m}) != 1)', "  return false;")
    ]
    return function(f"static bool read_{kind}({unit.stem}_{kind} *{kind})", [*lines, "return true;"])
