"""Trained policies: read, held against the model that they are for, and what is proved of them."""

import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from dl2c.commands.failures import CommandError
from dl2c.commands.verbosity import quiet
from dl2c.commands.waiting import working
from dl2c.diagnostics import CompileError
from dl2c.env.interface import interface_of
from dl2c.env.opening import Model, compilation_of
from dl2c.native.describe import manifest_of
from dl2c.native.manifest import Manifest
from dl2c.options import UnknownOption, exact_number
from dl2c.outputs import write_output
from dl2c.policy.files import read_policy
from dl2c.policy.network import (
    Activation,
    Interface,
    Layer,
    Network,
    NetworkPolicy,
    PolicyError,
    checked,
    mismatch,
)
from dl2c.policy.onnx_files import read_onnx
from dl2c.training.saved import found_policy, load_policy
from dl2c.work import budgeted

if TYPE_CHECKING:
    from dl2c.parse.tree import Entry
    from dl2c.pipeline import Compilation
    from dl2c.policy_proof.acting import Acting
    from dl2c.policy_proof.build import Claim
    from dl2c.policy_proof.certificate import Checked
    from dl2c.policy_proof.onward import Onward
    from dl2c.policy_proof.question import Question
    from dl2c.policy_proof.verdict import PolicyReport

INTERFACE = (
    *("action_format", "action_map", "obs_dtype", "observation_bounds", "observe_constants", "constants"),
    *("default_bound", "duration", "max_repeat", "loop", "entry"),
)
"""Options on which it depends what a policy sees and how it acts."""


def policy_for(
    model: Model, path: Path, options: Mapping[str, Any], *, trusted: bool = False
) -> tuple[NetworkPolicy, Mapping[str, Any]]:
    """The policy at a path, and the options of the environment that it acts in: those given over those it
    was trained with. Where it is `trusted`, nothing warns of code that loading it executes. Raises
    `PolicyError`, `OSError`, and what checking the model raises.
    """
    file, statistics = found_policy(path)
    if file.suffix == ".onnx":
        manifest = _manifest(model, options)
        return _from_onnx(file, manifest), options
    if file.suffix == ".json":
        policy = read_policy(file)
        saved = {n: v for n, v in policy.options.items() if n in INTERFACE and v is not None}
        options = saved | dict(options)
        manifest = _manifest(model, options)
    else:
        if not trusted:
            _warn(file, statistics)
        manifest = _manifest(model, options)
        policy = load_policy(file, statistics, manifest)
    if problem := mismatch(policy, manifest.name, interface_of(manifest)):
        raise PolicyError(f"{file}: {problem}")
    return policy, options


def _from_onnx(file: Path, manifest: Manifest) -> NetworkPolicy:
    """A network as a policy of the environments of a model: its outputs are what actions are made of."""
    read, interface = read_onnx(file), interface_of(manifest)
    if read.clip is not None and interface.kind != "box":
        raise PolicyError(f"{file} clips its outputs, of which the largest counts")
    if read.clip is not None and any(
        read.clip[0] > low or read.clip[1] < high
        for low, high in zip(interface.low, interface.high, strict=True)
    ):
        raise PolicyError(f"{file} clips its outputs to less than the limits of actions")
    return checked(NetworkPolicy(manifest.name, interface, read.network, False, manifest.options))


def _warn(file: Path, statistics: Path | None) -> None:
    """What is loaded with pickle may do anything."""
    if not quiet():
        what = file.name if statistics is None else f"{file.name} and {statistics.name}"
        advice = "load only files that you trust, or the policy.json that `dl2c train` writes"
        print(f"warning: loading {what} executes code that is in it; {advice}", file=sys.stderr)


def _manifest(model: Model, options: Mapping[str, Any]) -> Manifest:
    """What the environment of a model is, without building it."""
    return manifest_of(compilation_of(model, options).planned.build, "", {})


# Verification -----------------------------------------------------------------------------------

MOST = 1e30
"""Of limits of outputs."""

ONWARD = 1 / 30, 10.0
"""For each claim that follows of admissible requests: at least this share of all seconds, at most so many."""


@dataclass(frozen=True, slots=True)
class Asked:
    """What the command line says of a policy: `inputs` and `outputs` are what an ONNX network's numbers mean,
    `outside` is where nothing is claimed, `fixed` are NAME=VALUE. `picture` is drawn `over` X,Y.
    """

    path: Path
    arithmetic: str = "double"
    inputs: str = ""
    outputs: Sequence[str] = ()
    outside: str = ""
    fixed: Sequence[str] = ()
    seconds: float = 60.0
    threads: int = 2
    certificate: Path | None = None
    resume: Path | None = None
    picture: Path | None = None
    over: str = ""


def report_on(model: str, asked: Asked, options: Mapping[str, Any]) -> "PolicyReport":
    """Everything that is found out. Raises `CommandError`, `CompileError`, `PolicyError`, `NativeError`."""
    from dl2c.policy_proof.build import questions

    with working(f"verifying {asked.path}") as note:
        entry, claim, policy = _prepared(model, asked, options)
        about = questions(claim, policy)
        names = _pictured(asked, about)
        report = _verified(entry, claim, about, asked, note)
    if asked.resume is not None and report.answer != "refuted":
        write_output(asked.resume, report.unfinished)
    if asked.certificate is not None and report.answer == "proved":
        write_output(asked.certificate, report.certificate)
    if asked.picture is not None:
        from dl2c.picture.boxes import proof_figure
        from dl2c.picture.figure import save

        save(proof_figure(claim.model, report.questions, report.found, names), asked.picture)
    return report


def _pictured(asked: Asked, about: "Sequence[Question]") -> Sequence[str]:
    """The names over which a picture is asked for; none where that is open, or no picture is. Raises
    `CommandError`, `PolicyError`, `OSError`.
    """
    if asked.picture is None:
        if asked.over:
            raise CommandError("--over says what --picture FILE shows: give both")
        return ()
    from dl2c.picture.figure import check_format
    from dl2c.policy_proof.plane import axes_named

    check_format(asked.picture)
    return axes_named(about, asked.over)


def _verified(
    entry: "Entry",
    claim: "Claim",
    about: "tuple[Question, ...]",
    asked: Asked,
    note: Callable[[str], None],
) -> "PolicyReport":
    from dl2c.policy_proof.search import Limits
    from dl2c.policy_proof.verdict import verified

    limits = Limits(asked.seconds, asked.threads, note)
    report = verified(claim, about, limits, (claim.model.name, str(asked.path)), asked.resume)
    if report.answer != "proved":
        return report
    return replace(report, onward=_onward(entry, claim, asked, report.seconds))


def verifier(
    model: str, asked: Asked, options: Mapping[str, Any], network: Callable[[Interface], Network]
) -> "Callable[[NetworkPolicy], PolicyReport]":
    """What verifies one policy after another of a model, all of the form of `network`. Raises what
    `report_on` raises about any of them, and what a teacher of them raises.
    """
    from dl2c.policy_proof.acting import acting
    from dl2c.policy_proof.build import questions
    from dl2c.policy_proof.question import NotCovered
    from dl2c.policy_proof.tables import tables_of
    from dl2c.training.lessons import Teacher

    found = compilation_of(model, options)
    if found.resolved.options.action_map == "squash":
        raise NotCovered("it is taught values, not shares of what is admissible (action_map=squash)")
    claim = _claim(found, asked)
    about = questions_of(model, asked, options, network)[1]
    for question in about:
        tables_of(question)
    found_some = [Teacher(question, np.random.default_rng(0)).finds_states() for question in about]
    if not any(found_some):
        raise NotCovered("no state of what is assumed is found by drawing, in which it could be taught")

    def verify(policy: NetworkPolicy) -> "PolicyReport":
        about = questions(claim, acting(policy.interface, policy.network))
        return _verified(found.parsed.entry, claim, about, asked, lambda _: None)

    return verify


def blank(interface: Interface, hidden: Sequence[int], activation: Activation) -> Network:
    """A network that always gives zeros, with hidden layers of these sizes."""
    sizes = (len(interface.observations), *hidden, interface.outputs)
    names: tuple[Activation, ...] = (*(activation for _ in hidden), "identity")
    pairs = zip(pairwise(sizes), names, strict=True)
    return Network((), tuple(Layer(np.zeros((m, n)), np.zeros(m), name) for (n, m), name in pairs))


def questions_of(
    model: str,
    asked: Asked,
    options: Mapping[str, Any],
    network: Callable[[Interface], Network] | None = None,
) -> "tuple[str, tuple[Question, ...]]":
    """The model's name and what is asked of the policy, or of a network that is made for the model. Raises
    what `report_on` raises.
    """
    from dl2c.policy_proof.acting import acting
    from dl2c.policy_proof.build import questions

    if network is None:
        _, claim, acts = _prepared(model, asked, options)
    else:
        interface = interface_of(_manifest(model, options))
        claim = _claim(compilation_of(model, options), asked)
        acts = acting(interface, network(interface))
    return claim.model.name, questions(claim, acts)


def checked_certificate(model: str, asked: Asked, options: Mapping[str, Any], path: Path) -> "Checked":
    """How much of a certificate there is, all of which is right. Raises `CertificateError`, and what
    `report_on` raises.
    """
    from dl2c.policy_proof.certificate import check

    with working(f"checking {path}"):
        return check(path, questions_of(model, asked, options)[1])


def _onward(entry: "Entry", claim: "Claim", asked: Asked, seconds: float) -> "Onward":
    """What follows of admissible requests, found in the seconds that are left, or a few."""
    from dl2c.policy_proof.onward import onward
    from dl2c.verify.prove import Limits

    least, most = ONWARD
    total = min(max((asked.seconds - seconds) / 3, least * asked.seconds), most)
    return onward(entry, claim.model, claim.values, Limits(total, total, asked.threads))


@budgeted()
def _prepared(model: str, asked: Asked, options: Mapping[str, Any]) -> "tuple[Entry, Claim, Acting]":
    from dl2c.policy_proof.acting import acting

    if asked.outputs or asked.inputs:
        found = compilation_of(model, options)
        policy = _mapped(found, asked)
    else:
        trained, options = policy_for(model, asked.path, options)
        found = compilation_of(model, options)
        policy = acting(trained.interface, trained.network)
    return found.parsed.entry, _claim(found, asked), policy


def _claim(found: "Compilation", asked: Asked) -> "Claim":
    """What is claimed of any policy of a model."""
    from dl2c.ir.model import TRUE
    from dl2c.policy_proof.build import claim_of, outside_of
    from dl2c.policy_proof.question import Arithmetic

    arithmetics: dict[str, Arithmetic] = {name: name for name in get_args(Arithmetic)}
    if asked.arithmetic not in arithmetics:
        raise CommandError(f"no arithmetic {asked.arithmetic!r}; there is {', '.join(arithmetics)}")
    outside = outside_of(_formula(found, asked.outside)) if asked.outside else TRUE
    fixed = _fixed(found, asked.fixed)
    arithmetic = arithmetics[asked.arithmetic]
    return claim_of(found.resolved.problem, found.unbounded, outside, fixed, arithmetic)


def _formula(found: "Compilation", text: str) -> Any:
    """A condition over the names of the model, its definitions expanded."""
    from dl2c.lower.problem import scope_of
    from dl2c.lower.terms import lower_formula
    from dl2c.parse.parser import parse_formula
    from dl2c.resolve.bind import check
    from dl2c.resolve.expand import NONE, Expander
    from dl2c.resolve.fragment import not_executable
    from dl2c.source import Source

    problem = found.resolved.problem
    written = parse_formula(Source("--except", text))
    if wrong := list(check(written, problem.symbols, frozenset())):
        raise CompileError(wrong)
    expander = Expander(problem.symbols)
    expanded = expander.formula(written, {}, NONE)
    if expander.found or not_executable((expanded,)):
        raise CommandError(f"--except {text!r} is not a condition that can be evaluated")
    return lower_formula(expanded, scope_of(problem))


def _fixed(found: "Compilation", texts: Sequence[str]) -> dict[str, Fraction]:
    model = found.unbounded
    bounds = {v.name: v.bound for v in model.variables} | {c.name: c.bound for c in model.constants}
    given = {c.name: c.value for c in model.constants if c.value is not None}
    fixed: dict[str, Fraction] = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if name not in bounds:
            raise CommandError(f"--fix {text}: the model has no name `{name}`")
        try:
            number = exact_number("--fix", value)
        except UnknownOption:
            raise CommandError(f"--fix takes NAME=VALUE, not {text!r}") from None
        if fixed.setdefault(name, number) != number or given.get(name, number) != number:
            raise CommandError(f"--fix {text}: `{name}` has another value already")
        low, high = bounds[name].low, bounds[name].high
        if (low is not None and fixed[name] < low) or (high is not None and fixed[name] > high):
            raise CommandError(f"--fix {text} is outside the bounds of `{name}`")
    return fixed


def _mapped(found: "Compilation", asked: Asked) -> "Acting":
    """A network whose numbers are names of the model: observed values, and values of variables."""
    from dl2c.policy_proof.acting import Acting

    if asked.path.suffix != ".onnx":
        raise CommandError("--takes and --gives are for ONNX files; others say themselves what they mean")
    read = read_onnx(asked.path)
    known = {v.name for v in found.unbounded.variables}
    shown = [v.name for v in found.unbounded.variables if v.observed]
    inputs = [n.strip() for n in asked.inputs.split(",")] if asked.inputs else shown
    if len(inputs) != read.inputs:
        raise CommandError(f"the network takes {read.inputs} numbers; --takes names {len(inputs)}")
    outputs = [_output(text, read.clip) for text in asked.outputs]
    if len(outputs) != len(read.network.layers[-1].bias):
        gives = len(read.network.layers[-1].bias)
        raise CommandError(f"the network gives {gives} numbers; --gives names {len(outputs)}")
    if unknown := [name for name, _, _ in outputs if name not in known]:
        raise CommandError(f"--gives: the model has no variable `{unknown[0]}`")
    observations = tuple((name, float("-inf"), float("inf")) for name in inputs)
    names, low, high = zip(*outputs, strict=True)
    if twice := [name for name, times in Counter(names).items() if times > 1]:
        raise CommandError(f"--gives names `{twice[0]}` more than once")
    if read.clip is not None and (read.clip[0] > min(low) or read.clip[1] < max(high)):
        raise CommandError(f"{asked.path} clips its outputs to less than --gives says")
    return Acting(observations, False, read.network, variables=names, low=low, high=high)


def _output(text: str, clip: tuple[float, float] | None) -> tuple[str, float, float]:
    """NAME=LOW:HIGH, or NAME where the network clips itself."""
    name, given, ends = text.partition("=")
    low, _, high = ends.partition(":")
    try:
        limits = (float(low), float(high)) if given else clip
    except ValueError:
        limits = None
    if limits is None or not -MOST < limits[0] < limits[1] < MOST:
        raise CommandError(f"--gives takes NAME=LOW:HIGH, the limits that it is clipped to, not {text!r}")
    return name.strip(), *limits
