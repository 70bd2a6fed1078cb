"""Which parameters of a test belong to the quick tests."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def quick_among(values: Iterable[Any], quick: Collection[Any]) -> list[Any]:
    """All values as parameters, where those that are not quick make slow tests."""
    return [value if value in quick else pytest.param(value, marks=pytest.mark.slow) for value in values]


def quick_rows(rows: Iterable[tuple[Any, ...]], quick: Collection[Any]) -> list[Any]:
    """The same where each parameter is a row of values, one for each argument."""
    return [row if row in quick else pytest.param(*row, marks=pytest.mark.slow) for row in rows]
