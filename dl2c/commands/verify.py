"""`dl2c verify`: prove or refute the theorem that a model states, or a claim about a trained policy."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dl2c.commands.arguments import (
    Arithmetic,
    Certificate,
    Check,
    Except,
    Fixed,
    Gives,
    Model,
    Over,
    Picture,
    Resume,
    Takes,
    Trained,
)
from dl2c.commands.failures import CommandError, to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import quiet
from dl2c.commands.waiting import working
from dl2c.diagnostics import CompileError
from dl2c.outputs import check_outputs

if TYPE_CHECKING:
    from rich.console import Console

    from dl2c.commands.policy import Asked
    from dl2c.emit.monitor.monitor_h import Real
    from dl2c.options import Options
    from dl2c.policy_proof.confirm import Confirmation
    from dl2c.policy_proof.verdict import PolicyReport
    from dl2c.report.episode import Episode
    from dl2c.source import Source
    from dl2c.verify.prove import Limits
    from dl2c.verify.report import Counterexample, Report

CODES = {"proved": 0, "refuted": 1}
"""Exit codes of answers; any other is `UNDECIDED`."""

UNDECIDED = 3

COLOURS = {"proved": "bold green", "refuted": "bold red"}

REALS: dict[str, "Real"] = {"double": "double", "float32": "float"}
"""Numbers of the exported C by the arithmetic that was judged."""

Timeout = Annotated[float, typer.Option(min=0.1, help="Seconds for one question to the solvers.")]
Total = Annotated[float, typer.Option("--total", "--seconds", min=0.5, help="Seconds for everything.")]
Jobs = Annotated[
    int,
    typer.Option(
        min=0, help="Solvers, or threads, that run at the same time; 0: as the machine allows, at most 2."
    ),
]
Within = Annotated[
    bool, typer.Option("--within-bounds", help="The exit code is for runs that begin inside the bounds.")
]
Agree = Annotated[
    bool, typer.Option("--agree", help="Ask every solver; a contradiction is an internal error.")
]
Questions = Annotated[
    Path | None, typer.Option("--smt2", metavar="DIR", help="Write every question as an SMT-LIB file.")
]
Output = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="JSON",
        help="File for the run, or the request of a policy, that refutes the claim, if the environment can "
        "follow it: an episode for `dl2c replay`.",
    ),
]


def verify(
    model: Model,
    timeout: Timeout = 10.0,
    total: Total = 60.0,
    jobs: Jobs = 0,
    within_bounds: Within = False,
    agree: Agree = False,
    smt2: Questions = None,
    policy: Trained = None,
    arithmetic: Arithmetic = None,
    except_: Except = None,
    fix: Fixed = None,
    takes: Takes = None,
    gives: Gives = None,
    certificate: Certificate = None,
    check: Check = None,
    resume: Resume = None,
    picture: Picture = None,
    over: Over = None,
    output: Output = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Prove the theorem that a model states, or find a run that shows that it is false.

    With --policy: prove that a trained policy asks for nothing that the model does not admit.
    Exit code 0: proved. 1: refuted, or a mistake in the model. 3: anything else.
    """
    jobs = jobs or min(2, os.cpu_count() or 1)
    said = _given(arithmetic=arithmetic, outside=except_, fixed=fix, inputs=takes, outputs=gives)
    said |= _given(certificate=certificate, resume=resume, picture=picture, over=over)
    if policy is not None:
        if within_bounds or agree or smt2 is not None:
            raise CommandError("--within-bounds, --agree and --smt2 are for theorems, not for --policy")
        said |= {"seconds": total, "threads": jobs}
        if check is not None:
            raise typer.Exit(_checked(model, policy, said, check, options, output, json))
        raise typer.Exit(_about_policy(model, policy, said, options, output, json))
    if said or check is not None:
        raise CommandError("what is said of a trained policy goes with --policy")
    from dl2c.verify.prove import Limits

    limits = Limits(min(timeout, total), total, jobs, agree, smt2)
    raise typer.Exit(_theorem(model, limits, within_bounds, options, output, json))


def _given(**options: Any) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


def _theorem(
    model: str,
    limits: "Limits",
    within_bounds: bool,
    options: Mapping[str, Any],
    output: Path | None,
    json: bool,
) -> int:
    """Prove the theorem of a model; the exit code."""
    from dl2c.configuration import resolve_options
    from dl2c.env.opening import source_of

    source = source_of(model)
    report = _proved(model, source, resolve_options(options), limits)
    if not json and not quiet():
        _show(report)
    saved = {} if output is None or report.interrupted else _saved(source, options, report, output)
    _tell_saved(report.to_json(), saved, output, json)
    if report.interrupted:
        raise KeyboardInterrupt
    answer = report.within_bounds if within_bounds else report.answer
    return CODES.get(answer, UNDECIDED)


def _checked(
    model: str,
    path: Path,
    asked: Mapping[str, Any],
    certificate: Path,
    options: Mapping[str, Any],
    output: Path | None,
    json: bool,
) -> int:
    """Check a certificate; the exit code."""
    if output is not None or {"certificate", "resume", "picture", "over"} & {*asked}:
        raise CommandError("-o, --certificate, --resume and --picture are for a search, not for --check")
    from dl2c.commands.policy import Asked, checked_certificate

    found = checked_certificate(model, Asked(path, **asked), options, certificate)
    if json:
        print(to_json({"answer": "proved", "leaves": found.leaves, "leaves_by_z3": found.by_solver}))
    elif not quiet():
        print(f"{certificate}: proved, {found.leaves} leaves checked, {found.by_solver} of them by Z3")
    return CODES["proved"]


def _about_policy(
    model: str,
    path: Path,
    given: Mapping[str, Any],
    options: Mapping[str, Any],
    output: Path | None,
    json: bool,
) -> int:
    """Verify a policy; the exit code."""
    from dl2c.commands.policy import Asked, report_on

    asked = Asked(path, **given)
    written = [p for p in (asked.certificate, asked.resume, asked.picture, output) if p is not None]
    check_outputs(written)
    report = _confirmed(model, asked, options, report_on(model, asked, options))
    if not json and not quiet():
        show_policy(report)
    saved: Mapping[str, Any] = {}
    if output is not None and report.violation is None:
        saved = {"episode": None, "not_saved": "no request is refuted"}
    elif output is not None:
        saved = _saved_episode(lambda: _followed_request(model, asked, options, report), "this step", output)
    _tell_saved(report.to_json(), saved, output, json)
    if report.interrupted:
        raise KeyboardInterrupt
    return CODES.get(report.answer, UNDECIDED)


def _confirmed(
    model: str, asked: "Asked", options: Mapping[str, Any], report: "PolicyReport"
) -> "PolicyReport":
    """The report with what the exported C says of its violation, if it has one. Raises `Contradiction` where
    that computes something else, and what writing and compiling it raise.
    """
    if report.violated is None:
        return report
    with working("asking the exported C"):
        return replace(report, confirmation=_confirmation(model, asked, options, report))


def _confirmation(
    model: str, asked: "Asked", options: Mapping[str, Any], report: "PolicyReport"
) -> "Confirmation":
    from dl2c.commands.monitor import unit_of
    from dl2c.commands.policy import policy_for
    from dl2c.policy_proof.confirm import Confirmation, confirmation

    assert report.violated is not None
    if asked.arithmetic not in REALS:
        return Confirmation(False, "the exported C is not asked: it does not compute with real numbers")
    if asked.inputs or asked.outputs:
        return Confirmation(False, "the exported C is not asked: --takes and --gives are not exported")
    policy, options = policy_for(model, asked.path, options, trusted=True)
    try:
        unit = unit_of(model, options, ("controller",), REALS[asked.arithmetic])
        return confirmation(*report.violated, unit, policy)
    except CompileError as refused:
        title = refused.diagnostics[0].title
        return Confirmation(False, f"the exported C is not asked: {title}")


def _followed_request(
    model: str, asked: "Asked", options: Mapping[str, Any], report: "PolicyReport"
) -> "Episode":
    """The step in which the policy asks for what is not admissible. Raises `CannotFollow`."""
    from dl2c.commands.policy import policy_for
    from dl2c.env.opening import source_of
    from dl2c.report.refuted import CannotFollow
    from dl2c.report.refuted_policy import requested

    found, said = report.violation, report.confirmation
    if found is None or said is None or said.state is None:
        raise CannotFollow("the exported C was not asked")
    policy, options = policy_for(model, asked.path, options, trusted=True)
    return requested(source_of(model), options, policy, said.state, found.outputs)


def _proved(model: str, source: "Source", options: "Options", limits: "Limits") -> "Report":
    """The report, which is kept unless it is interrupted."""
    from dl2c.verify.prove import prove_theorem
    from dl2c.verify.results import store
    from dl2c.verify.theorem import theorem_in

    if limits.keep is not None and limits.keep.exists() and not limits.keep.is_dir():
        raise CommandError(f"{limits.keep} is not a folder")
    with working(f"verifying {model}") as note:
        theorem = theorem_in(source, options)
        report = prove_theorem(theorem, limits, note)
    if not report.interrupted:
        store(theorem, report)
    return report


def _saved(
    source: "Source", options: Mapping[str, Any], report: "Report", path: Path
) -> dict[str, str | None]:
    """Write the run that refutes the theorem as an episode, if the environment can follow it; why not."""
    from dl2c.report.refuted import followed

    if (run := report.counterexample) is None:
        return {"episode": None, "not_saved": "no run refutes the theorem"}
    return _saved_episode(lambda: followed(source, options, run), "this run", path)


def _saved_episode(follow: "Callable[[], Episode]", what: str, path: Path) -> dict[str, str | None]:
    """Write the episode that is followed, if the environment can follow it; why not."""
    from dl2c.report.episode import write_episode
    from dl2c.report.refuted import CannotFollow

    try:
        with working(f"following {what} in the environment"):
            episode = follow()
    except CannotFollow as reason:
        return {"episode": None, "not_saved": f"the environment cannot follow {what}: {reason}"}
    write_episode(episode, path)
    return {"episode": str(path), "not_saved": None}


def _tell_saved(report: Mapping[str, Any], saved: Mapping[str, Any], output: Path | None, json: bool) -> None:
    """Print the report with what became of the episode, or what became of that alone."""
    if json:
        print(to_json({**report, **saved}))
    elif saved and not quiet():
        path, reason = saved["episode"], saved["not_saved"]
        print(f"replay it with `dl2c replay {path}`" if path else f"{output} is not written: {reason}")


def _show(report: "Report") -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    width = max((22, *(len(o.title) for o in report.obligations)))
    for o in report.obligations:
        rules = (
            f"  by {', '.join((*o.rules, *o.solvers))}" if o.answer.startswith("proved") and o.solvers else ""
        )
        line = Text(f"{o.title:{width}} ").append(f"{o.answer:18}", COLOURS.get(o.answer, "yellow"))
        console.print(line.append(f"{o.seconds:6.1f} s  {o.place.place}{rules}"))
        if o.reason:
            console.print(f"    {o.reason}")
        if o.counterexample is not None and o.kind != "program":
            _show_run(console, o.counterexample, "    ")
    for number, text in enumerate(report.invariants if report.invented else (), 1):
        console.print(f"{'found invariant:' if number == 1 else '':16} {' '.join(text.split())}")
    for warning in report.warnings:
        console.print(f"warning: {warning}")
    if report.counterexample is not None:
        _show_run(console, report.counterexample)
    console.print(Text("theorem: ").append(report.answer, COLOURS.get(report.answer, "yellow")))
    if report.within_bounds != report.answer:
        console.print(
            Text("within bounds: ").append(report.within_bounds, COLOURS.get(report.within_bounds, "yellow"))
        )
    if report.answer == "proved":
        console.print(f"  {report.basis}")


def _show_run(console: "Console", run: "Counterexample", margin: str = "") -> None:
    state = ", ".join(f"{name} = {value}" for name, value in run.state.items())
    console.print(f"{margin}a run from  {state}")
    for name, value in run.decisions:
        console.print(f"{margin}            {name}: {value}")
    console.print(f"{margin}violates    {run.violated}")


def show_policy(report: "PolicyReport") -> None:
    """The report about a policy, for readers."""
    from rich.console import Console
    from rich.text import Text

    from dl2c.policy_proof.verdict import decimal, percent

    console = Console(highlight=False, soft_wrap=True)
    boxes, solved = sum(f.boxes for f in report.found), sum(f.by_solver for f in report.found)
    line = Text("admissible  ").append(f"{report.answer:12}", COLOURS.get(report.answer, "yellow"))
    by = f", {solved} of them by Z3" if solved else ""
    console.print(line.append(f"{report.seconds:6.1f} s  {boxes} boxes{by}"))
    for name in ("kept", "for ever"):
        said = report.claims[name]
        console.print(Text(f"{name:12}").append(said, COLOURS.get(said, "yellow")))
    for covers in report.covers:
        console.print(f"states: {covers}")
    console.print(f"numbers of the policy: {report.arithmetic}")
    if report.answer == "unknown":
        reasons = "; ".join(dict.fromkeys(f.reason for f in report.found if f.reason))
        console.print(f"decided: {percent(report.share)} of the volume, {reasons}")
        for box in [b for f in report.found for b in f.open_boxes][:3]:
            console.print("open: " + ", ".join(f"{n} in [{a!r}, {b!r}]" for n, (a, b) in box.items()))
    if report.violated is not None:
        question, found = report.violated
        console.print("in the state  " + ", ".join(f"{n} = {decimal(v)}" for n, v in found.state.items()))
        if question.lead:
            decided = ", ".join(f"{key} = {alternative}" for key, alternative in question.lead)
            console.print(f"the environment takes  {decided}")
        asked = "" if question.shares else ", ".join(f"{n} = {decimal(v)}" for n, v in found.requests.items())
        choices = f"({found.about})" if asked and found.about else found.about
        if asked or choices:
            console.print(f"it asks for   {' '.join(filter(None, (asked, choices)))}")
        console.print(f"which no control path admits{', whatever the values' if question.shares else ''}")
    if (said := report.confirmation) is not None:
        console.print(f"{'confirmed' if said.confirmed else 'not confirmed'}: {said.text}")
    for warning in report.warnings:
        console.print(f"warning: {warning}")
