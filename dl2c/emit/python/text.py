"""What an environment is, in the sections that Gymnasium's own environments have in their docstrings.

Comes in: a model, its paths and options. Goes out: the lines of a docstring, for both kinds of modules.
"""

import re
import textwrap
from collections.abc import Iterator, Sequence

from dl2c.emit.cfile import place
from dl2c.emit.plan import BuildPlan
from dl2c.ir.logic import conjuncts
from dl2c.ir.model import Constant, Formula, Model, Predicate, Trigger, Variable
from dl2c.ir.printer import print_flow, print_formula, print_number, print_term
from dl2c.lower.observations import observation_limits, observed
from dl2c.paths.path import Decision, Input
from dl2c.source import NOWHERE, Source

WIDTH = 84
"""Of text in a docstring, without its margin."""


def sections(build: BuildPlan, arguments: Sequence[tuple[str, str]]) -> list[str]:
    """Lines of a class's docstring; `arguments` are names and what they do."""
    model = build.model
    parts = {
        "Description": _description(build),
        "Action Space": _actions(build),
        "Observation Space": _observations(build),
        "Rewards": _rewards(model),
        "Starting State": [*_prose("Drawn uniformly from where"), "", *_formula(model.precondition)],
        "Episode End": _endings(build),
        "Arguments": [line for name, about in arguments for line in _item(f"`{name}`: {about}")],
    }
    return [
        clean(line) for title, lines in parts.items() for line in (f"## {title}", "", *lines, "") if lines
    ][:-1]


def clean(line: str) -> str:
    """A line in which nothing can end a docstring or a comment, or be read as an escape."""
    shown = "".join(c if c.isprintable() else " " for c in line)
    return shown.replace("\\", "/").replace('"""', "'''").rstrip()


def headline(model: Model) -> str:
    """The model's name as a sentence."""
    return clean(f"{model.name.strip().rstrip('.') or 'A model'}.")


def class_name(model: Model) -> str:
    """`WaterTankEnv` for "Water tank"."""
    words = re.findall(r"[A-Za-z0-9]+", model.name)
    name = "".join(word[0].upper() + word[1:] for word in words) or "Model"
    return f"{'Model' if name[0].isdigit() else ''}{name}Env"


def file_name(source: Source) -> str:
    """The model's file, without its directory."""
    return clean(source.file_name)


def source_text(build: BuildPlan) -> str:
    """The file that the model comes from, as far as it is known."""
    spans = (f.span for f in build.model.flows)
    return next((span.source.text for span in spans if span != NOWHERE), "")


def _prose(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def _item(text: str) -> list[str]:
    return textwrap.wrap(
        f"- {text}", WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )


def _formula(formula: Formula) -> list[str]:
    """Its conjuncts, one an item."""
    return [line for part in conjuncts(formula) for line in _item(f"`{print_formula(part)}`")]


def _description(build: BuildPlan) -> list[str]:
    """What the file says of itself, and the motion of a step."""
    found = re.match(r"\s*/\*+(?!\s*@)(.*?)\*+/", source_text(build), flags=re.DOTALL)
    about = [re.sub(r"^\s*\*( |$)", "", line).strip() for line in (found[1] if found else "").split("\n")]
    paragraphs = [_prose(part) for part in "\n".join(about).strip().split("\n\n") if part.strip()]
    lines = [line for paragraph in paragraphs for line in (*paragraph, "")]
    if build.model.flows:
        lines += ["A step is one run of the model's loop. Its motion:", ""]
    for flow in build.model.flows:
        lines += _item(f"`{print_flow(flow)}` ({place(flow.span)})")
    return lines


# Spaces -----------------------------------------------------------------------


def agent_decisions(build: BuildPlan) -> tuple[tuple[Decision, ...], tuple[Input, ...]]:
    """What the agent decides: discrete, continuous."""
    paths = build.paths
    return (
        tuple(d for d in paths.decisions if d.role == "agent"),
        tuple(i for i in paths.inputs if i.role == "agent"),
    )


def _actions(build: BuildPlan) -> list[str]:
    choices, inputs = agent_decisions(build)
    if not choices and not inputs:
        return ["`Discrete(1)`: there is nothing to decide."]
    lines: list[str] = []
    for choice in choices:
        named = f" ({choice.name})" if choice.name else ""
        lines += _prose(f"`{choice.key}`{named} is one of {len(choice.alternatives)} alternatives:")
        table = [(str(k), f"`{text}`") for k, text in enumerate(choice.alternatives)]
        lines += ["", *_table(("Num", "Alternative"), table), ""]
    if inputs:
        rows = [(f"`{i.key}`", _limits(i), _about(build.model, i.variable)) for i in inputs]
        lines += [*_table(("Input", "Limits", "Value of"), rows), ""]
    lines += _prose(
        "Actions whose tests fail have no run: `info['action_mask']` shows which alternatives have one, "
        "and an input becomes the nearest value that passes."
    )
    return lines


def _limits(given: Input) -> str:
    return f"[{print_number(given.low)}, {print_number(given.high)}]"


def _about(model: Model, variable: str) -> str:
    """A variable's description and unit."""
    item = next((v for v in model.variables if v.name == variable), None)
    return f"`{variable}`{_noted(item)}" if item else "a part of the longest duration"


def _noted(item: Variable | Constant) -> str:
    words = ", ".join(part for part in (item.description, item.unit) if part)
    return f": {words}" if words else ""


def _observations(build: BuildPlan) -> list[str]:
    model, options = build.model, build.options
    items: dict[str, Variable | Constant] = {v.name: v for v in (*model.variables, *model.constants)}
    entries = observed(model, options)
    rows: list[tuple[str, ...]] = []
    for k, (name, _, bound) in enumerate(entries):
        low, high = observation_limits(bound, options)
        rows.append((str(k), f"`{name}`{_noted(items[name])}", f"{low:g}", f"{high:g}"))
    head = f"`Box` of shape `({len(entries)},)` and type `{options.obs_dtype}`:"
    return [head, "", *_table(("Num", "Observation", "Min", "Max"), rows)]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A table of Markdown, columns aligned."""
    safe = [[cell.replace("|", "/").replace("\n", " ") for cell in row] for row in (head, *rows)]
    widths = [max(len(row[k]) for row in safe) for k in range(len(head))]
    lines = ["| " + " | ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)) + " |" for row in safe]
    return [lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]]


# Rewards and endings ----------------------------------------------------------


def _rewards(model: Model) -> list[str]:
    lines = [line for p in model.predicates for line in _reward(p)]
    return lines or ["None: every reward is 0."]


def _reward(predicate: Predicate) -> Iterator[str]:
    pays = [
        f"{print_term(term)} {when}"
        for term, when in (
            (predicate.reward, "where it holds"),
            (predicate.penalty, "where it fails"),
            (predicate.shape, "always"),
        )
        if term is not None
    ]
    if pays:
        yield from _item(f"`{predicate.name}` (@{predicate.category}): {'; '.join(pays)}.")


def _endings(build: BuildPlan) -> list[str]:
    lines: list[str] = []
    for p in build.model.predicates:
        for trigger, when in ((p.on_success, "holds"), (p.on_failure, "fails")):
            if trigger is not None and trigger.action != "continue":
                lines += _item(f"{_ends(trigger)}, status {trigger.status}, when `{p.name}` {when}:")
                lines += [f"  {line}" for line in _prose(f"`{print_formula(p.formula)}`")]
    steps = build.options.max_episode_steps
    if steps:
        lines += _item(f"Truncated after {steps} steps, reason time_limit.")
    return lines + _item("Truncated where no alternative has a run (deadlock) or numbers overflow.")


def _ends(trigger: Trigger) -> str:
    return {"terminate": "Terminated", "truncate": "Truncated"}[trigger.action]
