"""dl2c: KeYmaera X models compiled to native reinforcement-learning environments.

    env = dl2c.make("model.kyx", on_blocked="terminate")
    env = gymnasium.make("dl2c:dl2c/Model-v0", model="model.kyx")

Importing this registers the Gymnasium ids and loads neither the compiler nor a learning library. The
command `dl2c` needs no ids: there Gymnasium is imported by what uses it.
A model is named by a path, by its text, or as `example:NAME`; `options` are those of
`dl2c.options.Options`. All of these raise `CompileError` for a mistake in the model.
"""

from dl2c import interruption as _interruption

if _interruption.is_command():
    _interruption.end_at_once()  # before all that takes long to import

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dl2c.diagnostics import CompileError
from dl2c.version import __version__

if TYPE_CHECKING:
    from dl2c.env.opening import Model
    from dl2c.env.sb3 import Dl2cVecEnv
    from dl2c.env.single import Dl2cEnv
    from dl2c.env.vector import Dl2cVectorEnv
    from dl2c.native.binding import Library
    from dl2c.native.built import Compiled

__all__ = ["CompileError", "__version__", "build", "load", "make", "make_sb3", "make_vec"]

if not _interruption.is_command():
    from dl2c.env.registration import register

    register()


def make(model: "Model", *, render_mode: str | None = None, **options: Any) -> "Dl2cEnv":
    """One Gymnasium environment of a model."""
    from dl2c.env.single import Dl2cEnv

    return Dl2cEnv(model, render_mode=render_mode, **options)


def make_vec(model: "Model", num_envs: int = 1, **options: Any) -> "Dl2cVectorEnv":
    """A Gymnasium vector environment; `autoreset_mode`, `num_threads` and `copy` are options too."""
    from dl2c.env.vector import Dl2cVectorEnv

    return Dl2cVectorEnv(model, num_envs, **options)


def make_sb3(model: "Model", num_envs: int = 1, **options: Any) -> "Dl2cVecEnv":
    """A Stable-Baselines3 VecEnv; `num_threads` is an option too. Needs the extra `dl2c[train]`."""
    try:
        from dl2c.env.sb3 import Dl2cVecEnv
    except ModuleNotFoundError as missing:
        from dl2c.version import install

        raise ModuleNotFoundError(
            f"{missing}; install it with `{install('train')}`", name=missing.name
        ) from None
    return Dl2cVecEnv(model, num_envs, **options)


def build(model: "Model", **options: Any) -> "Compiled":
    """Compile a model: its loaded library, the folder of its files, and the warnings."""
    from dl2c.env.opening import build as build_model
    from dl2c.env.opening import source_of

    return build_model(source_of(model), options)


def load(directory: str | Path) -> "Library":
    """Load what `dl2c build` wrote to a folder."""
    from dl2c.native.binding import load_library

    return load_library(Path(directory))
