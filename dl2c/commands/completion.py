"""What a shell proposes for arguments that are not flags: words, and models."""

from collections.abc import Callable
from pathlib import Path

from dl2c.env.opening import EXAMPLE, examples_dir


def words(*known: str) -> Callable[[str], list[str]]:
    """Proposes those of the known words that begin like what is typed."""

    def propose(incomplete: str) -> list[str]:
        return [word for word in known if word.startswith(incomplete)]

    return propose


def models(incomplete: str) -> list[str]:
    """Proposes the examples, and .kyx files and folders on the way to some."""
    examples = sorted(f"{EXAMPLE}{path.stem}" for path in examples_dir().glob("*.kyx"))
    folder = incomplete[: incomplete.rfind("/") + 1]
    paths = sorted(Path(folder).iterdir()) if Path(folder).is_dir() else []
    files = [
        f"{folder}{path.name}" + "/" * path.is_dir()
        for path in paths
        if path.suffix == ".kyx" or (path.is_dir() and not path.name.startswith("."))
    ]
    return [name for name in (*examples, *files) if name.startswith(incomplete)]
