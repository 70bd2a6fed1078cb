"""A compiled model, for people: its spaces, decisions, bounds, kernels, predicates and options."""

from collections.abc import Iterable

from rich.console import Console
from rich.table import Table

from dl2c.native.manifest import ChoiceSpec, InputSpec, Manifest, Quantity

PIPED_WIDTH = 160
"""Columns of output that is not a terminal's."""


MASKS = {
    "flow": "up to the first motion of a step (mask_depth=flow)",
    "step": "to the end of a step (mask_depth=step)",
}


def describe(manifest: Manifest) -> None:
    """Print what `dl2c info` shows."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=PIPED_WIDTH)
    console.print(f"[bold]{manifest.name}[/bold]  (dl2c {manifest.dl2c_version}, build {manifest.key})")
    console.print(
        f"observation space  Box({len(manifest.observations)}, {manifest.options['obs_dtype']})", markup=False
    )
    console.print(f"action space       {_action_space(manifest)}", markup=False)
    console.print(f"initial states     {manifest.certificate}", markup=False)
    theorem = manifest.theorem
    console.print(f'theorem            "{theorem.name}": {theorem.known}', markup=False)
    if theorem.invariant:
        console.print(f"invariant          {theorem.invariant}", markup=False)
    if manifest.choices:
        depth = manifest.options.get("mask_depth", "flow")
        console.print(f"action mask        {MASKS[depth]}", markup=False)
    for title, columns, rows in (
        ("Observation", ("entry", "low", "high", "unit", "meaning"), _quantities(manifest.observations)),
        ("Constants", ("name", "low", "high", "unit", "meaning", "fixed"), _constants(manifest)),
        ("Choices", ("decision", "#", "alternative"), _choices(manifest.choices)),
        ("Inputs", ("decision", "variable", "low", "high"), _inputs(manifest.inputs)),
        ("Choices of the environment", ("decision", "#", "alternative"), _choices(manifest.drawn_choices)),
        (
            "Inputs of the environment",
            ("decision", "variable", "low", "high"),
            _inputs(manifest.drawn_inputs),
        ),
        ("Continuous evolutions", ("ODE", "kernel", "because"), _flows(manifest)),
        ("Events of continuous evolutions", ("line", "condition", "where it fails is"), _events(manifest)),
        ("Predicates", ("name", "category"), [(p.name, p.category) for p in manifest.predicates]),
        ("Options", ("name", "value"), [(k, str(v)) for k, v in sorted(manifest.options.items())]),
    ):
        if found := list(rows):
            console.print(_table(title, columns, found))
    for note in manifest.notes:
        console.print(f"note: {note}", markup=False)


def _action_space(manifest: Manifest) -> str:
    """As Gymnasium writes it, a Box by its size alone: the table of inputs has the limits."""
    counts = [len(c.alternatives) for c in manifest.choices]
    dtype = manifest.options["obs_dtype"]
    match manifest.action_form():
        case "none":
            return "Discrete(1)"
        case "one choice":
            return f"Discrete({counts[0]})"
        case "choices":
            return f"MultiDiscrete([{' '.join(map(str, counts))}])"
        case "runs":
            return f"Discrete({len(manifest.runs)})"
        case "box":
            return f"Box({len(manifest.inputs) + len(counts)}, {dtype})"
        case "dict":
            boxes = [f"'{i.key}': Box(1, {dtype})" for i in manifest.inputs]
            choices = [f"'{c.key}': Discrete({n})" for c, n in zip(manifest.choices, counts, strict=True)]
            return f"Dict({', '.join(sorted(boxes + choices))})"


def _table(title: str, columns: Iterable[str], rows: Iterable[tuple[str, ...]]) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", box=None, pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*(cell.replace("[", r"\[") for cell in row))
    return table


def _quantities(quantities: Iterable[Quantity]) -> list[tuple[str, ...]]:
    return [(q.name, f"{q.low:g}", f"{q.high:g}", q.unit, q.description) for q in quantities]


def _constants(manifest: Manifest) -> list[tuple[str, ...]]:
    fixed = ["" if q.value is None else f"{q.value:g}" for q in manifest.constants]
    return [(*row, value) for row, value in zip(_quantities(manifest.constants), fixed, strict=True)]


def _choices(choices: Iterable[ChoiceSpec]) -> list[tuple[str, ...]]:
    return [
        ((c.key + (f" {c.name}" if c.name else "")) if k == 0 else "", str(k), text)
        for c in choices
        for k, text in enumerate(c.alternatives)
    ]


def _inputs(inputs: Iterable[InputSpec]) -> list[tuple[str, ...]]:
    return [(i.key, i.variable, f"{i.low:g}", f"{i.high:g}") for i in inputs]


def _events(manifest: Manifest) -> list[tuple[str, ...]]:
    return [(f.text.split("  ")[0], *event) for f in manifest.flows for event in f.events]


def _flows(manifest: Manifest) -> list[tuple[str, ...]]:
    return [(f.text, f.kernel, f.reason) for f in manifest.flows]
