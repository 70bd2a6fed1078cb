"""The version of dl2c, written once."""

__version__ = "0.1.0"
