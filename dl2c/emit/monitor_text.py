"""All files of an exported monitor, and how to integrate it."""

import textwrap

from dl2c.emit.host_c import main_c
from dl2c.emit.monitor_c import monitor_c
from dl2c.emit.monitor_h import MEANING, Unit, head, monitor_h
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


def _readme(unit: Unit) -> str:
    model, stem = unit.monitor.model, unit.stem
    kinds = "\n".join(_kind(unit, check) for check in unit.monitor.checks)
    return f"""# Monitor of {model.name}

`{stem}_monitor.h` and `{stem}_monitor.c` are complete: C99, no allocation, no state, no recursion, no
loops; of the C library only `<math.h>`, `<float.h>` and `<stdbool.h>`. Numbers are `{unit.real}`.

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
