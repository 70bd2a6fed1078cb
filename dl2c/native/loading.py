"""Loading what was built: the library in a file. Nothing is built here."""

import hashlib
import importlib.util
import sys
import tempfile
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from dl2c.native.errors import NativeError


def find(directory: Path) -> Path:
    """The library in a folder."""
    if found := sorted(directory.glob("lib*.so")):
        return found[0]
    raise NativeError(f"{directory.name} holds no library; build the model again")


def load(path: Path) -> Any:
    """The extension module in a file; of a library of a model, `lib*`, what has cffi's `ffi` and `lib`.

    By content: the same bytes are loaded once. Raises `NativeError`.

    The dynamic linker tells libraries apart by path before it looks at the file; a link that
    nobody has seen before makes it look.
    """
    try:
        name = f"dl2c_{hashlib.sha256(path.read_bytes()).hexdigest()[:16]}.{path.name.partition('.')[0]}"
        if (loaded := sys.modules.get(name)) is None:
            with tempfile.TemporaryDirectory(prefix="dl2c-") as fresh:
                link = Path(fresh, path.name)
                link.symlink_to(path.resolve())
                loaded = sys.modules[name] = _load(link, name)
    except OSError as problem:
        raise NativeError(f"cannot load {path.name}: {problem.strerror}") from None
    return loaded


def _load(path: Path, name: str) -> ModuleType:
    try:
        if path.name.startswith("lib"):
            from dl2c.native.declared import ffi

            module: Any = ModuleType(name)
            module.ffi = ffi
            module.lib = module.ffi.dlopen(str(path))
            return module
        spec = importlib.util.spec_from_file_location(name, path, loader=ExtensionFileLoader(name, str(path)))
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module
    except (ImportError, OSError) as problem:
        raise NativeError(f"cannot load {path.name}: {problem}; build the model again") from None
