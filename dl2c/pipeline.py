"""The way from a model's text to a loaded library: one function per arrow, in order.

source --read_entry--> entry --resolve--> problem --lower--> step model
  --enumerate_paths--> paths --plan--> exact flows --decide, plan_sampling--> sampler
  --model_c--> C --compile_library--> library --load_library--> Library
"""

import json
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dl2c.diagnostics import CompileError, Diagnostic, error, in_source_order, warning
from dl2c.ir.lints import program_warnings
from dl2c.ir.lower import lower
from dl2c.ir.model import Predicate
from dl2c.ir.printer import print_model
from dl2c.native.cache import build_key, cached
from dl2c.options import Options, UnknownOption, under, with_options
from dl2c.parse.annotations import EpisodeAnnotation
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_archive, print_formula
from dl2c.parse.tree import Archive, Entry
from dl2c.resolve.expand import expanded_formula
from dl2c.resolve.problem import Problem, resolve
from dl2c.source import Source, Span
from dl2c.version import __version__

if TYPE_CHECKING:
    from dl2c.emit.plan import Environment
    from dl2c.ir.model import Model
    from dl2c.native.binding import Library
    from dl2c.paths.path import Paths

Progress = Callable[[str], None]
"""Called with what the pipeline is about to do."""

STAGES = ("tree", "expanded", "ir", "paths", "c")


@dataclass(frozen=True, slots=True)
class Compiled:
    """A built model: its loaded library, the folder of its files, and what to tell the user."""

    library: "Library"
    directory: Path
    warnings: tuple[Diagnostic, ...]


def resolve_options(given: Mapping[str, Any]) -> Options:
    """Options from names and values. Raises `UnknownOption`."""
    return with_options(Options(), given)


def compile_model(source: Source, options: Options, *, progress: Progress | None = None) -> Compiled:
    """Build a model, or take it from the cache, and load it.

    Raises `CompileError` for a mistake in the model, `NativeError` where C cannot be compiled.
    """
    from dl2c.native.binding import load_library

    problem, options, warnings = _front(source, options)
    key = build_key({source.name: source.text}, options)
    directory = cached(key, lambda folder: _build(problem, options, key, folder, progress))
    found = json.loads((directory / "warnings.json").read_text(encoding="utf-8"))
    later = tuple(_restored(w, source) for w in found)
    return Compiled(load_library(directory), directory, in_source_order((*warnings, *later)))


def check_model(source: Source, options: Options) -> tuple[Diagnostic, ...]:
    """Everything that can be said of a model without compiling C: its warnings.

    Raises `CompileError` for its errors.
    """
    problem, options, warnings = _front(source, options)
    _, later = _environment(problem, options, None)
    return in_source_order((*warnings, *later))


def emit(source: Source, stage: str, options: Options) -> str:
    """One stage of the pipeline as text. Raises `CompileError`, `UnknownOption` for an unknown stage."""
    if stage not in STAGES:
        raise UnknownOption(f"no stage `{stage}`; the stages are {', '.join(STAGES)}")
    if stage == "tree":
        archive, _ = parse_archive(source)
        return print_archive(archive)
    problem, options, _ = _front(source, options)
    if stage == "expanded":
        expanded = expanded_formula(problem.entry.problem, problem.symbols, hints=False)
        return print_formula(expanded) + "\n"
    if stage == "ir":
        return print_model(lower(problem, options))
    environment, _ = _environment(problem, options, None)
    if stage == "paths":
        from dl2c.paths.printer import print_paths

        return print_paths(environment.paths)
    from dl2c.emit.model_c import model_sources

    return "\n".join(model_sources(environment).values())


def step_model(source: Source, options: Options) -> tuple["Model", "Paths"]:
    """What a step of a model does, as data: for those who run it in another way. Raises `CompileError`."""
    from dl2c.paths.enumerate import enumerate_paths

    problem, options, _ = _front(source, options)
    model = lower(problem, options)
    return model, enumerate_paths(model)


def _front(source: Source, options: Options) -> tuple[Problem, Options, tuple[Diagnostic, ...]]:
    """Parse and resolve; `@episode` completes the options."""
    archive, warnings = parse_archive(source)
    problem = resolve(entry_of(archive, options), options.loop)
    if problem.episode is not None:
        options = _completed(options, problem.episode)
    return problem, replace(options, given=frozenset()), warnings


def _completed(options: Options, episode: EpisodeAnnotation) -> Options:
    """The options under those of `@episode`."""
    names = {"max_steps": "max_episode_steps"}
    found: list[Diagnostic] = []
    for name, value, span in episode.options:
        try:
            options = under(options, {names.get(name, name): value})
        except UnknownOption:
            title = f"`@episode` option `{name}` is not supported"
            found.append(error("unsupported-option", title, span, help="leave it out"))
    if found:
        raise CompileError(found)
    return options


def entry_of(archive: Archive, options: Options) -> Entry:
    """The archive entry that the options name, or the only one."""
    named = [e for e in archive.entries if options.entry in (None, e.name)]
    if len(named) == 1:
        return named[0]
    names = ", ".join(f'"{e.name}"' for e in archive.entries)
    title = f"no entry `{options.entry}`" if not named else "the file has several entries"
    start = archive.entries[0].span
    raise CompileError(
        error(
            "entry-not-found",
            title,
            Span(start.source, start.start, start.start + 1),
            help=f"choose one with --entry: {names}",
        )
    )


def _environment(
    problem: Problem, options: Options, progress: Progress | None
) -> tuple["Environment", tuple[Diagnostic, ...]]:
    """Everything that code is generated from, and warnings."""
    from dl2c.emit.plan import Environment
    from dl2c.ir.exact import ExactPlan, NotExact, plan
    from dl2c.paths.enumerate import enumerate_paths
    from dl2c.sampling.plan import NoSampler, plan_sampling
    from dl2c.smt.precondition import decide

    def say(what: str) -> None:
        if progress is not None:
            progress(what)

    model = lower(problem, options)
    say("enumerating paths")
    paths = enumerate_paths(model)
    plans = [plan(f) for f in model.flows]
    refused = [_not_exact(p) for p in plans if isinstance(p, NotExact)]
    if refused:
        raise CompileError(refused)
    say("deciding the precondition")
    decision = decide(model)
    say("planning initial states")
    sampling = plan_sampling(model, decision=decision)
    warnings = _doubts(model)
    if isinstance(sampling, NoSampler):
        if sampling.diagnostic.code in ("unsatisfiable-precondition", "unbounded-variable"):
            raise CompileError(sampling.diagnostic)
        d = sampling.diagnostic
        advice = 'reset needs a state: reset(options={"state": {...}})'
        warnings += (warning(d.code, d.title, d.span, d.label, advice, d.notes),)
    environment = Environment(
        model=model,
        paths=paths,
        flows=tuple(p for p in plans if isinstance(p, ExactPlan)),
        sampling=None if isinstance(sampling, NoSampler) else sampling,
        options=options,
        version=__version__,
    )
    return environment, warnings


def _doubts(model: "Model") -> tuple[Diagnostic, ...]:
    never_due = (_never_due(p) for p in model.predicates if _is_never_due(p))
    return (*never_due, *program_warnings(model))


def _is_never_due(predicate: Predicate) -> bool:
    return predicate.category == "progress" and predicate.on_failure is not None and predicate.due is None


def _never_due(predicate: Predicate) -> Diagnostic:
    """Semantics 6: a progress predicate fails only when its obligation falls due."""
    name = predicate.name
    return warning(
        "failure-never-due",
        f"`on_failure` of `{name}` never counts",
        predicate.span,
        f"the postcondition does not say when `{name}` must hold",
        f"add an obligation to the postcondition, e.g. `(T <= 0 -> {name}(...))`, or drop `on_failure`",
    )


def _not_exact(refused: "Any") -> Diagnostic:
    return error(
        "flow-not-exact",
        "this differential equation cannot be integrated exactly",
        refused.span,
        refused.reason,
        "flows must be polynomial in time, and their domains conjunctions of conditions of degree 2 in time",
    )


def _build(problem: Problem, options: Options, key: str, folder: Path, progress: Progress | None) -> None:
    """Fill a folder with everything that `dl2c build` writes."""
    from dl2c.emit.model_c import model_sources
    from dl2c.emit.names import file_stem
    from dl2c.native.compile import compile_library
    from dl2c.native.describe import manifest_of

    environment, warnings = _environment(problem, options, progress)
    if progress is not None:
        progress("compiling C")
    stem = file_stem(environment.model.name)
    compile_library(model_sources(environment), stem, folder, native=options.native)
    manifest = manifest_of(environment, key, {"machine": platform.machine(), "system": platform.system()})
    (folder / "manifest.json").write_text(manifest.to_json(), encoding="utf-8")
    (folder / "model.ir").write_text(print_model(environment.model), encoding="utf-8")
    saved = [_saved(w) for w in warnings]
    (folder / "warnings.json").write_text(json.dumps(saved, indent=1) + "\n", encoding="utf-8")


def _saved(diagnostic: Diagnostic) -> dict[str, Any]:
    span = diagnostic.span
    return {
        "code": diagnostic.code,
        "title": diagnostic.title,
        "range": [span.start, span.end],
        "label": diagnostic.label,
        "help": diagnostic.help,
        "notes": list(diagnostic.notes),
    }


def _restored(saved: dict[str, Any], source: Source) -> Diagnostic:
    span = Span(source, *saved["range"])
    return warning(saved["code"], saved["title"], span, saved["label"], saved["help"], tuple(saved["notes"]))
