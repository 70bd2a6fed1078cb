"""The way from a model's text to a loaded library: one function per arrow, in order.

source --read_entry--> entry --resolve--> problem --lower--> step model
  --enumerate_paths--> paths --plan--> exact flows --decide, plan_sampling--> sampler
  --model_c--> C --compile_library--> library --load_library--> Library
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dl2c.configuration import configured
from dl2c.diagnostics import CompileError, Diagnostic, as_stored, error, in_source_order, restored, warning
from dl2c.inputs import checked_input, read_json
from dl2c.ir.model import LARGEST_STATE, TRUE
from dl2c.ir.printer import print_model
from dl2c.lower.doubts import program_warnings
from dl2c.lower.problem import lower
from dl2c.native.cache import build_key, cached
from dl2c.options import Options, UnknownOption, current, deprecation, under, with_options
from dl2c.parse.annotations import EpisodeAnnotation
from dl2c.parse.options import ALLOW
from dl2c.parse.parser import parse_archive
from dl2c.parse.printer import print_archive, print_formula
from dl2c.parse.tree import Archive, Entry
from dl2c.progress import LOG, Progress, silent, stages
from dl2c.resolve.problem import Problem, expansion, resolve
from dl2c.resolve.unreadable import read_entry
from dl2c.source import Source, Span
from dl2c.version import __version__
from dl2c.work import at_place, budgeted

if TYPE_CHECKING:
    from dl2c.emit.monitor.monitor_h import Unit
    from dl2c.emit.plan import Environment
    from dl2c.flows.kernel import FlowPlan, Refused
    from dl2c.ir.model import Model
    from dl2c.native.binding import Library
    from dl2c.paths.path import Paths

ANY = (-LARGEST_STATE, LARGEST_STATE)
"""A default bound that limits nothing."""

STAGES = ("tree", "expanded", "ir", "paths", "c", "gym")


@dataclass(frozen=True, slots=True)
class Compiled:
    """A built model: its loaded library, the folder of its files, and what to tell the user."""

    library: "Library"
    directory: Path
    warnings: tuple[Diagnostic, ...]


def resolve_options(given: Mapping[str, Any]) -> Options:
    """Options from names and values, under them those of the project's `[tool.dl2c]`.

    Raises `UnknownOption`, and `CompileError` for a mistake in the project's file.
    """
    defaults = configured(Options())
    options = with_options(defaults, given)
    constants = dict(defaults.constants) | dict(options.constants)
    return replace(options, constants=tuple(sorted(constants.items())))


@budgeted()
def compile_model(source: Source, options: Options, *, progress: Progress = silent) -> Compiled:
    """Build a model, or take it from the cache, and load it.

    Raises `CompileError` for a mistake in the model, `NativeError` where C cannot be compiled.
    """
    from dl2c.native.binding import load_library
    from dl2c.native.errors import NativeError
    from dl2c.native.manifest import MAX_BYTES

    with stages(progress) as say:
        say("reading the model")
        problem, options, warnings = _front(source, options)
        say("looking for an earlier build")
        key = build_key({source.name: source.text}, options)

        def load(directory: Path) -> Compiled:
            with checked_input(NativeError, "this is no build"):
                found = read_json(directory / "warnings.json", MAX_BYTES)
                later = tuple(restored(w, source) for w in found)
            return Compiled(load_library(directory), directory, in_source_order((*warnings, *later)))

        compiled = cached(key, lambda folder: _build(problem, options, key, folder, say), load)
    LOG.info("files: %s", compiled.directory)
    return compiled


@budgeted()
def resolved(source: Source, options: Options) -> tuple[Problem, Options]:
    """The entry that the options name, and the options completed by its `@episode`. Raises `CompileError`."""
    problem, options, _ = _front(source, options)
    return problem, options


@dataclass(frozen=True, slots=True)
class Checked:
    """A model that can be built: everything known of it before C is written."""

    problem: Problem
    environment: "Environment"
    warnings: tuple[Diagnostic, ...]

    @property
    def options(self) -> Options:
        """Those given, completed by `@episode`."""
        return self.environment.options


@budgeted()
def checked(source: Source, options: Options) -> Checked:
    """A model up to the point where C would be written. Raises `CompileError` for its errors."""
    at_place(source.start)
    entry, warnings = read_entry(source, lambda archive: entry_of(archive, options))
    found = checked_entry(entry, options)
    return replace(found, warnings=in_source_order((*warnings, *found.warnings)))


@budgeted()
def checked_entry(entry: Entry, options: Options) -> Checked:
    """The same for one entry of an archive, without what is wrong with the archive around it."""
    with stages() as say:
        say("resolving names")
        problem, options = _completed_problem(entry, options)
        environment, warnings = _environment(problem, options, say)
    return Checked(
        problem, environment, in_source_order((*problem.warnings, *warnings, *_deprecated(problem)))
    )


def check_model(source: Source, options: Options) -> tuple[Diagnostic, ...]:
    """The warnings that a build gives. Raises `CompileError` for a model's errors."""
    return checked(source, options).warnings


@budgeted()
def emit(source: Source, stage: str, options: Options, pure_python: bool = False) -> str:
    """One stage of the pipeline as text; of `gym` also the form that needs no compiler.

    Raises `CompileError`, `UnknownOption` for an unknown stage.
    """
    if stage not in STAGES:
        raise UnknownOption(f"no stage `{stage}`; the stages are {', '.join(STAGES)}")
    if pure_python and stage != "gym":
        raise UnknownOption("`--pure-python` goes with `--stage gym`")
    if stage == "tree":
        archive, _ = parse_archive(source)
        return print_archive(archive)
    if stage == "expanded":
        archive, _ = parse_archive(source)
        return print_formula(expansion(entry_of(archive, options))) + "\n"
    problem, options, _ = _front(source, options)
    if stage == "ir":
        return print_model(_lowered(problem, options)[0])
    environment, _ = _environment(problem, options, silent)
    if stage == "paths":
        from dl2c.paths.printer import print_paths

        return print_paths(environment.paths)
    if stage == "gym":
        return _gymnasium_module(source, environment, pure_python)
    from dl2c.emit.simulator.model_c import model_sources

    return "\n".join(model_sources(environment).values())


def _gymnasium_module(source: Source, environment: "Environment", pure_python: bool) -> str:
    """The module of an environment, over its library or in plain Python."""
    from dl2c.emit.python.module import gym_module
    from dl2c.emit.python.pure import pure_module
    from dl2c.emit.python.refusal import refusals

    if not pure_python:
        return gym_module(environment, source)
    if refused := refusals(environment):
        raise CompileError(refused)
    return pure_module(environment, source)


@budgeted()
def step_model(source: Source, options: Options) -> tuple["Model", "Paths"]:
    """What a step of a model does, as data: for those who run it in another way. Raises `CompileError`."""
    from dl2c.paths.enumerate import enumerate_paths

    problem, options, _ = _front(source, options)
    model, _ = _lowered(problem, options)
    return model, enumerate_paths(model, options.default_bound)


@budgeted()
def lowered_model(source: Source, options: Options) -> "Model":
    """What a step of a model does, whether or not an environment can be made of it: its names need no
    bounds. Raises `CompileError`.
    """
    problem, options, _ = _front(source, options)
    return lower(problem, replace(options, default_bound=options.default_bound or ANY))


@budgeted()
def drawn_model(source: Source, options: Options) -> "Model":
    """The model whose initial states are drawn: limited by the default bound. Raises `CompileError`."""
    archive, _ = parse_archive(source)
    return drawn_model_of(entry_of(archive, options), options)


def drawn_model_of(entry: Entry, options: Options) -> "Model":
    """The same for one entry of an archive."""
    return _lowered(*_completed_problem(entry, options))[1]


def _front(source: Source, options: Options) -> tuple[Problem, Options, tuple[Diagnostic, ...]]:
    """Parse and resolve; `@episode` completes the options."""
    at_place(source.start)
    entry, warnings = read_entry(source, lambda archive: entry_of(archive, options))
    problem, options = _completed_problem(entry, options)
    return problem, options, (*warnings, *problem.warnings, *_deprecated(problem))


def _completed_problem(entry: Entry, options: Options) -> tuple[Problem, Options]:
    at_place(entry.problem.span)
    """A resolved entry, and the options completed by its `@episode`."""
    problem = resolve(entry, options.loop)
    if problem.episode is not None:
        options = _completed(options, problem.episode)
    return problem, replace(options, given=frozenset())


def _completed(options: Options, episode: EpisodeAnnotation) -> Options:
    """The options under those of `@episode`."""
    found: list[Diagnostic] = []
    for name, value, span in episode.options:
        if name == ALLOW:
            continue
        try:
            options = under(options, {name: current(name, value)})
        except UnknownOption as problem:
            found.append(error("bad-option", f"`@episode`: {problem}", span, help="correct the value"))
    if found:
        raise CompileError(found)
    return options


def _deprecated(problem: Problem) -> tuple[Diagnostic, ...]:
    """Values of `@episode` that have a new name."""
    written = problem.episode.options if problem.episode else ()
    return tuple(
        warning("deprecated-option", "this value is deprecated", span, "", f"write `{current(name, value)}`")
        for name, value, span in written
        if name != ALLOW and deprecation(name, value)
    )


def entry_of(archive: Archive, options: Options) -> Entry:
    """The archive entry that the options name, by its name or else its number, or the only one."""
    chosen = options.entry
    named = [e for e in archive.entries if chosen in (None, e.name)]
    named = named or [e for number, e in enumerate(archive.entries, 1) if chosen == str(number)]
    if len(named) == 1:
        return named[0]
    names = ", ".join(f'"{e.name}"' for e in archive.entries)
    if (chosen or "").isdigit():
        names += f", or its number, from 1 to {len(archive.entries)}"
    several = "the file has several entries" + (f" `{chosen}`: give its number" if chosen else "")
    title = several if named else f"no entry `{chosen}`"
    start = archive.entries[0].span
    place = Span(start.source, start.start, start.start + 1)
    raise CompileError(error("entry-not-found", title, place, help=f"choose one with --entry: {names}"))


def _environment(
    problem: Problem, options: Options, say: Progress
) -> tuple["Environment", tuple[Diagnostic, ...]]:
    """Everything that code is generated from, and warnings."""
    from dl2c.emit.plan import Environment
    from dl2c.paths.enumerate import enumerate_paths
    from dl2c.sampling.plan import NoSampler, plan_sampling
    from dl2c.smt.precondition import decide

    say("lowering")
    model, drawn = _lowered(problem, options)
    say("enumerating paths")
    paths = enumerate_paths(model, options.default_bound)
    flows = _plans(model, paths, options)
    say("deciding the precondition")
    decision = decide(drawn)
    say("planning initial states")
    sampling = plan_sampling(drawn, decision=decision)
    warnings = program_warnings(model)
    if isinstance(sampling, NoSampler):
        warnings += (_not_sampled(sampling.diagnostic),)
    monitor, missing = _monitor(problem, model, options, say)
    environment = Environment(
        model=model,
        paths=paths,
        flows=flows,
        sampling=None if isinstance(sampling, NoSampler) else sampling,
        options=options,
        version=__version__,
        monitor=monitor,
    )
    return environment, warnings + missing


def _plans(model: "Model", paths: "Paths", options: Options) -> tuple["FlowPlan", ...]:
    """How every flow is followed. Raises `CompileError` for those that cannot be, as asked."""
    from dl2c.flows.kernel import Refused, plan_flow
    from dl2c.flows.starts import equalities_of
    from dl2c.flows.watch import watches_along
    from dl2c.paths.stiffness import with_solver

    others = (options.integrator, equalities_of(model), model.tolerance)
    plans = [plan_flow(f, watches_along(model, k), *others) for k, f in enumerate(model.flows)]
    refused = [_refused(p) for p in plans if isinstance(p, Refused)]
    if refused:
        raise CompileError(refused)
    flows = [p for p in plans if not isinstance(p, Refused)]
    return tuple(with_solver(k, p, model, paths) for k, p in enumerate(flows))


def _monitor(
    problem: Problem, model: "Model", options: Options, say: Progress
) -> tuple["Unit | None", tuple[Diagnostic, ...]]:
    """The monitor that is exported for a model, where every step is monitored; why it lacks some checks."""
    if not options.monitor_every_step:
        return None, ()
    say("making the monitor")
    from dl2c.emit.monitor.monitor_h import Unit
    from dl2c.lower.invariant import invariant
    from dl2c.monitor.build import monitor_of

    proved = invariant(problem) or TRUE
    made, missing = monitor_of(model, invariant=proved, default_bound=options.default_bound)
    return Unit(made, squash=options.action_map == "squash"), missing


def _not_sampled(d: Diagnostic) -> Diagnostic:
    """That resets need a state. Raises `CompileError` where none will do."""
    if d.code in ("unsatisfiable-precondition", "unbounded-variable"):
        raise CompileError(d)
    advice = 'reset needs a state: reset(options={"state": {...}})'
    return warning(d.code, d.title, d.span, d.label, advice, d.notes)


def _lowered(problem: Problem, options: Options) -> tuple["Model", "Model"]:
    """The model, and the model whose initial states are drawn: there the default bound limits variables.

    They start inside it and may leave it, so it is no limit of observations; constants keep it.
    """
    from dl2c.interval.bounded import bounded

    model = lower(problem, options)
    if options.default_bound is None:
        return model, model
    drawn = bounded(model, options.default_bound)
    return replace(model, constants=drawn.constants), drawn


def _refused(refused: "Refused") -> Diagnostic:
    return error(
        "flow-not-exact",
        "this differential equation cannot be integrated as asked",
        refused.span,
        refused.reason,
        refused.help,
    )


def _build(problem: Problem, options: Options, key: str, folder: Path, say: Progress) -> None:
    """Fill a folder with everything that `dl2c build` writes."""
    from dl2c.emit.names import file_stem
    from dl2c.emit.simulator.model_c import model_sources
    from dl2c.native.compile import compile_library
    from dl2c.native.describe import manifest_of
    from dl2c.native.host import host
    from dl2c.native.sundials import find_sundials
    from dl2c.native.toolchain import find_compiler

    environment, warnings = _environment(problem, options, say)
    say("writing C")
    stem, sources = file_stem(environment.model.name), model_sources(environment)
    say("compiling C")
    numeric = any(f.kernel == "cvodes" or f.stiff for f in environment.flows)
    sundials = find_sundials(options.sundials, find_compiler()) if numeric else None
    compile_library(sources, stem, folder, native=options.native, sundials=sundials)
    solver = {} if sundials is None else {"solver": sundials.version}
    manifest = manifest_of(environment, key, host() | solver)
    (folder / "manifest.json").write_text(manifest.to_json(), encoding="utf-8")
    (folder / "model.ir").write_text(print_model(environment.model), encoding="utf-8")
    stored = [as_stored(w) for w in warnings]
    (folder / "warnings.json").write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
