"""The options of an environment, completed by those of the model's `@episode`."""

from dl2c.diagnostics import CompileError, Diagnostic, error, warning
from dl2c.options import Options, UnknownOption, current, deprecation, under
from dl2c.parse.annotations import EpisodeAnnotation
from dl2c.parse.options import ALLOW
from dl2c.resolve.problem import Problem


def completed(options: Options, episode: EpisodeAnnotation) -> Options:
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


def deprecated_values(problem: Problem) -> tuple[Diagnostic, ...]:
    """Values of `@episode` that have a new name."""
    written = problem.episode.options if problem.episode else ()
    return tuple(
        warning("deprecated-option", "this value is deprecated", span, "", f"write `{current(name, value)}`")
        for name, value, span in written
        if name != ALLOW and deprecation(name, value)
    )
