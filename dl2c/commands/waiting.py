"""What a command shows on stderr while it works: a spinner, or a bar."""

import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any

from dl2c.commands.verbosity import detailed, quiet


@contextmanager
def working(what: str) -> Generator[Callable[[str], None]]:
    """A spinner on a terminal's stderr, nothing elsewhere or with -v, -q; yields what changes its text."""
    if not sys.stderr.isatty() or detailed() or quiet():
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status(what) as status:
        yield lambda text: status.update(f"{what}: {text}")


@contextmanager
def progress(steps: int) -> Generator[Any]:
    """A bar on a terminal's stderr, nothing elsewhere; yields what takes a point of the learning curve."""
    from rich.progress import TextColumn, TimeRemainingColumn

    columns = (TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.description}"))
    with _bar(TextColumn("{task.percentage:3.0f} %"), *columns) as bar:
        task = bar.add_task("", total=steps)

        def note(point: Any) -> None:
            bar.update(task, completed=point.steps, description=described(point))

        yield note


def described(point: Any) -> str:
    """A point of the learning curve on one line."""
    speed = f"{point.steps_per_second:,.0f} steps/s"
    if not point.episodes:
        return f"no episode ended  {speed}"
    rates = f"success {point.success:4.0%}  violations {point.violations:4.0%}"
    return f"{rates}  return {point.episode_return:.4g}  {speed}"


@contextmanager
def counting(total: int, what: str) -> Generator[Callable[[int], None]]:
    """A bar on a terminal's stderr, nothing elsewhere; yields what takes how many are done."""
    from rich.progress import TextColumn

    with _bar(TextColumn("{task.completed:,} of {task.total:,} " + what)) as bar:
        task = bar.add_task("", total=total)
        yield lambda done: bar.update(task, completed=min(done, total))


def _bar(done: Any, *more: Any) -> Any:
    """A bar with columns beside it, hidden where stderr is not a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), BarColumn(), done, TimeElapsedColumn(), *more)
    return Progress(*columns, console=console, disable=quiet() or not console.is_terminal)
