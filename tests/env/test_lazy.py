"""Infos that are made at the first look: whatever is done with them, they are what an eager dict would be."""

import copy
import json
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from generators.toy_library import use_toy
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

from dl2c.env.lazy import LazyInfos
from dl2c.env.vector import Dl2cVectorEnv

ENTRIES = {"b": 1, "a": 2, "c": None}


def _keywords(**given: Any) -> dict[str, Any]:
    return given


USES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "dict": dict,
    "keywords": lambda d: _keywords(**d),
    "unpacked": lambda d: {"z": 0, **d, "b": 7},
    "list": list,
    "reversed": lambda d: list(reversed(d)),
    "len": len,
    "bool": bool,
    "repr": repr,
    "str": str,
    "format": lambda d: f"{d}",
    "in": lambda d: ("a" in d, "z" in d),
    "item": lambda d: d["a"],
    "missing": lambda d: [key for key in ("a", "z") if key not in d],
    "get": lambda d: (d.get("a"), d.get("z", 5)),
    "items": lambda d: list(d.items()),
    "keys": lambda d: list(d.keys() | {"z"} - {"a"}) and sorted(d.keys()),
    "values": lambda d: list(d.values()),
    "equal": lambda d: (d == ENTRIES, d == {}, {"a": d} == {"a": ENTRIES}),
    "unequal": lambda d: (d != ENTRIES, d != {}, [d] == [ENTRIES]),
    "or": lambda d: d | {"z": 1, "a": 9},
    "ror": lambda d: {"z": 1, "a": 9} | d,
    "updated": lambda d: (e := {"z": 1, "a": 9}, e.update(d), e)[-1],
    "copy": lambda d: d.copy(),
    "copied": copy.copy,
    "deepcopied": copy.deepcopy,
    "pickled": lambda d: pickle.loads(pickle.dumps(d)),
    "json": json.dumps,
    "json, indented": lambda d: json.dumps(d, indent=1, sort_keys=True),
    "pop": lambda d: (d.pop("a"), list(d)),
    "popitem": lambda d: (d.popitem(), list(d)),
    "set": lambda d: (d.__setitem__("a", 0), list(d.items())),
    "delete": lambda d: (d.__delitem__("a"), list(d.items())),
    "setdefault": lambda d: (d.setdefault("a", 8), d.setdefault("z", 9), list(d.items())),
    "update": lambda d: (d.update(z=1, a=9), list(d.items())),
    "clear": lambda d: (d.clear(), list(d.items())),
    "ior": lambda d: list(d.__ior__({"z": 1, "a": 9}).items()),
}


@pytest.mark.parametrize("use", USES)
def test_every_use_of_a_dict(use: str) -> None:
    assert USES[use](LazyInfos(ENTRIES.copy)) == USES[use](ENTRIES.copy())


def test_no_method_of_dict_is_left_out() -> None:
    own = {name for name in vars(dict) if callable(getattr(dict, name))}
    harmless = {
        "__class_getitem__",
        "__getattribute__",
        "__hash__",
        "__init__",
        "__new__",
        "__sizeof__",
        "fromkeys",
    }
    ordered = {"__ge__", "__gt__", "__le__", "__lt__"}  # dicts have no order
    assert own - harmless - ordered <= vars(LazyInfos).keys()


def test_entries_are_made_once_and_only_when_asked_for() -> None:
    calls: list[int] = []
    infos = LazyInfos(lambda: calls.append(1) or {"a": 1})
    assert isinstance(infos, dict) and not calls
    assert infos["a"] == infos.get("a") == 1 and calls == [1]


def test_plain_dicts_come_of_it() -> None:
    for use in ("copied", "deepcopied", "pickled", "copy", "or", "ror"):
        assert type(USES[use](LazyInfos(ENTRIES.copy))) is dict


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_infos_are_those_of_their_own_step(monkeypatch: pytest.MonkeyPatch, mode: AutoresetMode) -> None:
    use_toy(monkeypatch, (3, 2), 1)
    early, late = (
        Dl2cVectorEnv("a model\nof two lines", 5, autoreset_mode=mode, copy=c) for c in (True, False)
    )
    rng = np.random.default_rng(0)
    pairs: list[tuple[Any, Any]] = []
    for k in range(60):
        if k == 0 or (mode == AutoresetMode.DISABLED and not early._all_ready):  # pyright: ignore[reportPrivateUsage]
            assert data_equivalence(early.reset(seed=k), late.reset(seed=k), exact=True)
        action = {
            "assign_u0": rng.uniform(-1, 2, (5, 1)),
            **{f"choice_{i}": rng.integers(2, size=5) for i in (0, 1)},
        }
        pairs.append((dict(early.step(action)[4]), late.step(action)[4]))
    late.close()
    assert any("is_success" in first.get("final_info", first) for first, _ in pairs)
    for first, second in pairs:
        assert data_equivalence(first, dict(second), exact=True)
