"""A trained policy as C beside an exported monitor: observation, network, action, and the monitor around it.

What the policy asks for goes through `<model>_run`, so that values become admissible as in the environment.
"""

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction

import numpy as np

from dl2c.diagnostics import CompileError, error
from dl2c.emit.cexpr import MATH
from dl2c.emit.cfile import comment, function, table, wrapped
from dl2c.emit.leaf import Leaves
from dl2c.emit.monitor.control_c import reading
from dl2c.emit.monitor.copied import copied, copied_body, one_line
from dl2c.emit.monitor.monitor_c import RUNTIME, builder_of, grouped, order_of
from dl2c.emit.monitor.monitor_h import AFTER, BEFORE, Unit, title_of, wrapped_head
from dl2c.emit.monitor.network_c import network_functions
from dl2c.emit.monitor.own_names import with_own_names
from dl2c.ir.model import TRUE, Model, Term
from dl2c.monitor.check import Controller
from dl2c.monitor.control import leading_drafts
from dl2c.paths.enumerate import Draft
from dl2c.paths.path import END
from dl2c.policy.network import LARGEST_FLOAT, NetworkPolicy

ABOUT = {
    "observe": "What the policy observes.",
    "outputs": "What its network makes of that.",
    "asks": "What it asks for: values of inputs, and an alternative of each choice.",
    "ctrl": "What the policy does, whether or not the monitor accepts it.",
    "monitored": "What the policy does where the monitor accepts it, else the fallback.",
}


def policy_files(unit: Unit, policy: NetworkPolicy) -> dict[str, str]:
    """Both files by name. Raises `CompileError` for a model whose states do not show what is observed."""
    assert unit.monitor.controller is not None
    stem = unit.stem
    return {f"{stem}_policy.h": _header(unit, policy), f"{stem}_policy.c": _source(unit, policy)}


def declarations_of_policy(unit: Unit) -> dict[str, str]:
    """Signatures by name, in order."""
    stem = unit.stem
    called = f"{stem}_state curr, const {stem}_parameters *params, const {stem}_input *input"
    upper = stem.upper()
    observed = f"{unit.real} observation[{upper}_OBSERVATIONS]"
    return {
        "observe": f"void {stem}_policy_observe({called}, {observed})",
        "outputs": f"void {stem}_policy_outputs(const {observed}, {unit.real} output[{upper}_OUTPUTS])",
        "asks": f"void {stem}_policy_asks({called}, {stem}_input *asked, int choices[{upper}_CHOICES])",
        "ctrl": f"{stem}_state {stem}_policy_ctrl({called})",
        "monitored": f"{stem}_state {stem}_policy_monitored({called})",
    }


def _header(unit: Unit, policy: NetworkPolicy) -> str:
    stem, upper, io = unit.stem, unit.stem.upper(), policy.interface
    listed = ", ".join(n for n, *_ in io.observations) or "nothing"
    controller = unit.monitor.controller
    assert controller is not None
    sizes = {"OBSERVATIONS": len(io.observations), "OUTPUTS": io.outputs}
    sizes["CHOICES"] = max(1, len(controller.decisions))
    about = f"A policy trained on this model. It observes {listed}, and gives {_meaning(policy)}."
    return "\n".join(
        [
            title_of(unit, "Policy"),
            f"#ifndef {upper}_POLICY_H\n#define {upper}_POLICY_H\n",
            f'#include "{stem}_monitor.h"\n',
            BEFORE,
            comment(about),
            *wrapped(f"enum {{ {', '.join(f'{upper}_{name} = {n}' for name, n in sizes.items())} }};"),
            "",
            *(
                f"{comment(ABOUT[name])}\n{wrapped_head(head)};\n"
                for name, head in declarations_of_policy(unit).items()
            ),
            AFTER,
            "#endif\n",
        ]
    )


def _meaning(policy: NetworkPolicy) -> str:
    io = policy.interface
    masked = ", the largest of those that are possible" if policy.masked else ", the largest counts"
    match io.kind:
        case "none":
            return "nothing that counts"
        case "choice":
            return f"a number for each alternative{masked}"
        case "choices":
            return f"a number for each alternative of each choice{masked}"
        case "runs":
            return f"a number for each control path{masked}"
        case "box":
            asked = [*io.inputs, *("a choice" for _ in io.counts)]
            return "what it asks for: " + ", ".join(asked)


def _source(unit: Unit, policy: NetworkPolicy) -> str:
    leaves = Leaves(builder_of(unit), order_of(unit), unit.single)
    observed = _observe(unit, policy, leaves)
    size, signature = len(policy.interface.observations), declarations_of_policy(unit)["outputs"]
    parts = [network_functions(unit.single, policy.network, size, signature), *_acting(unit, policy)]
    body = "\n".join([*leaves.texts, observed, *parts])
    used = [one_line(name) for name in RUNTIME if f"{name}(" in body]
    used += [copied("policy.h", ("clipped",))] if "clipped(" in body else []
    text = "\n".join(
        [
            f'{title_of(unit, "Policy")}\n#include "{unit.stem}_policy.h"\n',
            *(["#include <math.h>\n"] if re.search(LIBRARY, body) else []),
            f"typedef {unit.real} real;\n",
            *used,
            body,
        ]
    )
    return with_own_names(text, f"{unit.stem}_policy")


LIBRARY = rf"\b({MATH}|expm1|rint)f?\(|\bisfinite\("
"""Calls of <math.h>."""

# Observations --------------------------------------------------------------------------------------


def _observe(unit: Unit, policy: NetworkPolicy, leaves: Leaves) -> str:
    """One way through the leading statements after the other, the last where it is none of the others."""
    read = reading(unit, "input->", "curr.", "params->")
    drafts = _leads(unit.monitor.model)
    lines: list[str] = []
    for k, draft in enumerate(drafts):
        shown = _shown(unit, policy, leaves, dict(draft.updates), k)
        if k + 1 == len(drafts):
            lines += shown
            break
        told = all(_excluded(draft, other) for other in drafts if other is not draft)
        tests = TRUE if told else draft.tests
        guard = leaves.condition(f"lead{k}", tests, "Whether the step begins like this.", read)
        taken = " && ".join([*_measured(unit, draft), *([guard] if tests != TRUE else [])])
        lines += [*wrapped(f"if ({taken}) {{"), *(f"  {line}" for line in shown), "  return;", "}"]
    return function(declarations_of_policy(unit)["observe"], lines)


def _leads(model: Model) -> tuple[Draft, ...]:
    """The ways through the leading statements. Raises `CompileError` where one has no end."""
    drafts = leading_drafts(model)
    if endless := [d for d in drafts if d.target != END]:
        title = "a policy for this model cannot be exported"
        label = "the environment executes a while loop here before the policy observes"
        advice = "write the loop's result as an assignment, or its iterations as choices"
        raise CompileError(error("policy-observation", title, endless[0].span, label, advice))
    return drafts


def _excluded(draft: Draft, other: Draft) -> bool:
    """Whether some decision of the environment tells one way from the other."""
    taken, others = draft.alternatives, other.alternatives
    return any(taken[key] != others[key] for key in taken.keys() & others.keys())


def _measured(unit: Unit, draft: Draft) -> list[str]:
    """That the environment took the alternatives of a way."""
    assert unit.monitor.controller is not None
    known = {d.key: d for d in unit.monitor.controller.measured}
    return [f"input->{unit.measured(known[key])} == {a}" for key, a in draft.alternatives.items()]


def _shown(
    unit: Unit, policy: NetworkPolicy, leaves: Leaves, updates: Mapping[str, Term], number: int
) -> list[str]:
    """Statements that show what leading statements make of each name."""
    model = unit.monitor.model
    values: dict[str, Term] = {q.name: q.symbol for q in (*model.variables, *model.constants)}
    values |= updates
    read = reading(unit, "input->", "curr.", "params->")
    lines: list[str] = []
    for k, (name, low, high) in enumerate(policy.interface.observations):
        leaf = f"shown_{name}" + (f"_{number}" if number else "")
        value = leaves.term(leaf, values[name], f"{name} as it is observed.", read)
        narrowed = policy.interface.dtype == "float32" and not unit.single
        if narrowed:
            value = f"(real)(float){grouped(value)}"
        if narrowed or np.isfinite([low, high]).any():
            value = f"clipped({value}, {_end(unit, low)}, {_end(unit, high)})"
        lines += wrapped(f"observation[{k}] = {value};")
    return lines


def _end(unit: Unit, end: float) -> str:
    """A limit of an observation; what has none is limited as in the environment, by the largest float."""
    bounded = float(np.clip(end, -LARGEST_FLOAT, LARGEST_FLOAT))
    return unit.literal(Fraction(bounded))


# Actions -------------------------------------------------------------------------------------------


def _acting(unit: Unit, policy: NetworkPolicy) -> Iterator[str]:
    """From outputs to the state that they lead to."""
    controller = unit.monitor.controller
    assert controller is not None
    stem, io = unit.stem, policy.interface
    if io.kind in ("choice", "choices", "runs"):
        yield copied("policy.h", ("largest",))
        if policy.masked:
            yield _mask(unit, policy, controller)
        elif io.kind == "runs":
            yield table("int", "PATHS", f"[{len(io.runs)}][{len(io.counts)}]", [_row(r) for r in io.runs])
    heads = declarations_of_policy(unit)
    lines = [
        f"real observation[{stem.upper()}_OBSERVATIONS];",
        f"real output[{stem.upper()}_OUTPUTS];",
        f"{stem}_policy_observe(curr, params, input, observation);",
        f"{stem}_policy_outputs(observation, output);",
        "*asked = *input;",
        *_decided(unit, policy, controller),
    ]
    yield function(heads["asks"], lines)
    words = {"MODEL": stem, "MADE": f"{stem.upper()}_CHOICES"}
    yield function(heads["ctrl"], copied_body("policy.h", "MODEL_policy_ctrl", words))
    called = f"curr, params, input, {stem}_policy_ctrl, {stem}_fallback"
    yield function(heads["monitored"], wrapped(f"return {stem}_monitored_ctrl({called});"))


def _row(values: tuple[int, ...]) -> str:
    return "{" + ", ".join(map(str, values)) + "}"


def _mask(unit: Unit, policy: NetworkPolicy, controller: Controller) -> str:
    """Functions that find what is possible, as the environment's mask, and their tables."""
    io = policy.interface
    vectors = list(dict.fromkeys(run.taken for run in controller.runs))
    n = len(io.counts)
    starts = [sum(io.counts[:k]) for k in range(n + 1)]
    tables = [table("int", "TAKEN", f"[{len(vectors)}][{n}]", [_row(v) for v in vectors])]
    tables.append(table("int", "START", f"[{n + 1}]", [str(s) for s in starts]))
    sizes = {"RUNS": len(vectors), "CHOICES": n, "ALTERNATIVES": starts[-1], "POLICY_PATHS": len(io.runs)}
    words = {"MODEL": unit.stem} | {word: str(size) for word, size in sizes.items()}
    functions = [copied("policy.h", ("mask",), words)]
    if io.kind == "runs":
        tables.append(table("int", "PATHS", f"[{len(io.runs)}][{n}]", [_row(r) for r in io.runs]))
        functions.append(copied("policy.h", ("mask_paths",), words))
    return "\n".join([*tables, *functions])


def _decided(unit: Unit, policy: NetworkPolicy, controller: Controller) -> list[str]:
    """Statements that set `choices`, and in `asked` values of inputs, as the outputs say."""
    io = policy.interface
    masked = policy.masked and io.kind in ("choice", "choices", "runs")
    lines = [f"bool open[{sum(io.counts)}];", "mask(curr, params, input, open);"] if masked else []
    opened = "open" if masked else "0"
    match io.kind:
        case "none":
            return ["(void)output;", "choices[0] = 0;"]
        case "choice":
            return [*lines, f"choices[0] = largest(output, {opened}, {io.counts[0]});"]
        case "choices":
            for k, n in enumerate(io.counts):
                first = sum(io.counts[:k])
                own = f"open + {first}" if masked else "0"
                lines.append(f"choices[{k}] = largest(output + {first}, {own}, {n});")
            return lines
        case "runs":
            if masked:
                lines += [f"bool whole[{len(io.runs)}];", "mask_paths(open, whole);"]
            call = f"largest(output, {'whole' if masked else '0'}, {len(io.runs)})"
            lines.append(f"const int *path = PATHS[{call}];")
            return [*lines, f"for (int c = 0; c < {len(io.counts)}; c++)", "  choices[c] = path[c];"]
        case "box":
            return _asked(unit, policy, controller)


def _asked(unit: Unit, policy: NetworkPolicy, controller: Controller) -> list[str]:
    """Numbers inside the action space: values of inputs, and choices that are rounded. What is decided when
    the motion has begun is not the controller's.
    """
    io = policy.interface
    values: list[str] = []
    for k, (low, high) in enumerate(zip(io.low, io.high, strict=True)):
        first, last = unit.literal(Fraction(low)), unit.literal(Fraction(high))
        given = f"output[{k}]"
        if policy.network.bounded:
            given = f"{first} + (output[{k}] + 1) / 2 * ({last} - {first})"
        values.append(f"clipped({given}, {first}, {last})")
    lines: list[str] = []
    known = {i.key for i in controller.inputs}
    for key, value in zip(io.inputs, values, strict=False):
        if key not in known:
            continue
        lines += wrapped(f"asked->{unit.field(key)} = {value};")
    for c, (value, count) in enumerate(zip(values[len(io.inputs) :], io.counts, strict=True)):
        scaled = f"({value} + 1) / 2 * {count - 1}" if io.squash else value
        lines += wrapped(f"choices[{c}] = (int)rint{'f' if unit.single else ''}({scaled});")
    return lines if io.counts else [*lines, "choices[0] = 0;"]
