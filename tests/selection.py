"""Which parameters of a test belong to the quick tests."""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis.strategies import SearchStrategy


def quick_among(values: Iterable[Any], quick: Collection[Any]) -> list[Any]:
    """All values as parameters, where those that are not quick make slow tests."""
    return [value if value in quick else pytest.param(value, marks=pytest.mark.slow) for value in values]


def quick_rows(rows: Iterable[tuple[Any, ...]], quick: Collection[Any]) -> list[Any]:
    """The same where each parameter is a row of values, one for each argument."""
    return [row if row in quick else pytest.param(*row, marks=pytest.mark.slow) for row in rows]


def few_and_many(few: Any, many: Any) -> list[Any]:
    """How much of one kind is tried: few in a quick test, many in a slow one."""
    return [pytest.param(few, id="few"), pytest.param(many, id="many", marks=pytest.mark.slow)]


def few_and_many_examples(
    few: int, many: int, *drawn: SearchStrategy[Any], **named: SearchStrategy[Any]
) -> Callable[[Callable[..., None]], Callable[[int], None]]:
    """Like `given`, with so many examples in a quick test, and so many in a slow one."""

    def tested(law: Callable[..., None]) -> Callable[[int], None]:
        @pytest.mark.parametrize("count", few_and_many(few, many))
        def test(count: int) -> None:
            settings(max_examples=count)(given(*drawn, **named)(law))()

        test.__name__, test.__doc__ = law.__name__, law.__doc__
        return test

    return tested
