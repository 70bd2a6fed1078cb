"""Which warnings a model silences, by `@episode: allow=code|code`."""

from collections.abc import Iterable, Iterator

from dl2c.diagnostics import Diagnostic, warning
from dl2c.lint.codes import CODES
from dl2c.parse.errors import suggestion
from dl2c.parse.options import ALLOW
from dl2c.resolve.problem import Problem


def allowed(found: Iterable[Diagnostic], problem: Problem) -> Iterator[Diagnostic]:
    """Those that are errors, or that the model does not allow."""
    silent = {code for code, _ in _allow(problem)}
    return (d for d in found if d.severity == "error" or d.code not in silent)


def unknown(problem: Problem) -> Iterator[Diagnostic]:
    """Codes that the model allows and that do not exist."""
    return (message for code, message in _allow(problem) if code not in CODES)


def _allow(problem: Problem) -> Iterator[tuple[str, Diagnostic]]:
    """The codes of `allow`, each with what to say if there is no such code."""
    for name, value, span in problem.episode.options if problem.episode else ():
        if name == ALLOW:
            for code in str(value).split("|"):
                title = f"there is no lint `{code.strip()}`"
                advice = suggestion(code.strip(), CODES)
                yield code.strip(), warning("unknown-lint", title, span, "", advice)
