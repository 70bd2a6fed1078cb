"""Rows of `rollout` as Arrow tables. Needs pyarrow, of the extra `dl2c[ray]`, and imports it when called."""

import dataclasses
import importlib
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import Any, TypeAlias

from dl2c.env.actions import encoding, flat_format
from dl2c.env.encodings import Choices, Flat
from dl2c.env.state import chosen_keys
from dl2c.native.manifest import Manifest
from dl2c.native.toolchain import host
from dl2c.training.rollout import COLUMNS, state_names
from dl2c.version import install

Table: TypeAlias = Any
"""A `pyarrow.Table`; pyarrow publishes no types."""

Row: TypeAlias = dict[str, Any]

MANIFEST = b"dl2c"
"""Under this key the metadata of a table hold the manifest of the library that made it, as JSON."""

BLOCK = 10_000
"""Rows of one table, where there is a choice."""


def arrow(module: str = "pyarrow") -> Any:
    """pyarrow, or a module of it. Raises `ModuleNotFoundError`, with advice, where it is not installed."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as missing:
        advice = f"install it with `{install('ray')}`"
        raise ModuleNotFoundError(f"{missing}; {advice}", name=missing.name) from None


def schema(manifest: Manifest) -> Any:
    """The `pyarrow.Schema` of a model's rows. The manifest in its metadata has this machine's platform.

    `action`, and what was assigned, is null where an episode begins; one of several numbers is a list.
    """
    pa = arrow()
    match encoding(manifest, flat_format(manifest)):
        case Choices():
            action = pa.list_(pa.int64())
        case Flat():
            action = pa.list_(pa.float64())
        case _:
            action = pa.int64()
    number, flag, text = pa.float64(), pa.bool_(), pa.string()
    kinds = (pa.int64(), pa.int64(), number, action, number, flag, flag, text, text)
    values = (*state_names(manifest), *chosen_keys(manifest))
    fields = dict(zip(COLUMNS, kinds, strict=True)) | dict.fromkeys(values, number)
    here = dataclasses.replace(manifest, platform=manifest.platform | host())
    return pa.schema(fields, {MANIFEST: here.to_json()})


def tables(rows: Iterable[Row], wanted: Any) -> Iterable[Table]:
    """Rows as tables of this schema, some thousands of rows each."""
    remaining = iter(rows)
    while block := [_with_null(row) for row in islice(remaining, BLOCK)]:
        yield arrow().Table.from_pylist(block, wanted)


def _with_null(row: Row) -> Row:
    return row | {k: None for k, v in row.items() if v == "" and k != "reason"} if row["step"] == 0 else row


def lists(table: Table, names: Sequence[str]) -> list[list[Any]]:
    """Columns of a table as lists of Python values."""
    columns = (table.column(name) for name in names)
    return [c.to_numpy().tolist() if c.type == "double" else c.to_pylist() for c in columns]
