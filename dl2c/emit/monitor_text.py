"""What comes with an exported monitor: a program for the host, and how to integrate it."""

import textwrap

from dl2c.emit import names
from dl2c.emit.cfile import function
from dl2c.emit.monitor_c import monitor_c
from dl2c.emit.monitor_h import MEANING, Unit, head, monitor_h, title_of
from dl2c.emit.sound_monitor_c import sound_monitor_c
from dl2c.monitor.check import Check


def monitor_files(unit: Unit) -> dict[str, str]:
    """The files of a monitor by name."""
    return {
        f"{unit.stem}_monitor.h": monitor_h(unit),
        f"{unit.stem}_monitor.c": sound_monitor_c(unit) if unit.sound else monitor_c(unit),
        "main.c": main_c(unit),
        "README.md": _readme(unit),
    }


def main_c(unit: Unit) -> str:
    """A program that reads checks with their numbers and prints verdicts."""
    model, stem = unit.monitor.model, unit.stem
    states = [f"&state->{names.member(v.name)}" for v in model.variables]
    parameters = [f"&parameters->{names.member(c.name)}" for c in unit.parameters]
    form = "d %d" if unit.sound else "d %.17g"
    value = "verdict.unknown" if unit.sound else "(double)verdict.val"
    main = ["char word[16];", 'while (scanf("%15s", word) == 1) {']
    both = any(check.transition for check in unit.monitor.checks)
    main += [f"  {stem}_state one = {{0}}{', two = {0}' * both};"]
    main += [f"  {stem}_parameters parameters = {{0}};"]
    main += [f"  {stem}_verdict verdict = {{0}};"]
    for check in unit.monitor.checks:
        reads = ["read_state(&one)", *(["read_state(&two)"] if check.transition else [])]
        called = f"{stem}_check_{check.kind}({'&one, &two' if check.transition else '&one'}, &parameters)"
        main += [
            f'  if (strcmp(word, "{check.kind}") == 0) {{',
            f"    if (!({' && '.join([*reads, 'read_parameters(&parameters)'])}))",
            "      return 2;",
            f"    verdict = {called};",
            "  }",
        ]
    main += [f'  printf("%{form}\\n", verdict.id, {value});', "}", "return 0;"]
    return "\n".join(
        [
            title_of(unit),
            f'#include "{stem}_monitor.h"\n',
            "#include <stdio.h>\n#include <string.h>\n",
            _reading(unit, "state", states),
            _reading(unit, "parameters", parameters),
            function(
                "int main(void)",
                main,
                "Reads lines `KIND state [state] parameters`, numbers in the order of the header, and prints "
                "for each the verdict.",
            ),
        ]
    )


def _reading(unit: Unit, kind: str, places: list[str]) -> str:
    form = "%f" if unit.single else "%lf"
    lines = [f'if (scanf("{form}", {p}) != 1)\n    return false;' for p in places]
    return function(
        f"static bool read_{kind}({unit.stem}_{kind} *{kind})",
        [line for text in lines for line in text.split("\n  ")] + ["return true;"],
    )


def _readme(unit: Unit) -> str:
    model, stem = unit.monitor.model, unit.stem
    kinds = "\n".join(_kind(unit, check) for check in unit.monitor.checks)
    return f"""# Monitor of {model.name}

`{stem}_monitor.h` and `{stem}_monitor.c` are complete: C99, no allocation, no state, no recursion,
loops of constant length; of the C library only `<math.h>`, `<float.h>` and `<stdbool.h>`. Numbers are
`{unit.real}`.

    cc -std=c99 -O2 -ffp-contract=off -c {stem}_monitor.c

Never compile it with `-ffast-math` or `-Ofast`.

{kinds}

`id` 0 is the verdict "satisfied"; any other is the number of a condition, listed at the end of the
header with its line in the model. NaN, infinities and numbers out of range are never satisfied.
{_precision(unit)}
On the host, `main.c` reads one check per line and prints verdicts:

    cc -std=c99 -O2 -ffp-contract=off main.c {stem}_monitor.c -lm -o monitor
"""


def _kind(unit: Unit, check: Check) -> str:
    return f"- `{head(unit, check).split('(')[0].split()[-1]}`: {MEANING[check.kind]}"


def _precision(unit: Unit) -> str:
    tolerance = unit.monitor.tolerance
    within = [f"`{float(tolerance.relative):g} * (1 + |value|)`"]
    within += [f"for {name} {float(value):g}" for name, value in tolerance.absolute.items()]
    close = f"Computed values must be met within {', '.join(within)}; values that are copied, exactly."
    proved = (
        "Every verdict is proved: intervals are rounded outward, and what they do not decide is `unknown`."
    )
    rounded = "Conditions are evaluated with rounding: close to its boundary one may be judged wrongly."
    return "\n".join([*textwrap.wrap(f"{close} {proved if unit.sound else rounded}", 100), ""])
