"""Which parameters of a test belong to the quick tests."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def quick_among(values: Iterable[Any], quick: Collection[Any]) -> list[Any]:
    """All values as parameters, where those that are not quick make slow tests."""
    return [value if value in quick else pytest.param(value, marks=pytest.mark.slow) for value in values]
