"""The folders in which dl2c keeps what it can make again. They belong to this user alone."""

import os
import stat
from pathlib import Path

import platformdirs

ADVICE = "set DL2C_CACHE_DIR to a folder of yours"

DEFAULT_CAP = 2 * 1024**3
"""Bytes of built models that are kept before the least recently used go."""


class StorageError(RuntimeError):
    """There can be no such folder; the message says why."""


def cache_home() -> Path:
    """`$DL2C_CACHE_DIR`, or else the user's cache folder; nothing is created. Raises `StorageError`."""
    home = os.environ.get("DL2C_CACHE_DIR") or platformdirs.user_cache_dir("dl2c")
    try:
        return Path(home).expanduser().absolute()
    except RuntimeError:
        raise StorageError(f"there is no home of the user in {home}; {ADVICE}") from None


def private_folder(name: str) -> Path:
    """A folder in `cache_home()`, created if need be, readable by this user alone. Raises `StorageError` if
    it cannot be created or belongs to someone else.
    """
    folder = cache_home() / name
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        owners = {folder.lstat().st_uid, folder.stat().st_uid}
        if owners != {os.getuid()}:
            raise StorageError(f"the build cache {folder} belongs to another user; {ADVICE}")
        if stat.S_IMODE(folder.stat().st_mode) & 0o077:
            folder.chmod(0o700)
    except OSError as problem:
        raise StorageError(f"cannot use the build cache {folder}: {problem.strerror}; {ADVICE}") from None
    return folder
