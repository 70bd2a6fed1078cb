"""Steps as one function of the action each: cgen/python/stepping.c, an extension that knows no model.

Built into the cache on first use, once for each Python and numpy. Nothing needs it: what is not there
where headers are missing is done in Python by `dl2c.env.stepping`.
"""

import sysconfig
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dl2c.code import cgen_dir
from dl2c.native.cache import cached, key_of, name_entry
from dl2c.native.errors import NativeError
from dl2c.native.loading import load
from dl2c.native.toolchain import find_compiler, link_flags, python_include, run, user_flags
from dl2c.progress import LOG

MakeStep: TypeAlias = Callable[[tuple[Any, ...]], Callable[..., Any]]
"""Makes a step of its parts, which are told there."""


class Stepping(Protocol):
    """The extension: steps of a single environment, of many, and of a batch, which take no action; and infos
    of many (`python_infos`).
    """

    one: MakeStep
    many: MakeStep
    batch: MakeStep
    infos: Callable[[NDArray[np.bool_], Mapping[str, Any]], list[dict[str, Any]]]


def stepping() -> Stepping | None:
    """The extension; None where it cannot be built, which is logged."""
    headers = Path(np.get_include())
    if not (python := python_include()) or not (headers / "numpy" / "arrayobject.h").is_file():
        return None
    include = (*python, f"-I{headers}", f"-I{cgen_dir() / 'include'}")
    try:
        return cached(
            _key(), lambda directory: _build(directory, include), lambda directory: load(directory / _file())
        )
    except NativeError as problem:
        LOG.info("environments are stepped in Python: %s", problem)
        return None


def _file() -> str:
    return f"stepping{sysconfig.get_config_var('EXT_SUFFIX')}"


def _key() -> str:
    """Not the compiler: there is no arithmetic in it that could depend on one."""
    files = (*sorted(_source().parent.glob("*.[ch]")), cgen_dir() / "include" / "dl2c.h")
    texts = [path.read_text(encoding="utf-8") for path in files]
    facts = (texts, user_flags(), sysconfig.get_config_var("SOABI"), np.__version__)
    return key_of(facts)


def _source() -> Path:
    return cgen_dir() / "python" / "stepping.c"


def _build(directory: Path, include: tuple[str, ...]) -> None:
    """One command."""
    compiler = find_compiler()
    flags = (*compiler.flags(native=False), "-w", *include, *link_flags())
    run((*compiler.command, str(_source()), *flags, "-o", _file()), directory)
    name_entry(directory, "steps of environments")
