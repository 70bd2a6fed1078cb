"""`dl2c monitor`: write a model's run-time monitor as C, or replay a recorded trace through it."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from dl2c.commands.arguments import Model
from dl2c.commands.completion import words
from dl2c.commands.failures import CommandError, show, to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import quiet
from dl2c.work import budgeted

if TYPE_CHECKING:
    from dl2c.emit.monitor.monitor_h import Unit
    from dl2c.monitor.check import Tolerance
    from dl2c.policy.network import NetworkPolicy
    from dl2c.report.trace import Violation


Output = Annotated[Path | None, typer.Option("-o", "--output", help="Folder for the files.")]
Kinds = Annotated[
    list[str] | None,
    typer.Option(
        metavar="init|controller|model|safety", help="A check to write; may be repeated. Default: all."
    ),
]
Number = Annotated[
    str,
    typer.Option(
        metavar="double|float", help="Type of numbers in C.", autocompletion=words("double", "float")
    ),
]
Sound = Annotated[
    bool, typer.Option("--sound", help="Evaluate in intervals: no verdict is wrong, some are unknown.")
]
Eps = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]VALUE",
        help="How far values may be from those computed: relative, or of NAME, in its unit.",
    ),
]
Prefix = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="What all names and files begin with; default: the model's name."),
]
Trained = Annotated[
    Path | None,
    typer.Option(
        "--policy", metavar="FILE|DIR", help="A trained policy to write too: policy.json, or SB3's zip."
    ),
]
Onnx = Annotated[bool, typer.Option("--onnx", help="With --policy: write the policy as an ONNX file too.")]
Trace = Annotated[
    Path | None, typer.Option("--check", metavar="CSV", help="Replay what `dl2c rollout --csv` wrote.")
]


def monitor(
    model: Model,
    output: Output = None,
    kind: Kinds = None,
    real: Number = "double",
    sound: Sound = False,
    eps: Eps = None,
    policy: Trained = None,
    onnx: Onnx = False,
    prefix: Prefix = None,
    trace: Trace = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Write a run-time monitor in C that compares a system with the model."""
    kinds = tuple(kind or ())
    _check_together(output, trace, kinds, policy, onnx)
    trained = None
    if policy is not None:
        from dl2c.commands.policy import policy_for

        trained, options = policy_for(model, policy, options)
    unit = replace(unit_of(model, options, kinds, real, sound, tuple(eps or ())), prefix=_checked(prefix))
    found: dict[str, Any] = {}
    if output is not None:
        found |= _written(unit, output, trained, onnx)
    failed = None
    if trace is not None:
        violations, found["steps"], found["unchecked"] = _replayed(unit, trace)
        failed = next(iter(violations), None)
        found["violation"] = None if failed is None else failed.as_data()
    if json:
        print(to_json(found))
    else:
        _tell(found, failed, trace)
    if failed is not None:
        raise typer.Exit(1)


def _check_together(
    output: Path | None, trace: Path | None, kinds: tuple[str, ...], policy: Path | None, onnx: bool
) -> None:
    """Raises `CommandError` for arguments that do not go together."""
    if output is None and trace is None:
        raise CommandError("nothing to do: give a folder with -o, or a trace with --check")
    if policy is not None and (output is None or (kinds and "controller" not in kinds)):
        raise CommandError("--policy needs -o, and the controller's check")
    if onnx and policy is None:
        raise CommandError("--onnx goes with --policy")


def _checked(prefix: str | None) -> str:
    if prefix is not None and not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,60}", prefix):
        raise CommandError(f"--prefix takes letters, digits and underscores, not {prefix!r}")
    return prefix or ""


@budgeted()
def unit_of(
    model: str,
    options: Mapping[str, Any],
    kinds: tuple[str, ...] = (),
    real: str = "double",
    sound: bool = False,
    eps: tuple[str, ...] = (),
) -> "Unit":
    """The monitor of a model, as it is to be written. Raises `CommandError`, `CompileError`."""
    from dl2c.emit.monitor.monitor_h import Real, Unit
    from dl2c.env.opening import compilation_of
    from dl2c.ir.model import TRUE
    from dl2c.lower.invariant import invariant
    from dl2c.monitor.build import monitor_of
    from dl2c.monitor.check import KINDS, Kind

    for given in kinds:
        if given not in KINDS:
            raise CommandError(f"no kind {given!r}; there is {', '.join(KINDS)}")
    reals = {name: name for name in get_args(Real)}
    if real not in reals:
        raise CommandError(f"no kind of number {real!r}; there is {', '.join(reals)}")
    found = compilation_of(model, options)
    effective, lowered = found.resolved.options, found.unbounded
    names = {v.name for v in lowered.variables}
    tolerance = _tolerance(eps, names, real == "float")
    wanted: tuple[Kind, ...] = tuple(k for k in KINDS if k in kinds)
    proved = invariant(found.resolved.problem) or TRUE
    made, missing = monitor_of(lowered, wanted, tolerance, proved, effective.default_bound)
    show([d for d in missing if not quiet()])
    squash = effective.action_map == "squash"
    return Unit(made, reals[real], sound, squash, claim=found.claim())


def _tolerance(eps: tuple[str, ...], names: set[str], single: bool) -> "Tolerance":
    from fractions import Fraction

    from dl2c.monitor.check import Tolerance
    from dl2c.options import UnknownOption, exact_number

    relative, absolute = Fraction(1, 10**5 if single else 10**9), dict[str, Fraction]()
    for text in eps:
        name, _, value = text.rpartition("=")
        try:
            number = exact_number("--eps", value)
        except UnknownOption:
            raise CommandError(f"--eps takes VALUE or NAME=VALUE, not {text!r}") from None
        if number < 0 or (name and name not in names):
            raise CommandError(f"--eps {text}: " + ("below 0" if number < 0 else f"no variable `{name}`"))
        if name:
            absolute[name] = number
        else:
            relative = number
    return Tolerance(relative, absolute)


@budgeted()
def _written(unit: "Unit", output: Path, policy: "NetworkPolicy | None", onnx: bool) -> dict[str, Any]:
    from dl2c.emit.monitor.files import monitor_files
    from dl2c.outputs import output_folder

    files = {name: text.encode() for name, text in monitor_files(unit, policy).items()}
    if policy is not None and onnx:
        from dl2c.policy.onnx_export import onnx_of

        files[f"{unit.stem}_policy.onnx"] = onnx_of(policy)
    with output_folder(output) as folder:
        for name, content in files.items():
            (folder / name).write_bytes(content)
    return {"directory": str(output), "files": sorted(files)}


def _replayed(unit: "Unit", trace: Path) -> "tuple[list[Violation], int, int]":
    """Violations, how many steps there are, and how many of them lack the row before."""
    from dl2c.report.trace import disconnected, replayed, rows_of, unseen

    rows, unchecked = rows_of(trace, unit), list[int]()
    if any(check.transition for check in unit.monitor.checks):
        show(unseen(unit.monitor.model, rows[0]))
        unchecked = disconnected(rows)
    return *replayed(unit, rows), len(unchecked)


def _tell(found: Mapping[str, Any], failed: "Violation | None", trace: Path | None) -> None:
    for name in found.get("files", ()):
        print(Path(found["directory"]) / name)
    if failed is not None:
        print(failed.sentence())
    elif trace is not None:
        print(f"{trace}: {found['steps']} steps, none violates the monitor")
    if found.get("unchecked"):
        print(f"steps that are not checked because the trace lacks the row before them: {found['unchecked']}")
