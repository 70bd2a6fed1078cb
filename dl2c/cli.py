"""The command `dl2c`.

Results go to stdout, messages and progress bars to stderr. Exit codes: see `commands.failures`;
2 for a wrong command line. Started by `__main__.py`.
"""

import os
import shutil
import sys
from collections.abc import Mapping
from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dl2c.commands.arguments import Model, Seed
from dl2c.commands.cache import app as cache_app
from dl2c.commands.completion import words
from dl2c.commands.failures import as_json, report, show, to_json
from dl2c.commands.falsify import falsify
from dl2c.commands.flags import Json, model_options
from dl2c.commands.monitor import monitor
from dl2c.commands.play import play
from dl2c.commands.replay import replay
from dl2c.commands.report import report as report_command
from dl2c.commands.rollout import rollout
from dl2c.commands.train import train
from dl2c.commands.verbosity import begin, quiet, talkative
from dl2c.commands.verify import verify
from dl2c.commands.waiting import working
from dl2c.interruption import INTERRUPTED, was_asked
from dl2c.lsp.command import lsp
from dl2c.outputs import output_folder, write_output
from dl2c.version import __version__

if TYPE_CHECKING:
    from dl2c.native.built import Kept

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="Compile KeYmaera X models with RL annotations to native environments.",
)

INTERNAL = ("sealed.json", "warnings.json")
"""Files of a cache entry that concern nobody else."""

app.add_typer(cache_app, name="cache")

Stage = Annotated[
    str,
    typer.Option(
        metavar="tree|expanded|ir|paths|c|gym",
        help="Which stage of the pipeline.",
        autocompletion=words("tree", "expanded", "ir", "paths", "c", "gym"),
    ),
]


def main() -> None:
    """Run the command line; the only place where exceptions become messages and exit codes.

    Raises `SystemExit`, and `KeyboardInterrupt` for Ctrl-C.
    """
    begin()
    try:
        code = _run()
        sys.stdout.flush()
    except Exception as failure:
        if was_asked():  # what a library made of it
            raise KeyboardInterrupt from None
        code = report(failure)
        _leave_stdout()
    raise SystemExit(code)


def _run() -> int | str | None:
    try:
        _asked_for(sys.argv[1:])(prog_name="dl2c")
    except SystemExit as done:
        if done.code == INTERRUPTED:
            raise KeyboardInterrupt from None
        return done.code
    return 0


def _asked_for(words: list[str]) -> typer.Typer:
    """The command line with the one command that these words begin with, where they do: to make all commands
    ready takes longer than many a command. `--version` needs none.
    """
    first = words[0] if words else ""
    only = [c for c in app.registered_commands if first == (c.name or getattr(c.callback, "__name__", None))]
    if not only and first != "--version":
        return app
    narrow = copy(app)
    narrow.registered_commands, narrow.registered_groups = only, []
    return narrow


def _leave_stdout() -> None:
    """What could not be written is not tried again when Python ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _version(wanted: bool) -> None:
    if wanted:
        print(f"dl2c {__version__}")
        raise typer.Exit


def _list_codes(wanted: bool) -> None:
    if wanted:
        from dl2c.commands.check import table_of_codes

        print(table_of_codes())
        raise typer.Exit


@app.callback()
@talkative
def options_of_dl2c(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Compile KeYmaera X models with RL annotations to native environments."""


@app.command()
@model_options
def build(
    model: Model,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for <model>/, else build; see also --native."),
    ] = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Compile a model and write its C, library and manifest to a folder."""
    from dl2c.emit.names import file_stem

    if output is not None:
        options = {"native": False, **options}  # it may be taken elsewhere
    found = _build(model, options)
    show(found.warnings)
    target = (output or Path("build")) / file_stem(found.manifest.name)
    with output_folder(target) as folder:
        shutil.copytree(found.directory, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns(*INTERNAL))
    files = sorted(path.name for path in found.directory.iterdir() if path.name not in INTERNAL)
    print(to_json({"directory": str(target), "files": files}) if json else target)


@app.command()
@model_options
def check(
    model: Model,
    portable: Annotated[
        bool, typer.Option("--portable", help="What KeYmaera X 5 rejects is an error.")
    ] = False,
    fix: Annotated[bool, typer.Option("--fix", help="Correct in the file what needs no decision.")] = False,
    list_codes: Annotated[
        bool,
        typer.Option("--list-codes", callback=_list_codes, is_eager=True, help="Print what is looked for."),
    ] = False,
    prove_coverage: Annotated[
        bool, typer.Option("--prove-coverage", help="Ask Z3 too whether sampling misses initial states.")
    ] = False,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Report every error and warning in a model, and what it may not mean."""
    from dl2c.commands.check import diagnostics_of, fixed, unverified

    corrections = fixed(model) if fix else 0
    with working(f"checking {model}"):
        found = diagnostics_of(model, options, portable)
    failed = any(d.severity == "error" for d in found)
    if json:
        print(as_json(found))
    else:
        show(found)
    if failed:
        raise typer.Exit(1)
    if not (json or quiet()):
        made = f"{corrections} correction{'s' * (corrections != 1)}, " if fix else ""
        print(f"{model}: {made}no errors, {len(found)} warning{'s' * (len(found) != 1)}")
        if unverified(model, options):
            print(f"whether its theorem holds is not known: `dl2c verify {model}` tries to prove it")
    if prove_coverage:
        from dl2c.commands.sample import report_coverage

        if not report_coverage(model, options, json):
            raise typer.Exit(1)


NO_GOAL = "nothing says what an agent should reach; write `@progress: ...` above a Bool definition that does"


@app.command()
@model_options
def annotate(
    model: Model,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="File to write instead of stdout.", show_default=False),
    ] = None,
    *,
    options: Mapping[str, Any],
) -> None:
    """Write a copy of a model with suggested annotations; without these comments it is the same file."""
    from dl2c.commands.check import annotated

    content = annotated(model, options)
    if output is None:
        sys.stdout.buffer.write(content)
    else:
        write_output(output, content)
        print(output)
    if b"@progress" not in content and not quiet():
        print(f"note: {NO_GOAL}", file=sys.stderr)


@app.command()
@model_options
def info(model: Model, json: Json = False, *, options: Mapping[str, Any]) -> None:
    """Describe a model's environment: spaces, decisions, bounds, kernels, predicates, options."""
    from dl2c.commands.describe import describe
    from dl2c.env.opening import manifest_of

    with working(f"reading {model}"):
        manifest = manifest_of(model, options)
    if json:
        print(manifest.to_json(), end="")
    else:
        describe(manifest)


@app.command()
@model_options
def emit(
    model: Model,
    stage: Stage = "c",
    pure_python: Annotated[
        bool, typer.Option("--pure-python", help="With --stage gym: needs neither compiler nor dl2c.")
    ] = False,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Print what a model has become after a stage of the compiler."""
    from dl2c.configuration import resolve_options
    from dl2c.env.opening import source_of
    from dl2c.pipeline import emit as emitted

    text = emitted(source_of(model), stage, resolve_options(options), pure_python)
    print(to_json({"stage": stage, "text": text}) if json else text.rstrip("\n"))


@app.command()
@model_options
def sample(
    model: Model,
    count: Annotated[int, typer.Option("-n", "--count", min=1, help="How many states.")] = 10_000,
    seed: Seed = 0,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="Write every state to this file.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Picture of all pairs of names.")] = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Draw initial states and say what is proved of them and how fast they are."""
    from dl2c.commands.sample import draw, present

    with working(f"sampling {model}"):
        drawn = draw(model, options, count, seed)
    present(drawn, csv_file, plot, json)


app.command()(model_options(verify))
app.command()(model_options(rollout))
app.command()(model_options(train))
app.command()(model_options(falsify))
app.command()(replay)
app.command("report")(report_command)
app.command()(talkative(lsp))
app.command()(model_options(play))


app.command()(model_options(monitor))


def _build(model: str, options: Mapping[str, Any]) -> "Kept":
    from dl2c.env.opening import kept, source_of

    with working(f"compiling {model}") as note:
        return kept(source_of(model), options, note)
