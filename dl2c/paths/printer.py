"""Guarded paths as text, for `dl2c emit --stage paths`."""

from dl2c.ir.printer import print_formula, print_number, print_term
from dl2c.paths.path import END, Path, Paths


def print_paths(paths: Paths) -> str:
    """Decisions, inputs, and every path with its guard and updates."""
    lines: list[str] = []
    for decision in paths.decisions:
        lines.append(f"{decision.key} ({decision.role})")
        lines += [f"  {k}: {text}" for k, text in enumerate(decision.alternatives)]
    lines += [f"{i.key} ({i.role}) [{print_number(i.low)}:{print_number(i.high)}]" for i in paths.inputs]
    lines += [f"before each step: point {paths.lead}"] if paths.lead is not None else []
    lines += [f"before the first step: point {paths.prefix}"] if paths.prefix is not None else []
    for k, path in enumerate(paths.paths):
        lines += ["", *_path(k, path, paths)]
    return "\n".join(lines) + "\n"


def _path(k: int, path: Path, paths: Paths) -> list[str]:
    taken = ", ".join(f"{d.key}={a}" for d, a in zip(paths.decisions, path.decisions, strict=True) if a >= 0)
    target = "end" if path.target == END else f"point {path.target}"
    flow = "" if path.flow is None else f" by flow {path.flow}"
    lines = [f"path {k} from point {path.point} to {target}{flow}" + (f" when {taken}" if taken else "")]
    lines.append(f"  guard {print_formula(path.guard)}")
    lines += [f"  {paths.inputs[a.input].key} passes {print_formula(a.tests)}" for a in path.admissions]
    lines += [f"  {x} := {print_term(term)}" for x, term in path.updates]
    return lines
