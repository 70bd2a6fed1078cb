"""Infos of many environments that are made when somebody looks: most training loops never do."""

from collections.abc import Callable
from functools import wraps
from typing import Any, final

_UNFILLED = {"unfilled": None}
"""Some C code takes a dict of size 0 for an empty one without asking it."""


@final
class LazyInfos(dict[str, Any]):
    """A dict whose entries `make(*given)` returns, called once, at the first look.

    What is given must not change, so that the entries are those of the step that returned this dict, whenever
    they are looked at. Copies, unions and pickles are plain dicts.
    """

    __slots__ = ("_given", "_make")

    def __init__(self, make: Callable[..., dict[str, Any]], *given: Any) -> None:
        super().__init__(_UNFILLED)
        self._make: Callable[..., dict[str, Any]] | None = make
        self._given = given

    def _fill(self) -> None:
        if (make := self._make) is not None:
            entries = make(*self._given)
            super().clear()
            super().update(entries)
            self._make, self._given = None, ()

    def __reduce_ex__(self, protocol: Any) -> tuple[type[dict[str, Any]], tuple[dict[str, Any]]]:
        return dict, (self.copy(),)


def _filling(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method of dict that fills first."""

    @wraps(method)
    def filled(self: LazyInfos, *args: Any, **kwargs: Any) -> Any:
        self._fill()  # pyright: ignore[reportPrivateUsage] # a method of its class
        return method(self, *args, **kwargs)

    return filled


for _name in (
    *("__contains__", "__delitem__", "__eq__", "__getitem__", "__ior__", "__iter__", "__len__", "__ne__"),
    *("__or__", "__repr__", "__reversed__", "__ror__", "__setitem__", "clear", "copy", "get", "items"),
    *("keys", "pop", "popitem", "setdefault", "update", "values"),
):
    setattr(LazyInfos, _name, _filling(getattr(dict, _name)))
