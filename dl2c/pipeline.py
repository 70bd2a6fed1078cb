"""The way from a model's text to a loaded library, as one value whose stages are computed once.

source --parsed--> entry --resolved--> problem --lowered--> step model --planned--> paths, flows, sampler
  --emitted--> C --loaded--> library
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial, reduce, wraps
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from dl2c.configuration import resolve_options as resolve_options  # noqa: PLC0414 # is a name of this module too
from dl2c.diagnostics import CompileError, Diagnostic, as_stored, in_source_order, warning
from dl2c.ir.model import LARGEST_STATE, TRUE
from dl2c.ir.printer import print_model
from dl2c.lower.doubts import program_warnings
from dl2c.lower.problem import lower
from dl2c.native.built import WARNINGS, Compiled, Reading, loaded
from dl2c.native.cache import build_key, cached, inspected_key
from dl2c.options import Options, UnknownOption, as_words
from dl2c.parse.printer import print_formula, print_source
from dl2c.parse.tree import And, Archive, Entry
from dl2c.progress import LOG, Progress, silent, stage
from dl2c.resolve.episode import completed, deprecated_values
from dl2c.resolve.problem import Problem, expansion, resolve
from dl2c.resolve.unreadable import entry_of, read_file
from dl2c.source import Source, Span
from dl2c.version import __version__
from dl2c.work import at_place, budgeted

if TYPE_CHECKING:
    from dl2c.emit.claim import Claim
    from dl2c.emit.monitor.monitor_h import Unit
    from dl2c.emit.plan import BuildPlan
    from dl2c.flows.kernel import FlowPlan
    from dl2c.ir.model import Model
    from dl2c.native.manifest import Manifest
    from dl2c.native.sundials import Sundials
    from dl2c.paths.path import Paths
    from dl2c.sampling.plan import NoSampler
    from dl2c.sampling.tables import SamplingPlan
    from dl2c.smt.precondition import Decision

ANY = (-LARGEST_STATE, LARGEST_STATE)
"""A default bound that limits nothing."""

STAGES = ("tree", "expanded", "ir", "paths", "c", "gym")

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Parsed:
    """The entry that the options name."""

    entry: Entry
    warnings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True)
class Resolved:
    """The entry with every name bound, and the options completed by its `@episode`."""

    problem: Problem
    options: Options
    warnings: tuple[Diagnostic, ...]


@dataclass(frozen=True, slots=True)
class Lowered:
    """The step model, and the model whose initial states are drawn: there the default bound limits variables.

    They start inside it and may leave it, so it is not a limit of observations; constants keep it.
    """

    model: "Model"
    drawn: "Model"


@dataclass(frozen=True, slots=True)
class Planned:
    """Everything that code is generated from."""

    build: "BuildPlan"
    warnings: tuple[Diagnostic, ...]


def _stage(name: str = "", after: str = "") -> "Callable[[Callable[[Compilation], _T]], cached_property[_T]]":
    """A stage that is computed within the budget of work when the stage `after` is there, and kept."""

    def decorated(compute: "Callable[[Compilation], _T]") -> "cached_property[_T]":
        @wraps(compute)
        def run(self: "Compilation") -> _T:
            with budgeted():
                if after:
                    getattr(self, after)
                at_place(self.place)
                if not name:
                    return compute(self)
                with stage(name, self.progress):
                    return compute(self)

        return cached_property(run)

    return decorated


class Compilation:
    """A model on its way. A stage raises `CompileError` for the errors that it finds, or for work that takes
    too long. `model` is a text, or one entry of an archive without what is wrong with the archive around it.
    """

    def __init__(self, model: Source | Entry, options: Options) -> None:
        self.given = options
        self.progress: Progress = silent
        self._model = model

    @property
    def place(self) -> Span:
        """What is compiled: the problem of the entry, once that is known."""
        entry = self.__dict__["parsed"].entry if "parsed" in self.__dict__ else self._model
        return entry.problem.span if isinstance(entry, Entry) else entry.start

    @_stage("reading the model")
    def read(self) -> tuple[Archive, tuple[Diagnostic, ...]]:
        """All entries, and the warnings of the parser."""
        if isinstance(self._model, Entry):
            return Archive((self._model,), span=self._model.span), ()
        return read_file(self._model, self.given.entry)

    @_stage(after="read")
    def parsed(self) -> Parsed:
        """The entry that the options name."""
        archive, warnings = self.read
        if isinstance(self._model, Entry):
            return Parsed(self._model, warnings)
        return Parsed(entry_of(archive, self.given.entry), warnings)

    @_stage("resolving names", after="parsed")
    def resolved(self) -> Resolved:
        """Every name bound, definitions expanded, and the options complete."""
        problem = resolve(self.parsed.entry, self.given.loop)
        options = self.given if problem.episode is None else completed(self.given, problem.episode)
        warnings = (*self.parsed.warnings, *problem.warnings, *deprecated_values(problem))
        return Resolved(problem, replace(options, given=frozenset()), warnings)

    @_stage("lowering", after="resolved")
    def lowered(self) -> Lowered:
        """The step model."""
        from dl2c.interval.bounded import bounded

        options = self.resolved.options
        model = lower(self.resolved.problem, options)
        if options.default_bound is None:
            return Lowered(model, model)
        drawn = bounded(model, options.default_bound)
        return Lowered(replace(model, constants=drawn.constants), drawn)

    @_stage("lowering", after="resolved")
    def unbounded(self) -> "Model":
        """The step model, whether or not an environment can be made of it: its names need no bounds."""
        options = self.resolved.options
        return lower(self.resolved.problem, replace(options, default_bound=options.default_bound or ANY))

    @_stage("enumerating paths", after="lowered")
    def paths(self) -> "Paths":
        """The control paths of a step."""
        from dl2c.paths.enumerate import enumerate_paths

        return enumerate_paths(self.lowered.model, self.resolved.options.default_bound)

    @_stage("planning flows", after="paths")
    def flows(self) -> "tuple[FlowPlan, ...]":
        """How every flow is followed."""
        from dl2c.paths.flow_plans import flow_plans

        return flow_plans(self.lowered.model, self.paths, self.resolved.options)

    @_stage("deciding the precondition", after="flows")
    def decision(self) -> "Decision":
        """Whether there are initial states."""
        from dl2c.smt.precondition import decide

        return decide(self.lowered.drawn)

    @_stage("planning initial states", after="decision")
    def sampling(self) -> "SamplingPlan | NoSampler":
        """How initial states are drawn, or why they cannot be."""
        from dl2c.sampling.plan import plan_sampling

        return plan_sampling(self.lowered.drawn, decision=self.decision)

    @_stage(after="sampling")
    def planned(self) -> Planned:
        """Everything together, with the monitor of every step where there is one."""
        from dl2c.emit.plan import BuildPlan
        from dl2c.sampling.plan import NoSampler

        drawn = None if isinstance(self.sampling, NoSampler) else self.sampling
        warnings = program_warnings(self.lowered.model)
        if isinstance(self.sampling, NoSampler):
            warnings += (_not_sampled(self.sampling.diagnostic),)
        monitor, missing = self._monitor()
        build = BuildPlan(
            self.lowered.model, self.paths, self.flows, drawn, self.resolved.options, __version__, monitor
        )
        return Planned(build, warnings + missing)

    def _monitor(self) -> tuple["Unit | None", tuple[Diagnostic, ...]]:
        """The monitor that is exported, where every step is monitored; why it lacks some checks."""
        options = self.resolved.options
        if not options.monitor_every_step:
            return None, ()
        from dl2c.emit.monitor.monitor_h import Unit
        from dl2c.lower.invariant import invariant
        from dl2c.monitor.build import monitor_of

        with stage("making the monitor", self.progress):
            proved = invariant(self.resolved.problem) or TRUE
            model, bound = self.lowered.model, options.default_bound
            made, missing = monitor_of(model, invariant=proved, default_bound=bound)
        return Unit(made, squash=options.action_map == "squash"), missing

    def emitted(self, claim: "Claim") -> dict[str, str]:
        """The generated files by name."""
        from dl2c.emit.simulator.model_c import model_sources

        build = self.planned.build.claiming(claim)
        with budgeted(), stage("writing C", self.progress):
            at_place(self.place)
            return model_sources(build)

    def claim(self) -> "Claim":
        """What the model claims, with what is known of it at this moment."""
        from dl2c.emit.claim import Claim
        from dl2c.verify.results import status

        loop = self.resolved.problem.shape.loop
        invariants = () if loop is None else loop.invariants
        text = print_formula(reduce(And, invariants)) if invariants else ""
        claim = Claim(self.parsed.entry.name, " ".join(text.split()))
        if isinstance(self._model, Entry):
            return claim
        return replace(claim, known=str(status(self._model, self.given, self.parsed.entry)))

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """All that a build warns of."""
        return in_source_order((*self.resolved.warnings, *self.planned.warnings))

    def load(self, inspect: bool = False) -> Compiled:
        """The library, built or taken from the cache; `inspect` adds the calls of dl2c_inspect.h. Raises
        `NativeError` where C cannot be compiled.
        """
        source = self._model
        assert isinstance(source, Source)
        reading = Reading(as_words(self.resolved.options), self.resolved.warnings)
        self.progress("looking for an earlier build")
        claim = self.claim()
        key = self._key(claim)
        build = partial(self._build, key, claim=claim, inspect=inspect)
        kept = inspected_key(key) if inspect else key
        compiled = cached(kept, build, lambda folder: loaded(folder, source, reading.warnings))
        reading.keep(source, self.given)
        LOG.info("files: %s", compiled.directory)
        return compiled

    def _key(self, claim: "Claim") -> str:
        source = self.place.source
        return build_key({source.file_name: source.text}, as_words(self.resolved.options), claim.known)

    def manifest(self) -> "Manifest":
        """What a build would say of itself; no C is written or compiled. Raises what `load` raises."""
        with budgeted():
            claim = self.claim()
            return self._manifest(self._key(claim), claim)

    def _manifest(self, key: str, claim: "Claim") -> "Manifest":
        from dl2c.native.describe import manifest_of
        from dl2c.native.toolchain import host

        solver = {} if self._sundials is None else {"solver": self._sundials.version}
        return manifest_of(self.planned.build.claiming(claim), key, host() | solver)

    @_stage(after="planned")
    def _sundials(self) -> "Sundials | None":
        """The solver of flows without a closed form, if there are any."""
        from dl2c.native.sundials import find_sundials
        from dl2c.native.toolchain import find_compiler

        if not any(f.kernel == "cvodes" or f.stiff for f in self.planned.build.flows):
            return None
        return find_sundials(self.resolved.options.sundials, find_compiler())

    def _build(self, key: str, folder: Path, claim: "Claim", inspect: bool) -> None:
        """Fill a folder with everything that `dl2c build` writes."""
        from dl2c.emit.names import file_stem
        from dl2c.native.compile import compile_library

        sources, options = self.emitted(claim), self.resolved.options
        model = self.lowered.model
        with stage("compiling C", self.progress):
            name, sundials = file_stem(model.name), self._sundials
            library = partial(compile_library, native=options.native, debug=options.debug, keep=True)
            library(sources, name, folder, sundials=sundials, inspect=inspect)
        manifest = self._manifest(key, claim)
        (folder / "manifest.json").write_text(manifest.to_json(), encoding="utf-8")
        (folder / "model.ir").write_text(print_model(model), encoding="utf-8")
        stored = [as_stored(w) for w in self.planned.warnings]
        (folder / WARNINGS).write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


@lru_cache(maxsize=4)
def compilation(source: Source, options: Options) -> Compilation:
    """The compilation of a model; whoever asks again for one of the last few gets the same."""
    return Compilation(source, options)


@budgeted()
def compile_model(
    source: Source, options: Options, *, progress: Progress = silent, inspect: bool = False
) -> Compiled:
    """Build a model, or take it from the cache, and load it; `inspect` as in `Compilation.load`.

    Raises `CompileError` for a mistake in the model, `NativeError` where C cannot be compiled.
    """
    found = compilation(source, options)
    found.progress = progress
    try:
        return found.load(inspect)
    finally:
        found.progress = silent


@budgeted()
def check_model(source: Source, options: Options) -> tuple[Diagnostic, ...]:
    """The warnings that a build gives. Raises `CompileError` for a model's errors."""
    return compilation(source, options).warnings


@budgeted()
def emit(source: Source, stage: str, options: Options, pure_python: bool = False) -> str:
    """One stage of the pipeline as text; of `gym` also the form that needs no compiler.

    Raises `CompileError`, `UnknownOption` for an unknown stage.
    """
    if stage not in STAGES:
        raise UnknownOption(f"no stage `{stage}`; the stages are {', '.join(STAGES)}")
    if pure_python and stage != "gym":
        raise UnknownOption("`--pure-python` goes with `--stage gym`")
    found = compilation(source, options)
    match stage:
        case "tree":
            return print_source(source)
        case "expanded":
            return print_formula(expansion(found.parsed.entry)) + "\n"
        case "ir":
            return print_model(found.lowered.model)
        case "paths":
            from dl2c.paths.printer import print_paths

            return print_paths(found.planned.build.paths)
        case "gym":
            return _gymnasium_module(source, found.planned.build, pure_python)
        case _:
            return "\n".join(found.emitted(found.claim()).values())


@budgeted()
def step_model(source: Source, options: Options) -> tuple["Model", "Paths"]:
    """What a step of a model does, as data: for those who run it in another way. Raises `CompileError`."""
    found = compilation(source, options)
    return found.lowered.model, found.paths


def _gymnasium_module(source: Source, build: "BuildPlan", pure_python: bool) -> str:
    """The module of an environment, over its library or in plain Python."""
    from dl2c.emit.python.module import gym_module
    from dl2c.emit.python.pure import pure_module
    from dl2c.emit.python.refusal import refusals

    if not pure_python:
        return gym_module(build, source)
    if refused := refusals(build):
        raise CompileError(refused)
    return pure_module(build, source)


def _not_sampled(d: Diagnostic) -> Diagnostic:
    """That resets need a state. Raises `CompileError` where none will do."""
    if d.code in ("unsatisfiable-precondition", "unbounded-variable"):
        raise CompileError(d)
    advice = 'reset needs a state: reset(options={"state": {...}})'
    return warning(d.code, d.title, d.span, d.label, advice, d.notes)
