"""All files of an exported monitor, and how to integrate it."""

import json
import textwrap
from typing import Any

from dl2c.emit.monitor.host_c import main_c
from dl2c.emit.monitor.monitor_c import monitor_c
from dl2c.emit.monitor.monitor_h import MEANING, Unit, head, monitor_h, roundings_of
from dl2c.emit.monitor.policy_c import policy_files
from dl2c.emit.monitor.sound_monitor_c import sound_monitor_c
from dl2c.ir.printer import print_formula
from dl2c.monitor.check import OUT_OF_RANGE, Case, Check, Condition
from dl2c.policy.network import NetworkPolicy
from dl2c.source import NOWHERE, text_hash
from dl2c.version import __version__


def monitor_files(unit: Unit, policy: NetworkPolicy | None = None) -> dict[str, str]:
    """The files of a monitor by name, with a policy whose interface is the model's. Raises `CompileError`
    for a policy that does not fit into C.
    """
    files = {} if policy is None else policy_files(unit, policy)
    files |= {"main.c": main_c(unit, policy is not None), "README.md": _readme(unit, policy)}
    files |= {"conditions.json": conditions_json(unit)}
    return files | monitor_sources(unit)


def monitor_sources(unit: Unit) -> dict[str, str]:
    """The monitor itself: what a target and a simulator that is monitored compile alike."""
    return {
        f"{unit.stem}_monitor.h": monitor_h(unit),
        f"{unit.stem}_monitor.c": sound_monitor_c(unit) if unit.sound else monitor_c(unit),
    }


def conditions_json(unit: Unit) -> str:
    """Each condition as data: what it stands for, where, and how it is evaluated."""
    places = [c.span for _, _, c in unit.monitor.conditions if c.span != NOWHERE]
    content = {
        "model": unit.monitor.model.name,
        "sha256": text_hash(places[0].source.text) if places else None,
        "dl2c_version": __version__,
        "prefix": unit.stem,
        "real": unit.real,
        "sound": unit.sound,
        "largest": float(unit.largest),
        "tolerance": {
            "relative": float(unit.monitor.tolerance.relative),
            "absolute": {name: float(v) for name, v in unit.monitor.tolerance.absolute.items()},
        },
        "conditions": [
            {"id": OUT_OF_RANGE, "check": None, "case": None, "text": "a number is out of range"},
            *(_as_data(unit, check, case, c) for check, case, c in unit.monitor.conditions),
        ],
    }
    return json.dumps(content, indent=1) + "\n"


def _as_data(unit: Unit, check: Check, case: Case, condition: Condition) -> dict[str, Any]:
    """`evaluated` is over the state before, and `x_post` for that after. Of a check, the conditions with one
    `case_number` are joined by "and", cases by "or". `roundings` is what the header calls N, if it is sound.
    """
    span = condition.span
    place = None
    if span != NOWHERE:
        end = span.source.position(span.end)
        place = {"line": span.line, "column": span.column, "end_line": end[0], "end_column": end[1]}
    return {
        "id": condition.number,
        "check": check.kind,
        "case": case.about,
        "case_number": check.cases.index(case),
        "text": condition.about,
        "source": place and span.text,
        "span": place,
        "evaluated": print_formula(condition.formula),
        "roundings": roundings_of(unit, condition),
        "same_as": condition.first if condition.first != condition.number else None,
    }


def _readme(unit: Unit, policy: NetworkPolicy | None) -> str:
    model, stem = unit.monitor.model, unit.stem
    kinds = "\n".join(_kind(unit, check) for check in unit.monitor.checks)
    sources = f"{stem}_monitor.c" + (f" {stem}_policy.c" if policy is not None else "")
    parts = ["monitor", *(["policy"] if policy is not None else [])]
    listed = ", ".join(f"`{stem}_{part}.{kind}`" for part in parts for kind in "hc")
    complete = f"{listed} are complete: C99, no allocation, no state, no recursion, only loops whose bounds "
    complete += "are numbers; of the C library only `<math.h>`, `<float.h>` and `<stdbool.h>`. Numbers are "
    complete = "\n".join(textwrap.wrap(f"{complete}`{unit.real}`.", 100, break_on_hyphens=False))
    control = _control(unit, policy) if unit.monitor.controller is not None else ""
    return f"""# Monitor of {model.name}

{complete}

    cc -std=c99 -O2 -ffp-contract=off -c {sources}

Never compile it with `-ffast-math` or `-Ofast`.

{kinds}

`id` 0 is the verdict "satisfied"; any other is the number of a condition, listed at the end of the
header with its line in the model. NaN, infinities and numbers out of range are never satisfied.
{_precision(unit)}
{control}
On the host, `main.c` reads one check per line and prints verdicts:

    cc -std=c99 -O2 -ffp-contract=off main.c {sources} -lm -o monitor
"""


def _control(unit: Unit, policy: NetworkPolicy | None) -> str:
    """How to put a controller under the monitor."""
    stem = unit.stem
    ctrl = "ctrl" if policy is None else f"{stem}_policy_ctrl"
    own = "a function of yours" if policy is None else "the trained policy"
    text = f"`{ctrl}` is {own}. What it does is done if the controller's check accepts it. Otherwise, and "
    text += "where a number is NaN, the fallback given is executed, or where that is 0 "
    text += f"`{stem}_fallback`: the first alternative of the model that is possible, one marked `@fallback` "
    text += "before others; where none is, which no state of the model is in, the first all the same. Then "
    text += "let the plant move for one step of the model. Names and arguments are those of the C that "
    text += f"KeYmaera X exports, with `{stem}_` before them."
    explained = "\n".join(textwrap.wrap(text, 100, break_on_hyphens=False))
    return f"""
## A controller under the monitor

Once in every step, with what was measured in `curr`, `params` and `input`:

    curr = {stem}_monitored_ctrl(curr, &params, &input, {ctrl}, 0);

{explained}
"""


def _kind(unit: Unit, check: Check) -> str:
    return f"- `{head(unit, check).split('(')[0].split()[-1]}`: {MEANING[check.kind]}"


def _precision(unit: Unit) -> str:
    tolerance = unit.monitor.tolerance
    relative = f"{float(tolerance.relative):g}"
    close = (
        "Values that are copied must be equal; those that are computed may be off, by as much as the header "
    )
    close += "says of each condition, in the condition's own unit: "
    close += (
        f"`{relative} * (1 + |value|)` for assignments, `{relative} * (1 + the magnitudes of all summands)` "
    )
    close += "for solutions of flows, for domains at their end and for equalities of chosen values."
    if tolerance.absolute:
        given = ", ".join(f"{name} by {float(value):g}" for name, value in tolerance.absolute.items())
        close += f" Instead of that, {given}."
    proved = (
        "Every verdict is proved: intervals are rounded outward, and what they do not decide is `unknown`."
    )
    rounded = "Conditions are evaluated with rounding: close to its boundary one may be judged wrongly."
    return "\n".join([*textwrap.wrap(f"{close} {proved if unit.sound else rounded}", 100), ""])
