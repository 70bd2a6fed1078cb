"""Building and calling compiled models: the only package that imports cffi or runs a compiler."""

from dl2c.code import cgen_dir

__all__ = ["cgen_dir"]
