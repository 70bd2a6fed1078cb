"""Policies in files that hold nothing but data: `policy.json`, and the arrays that it names in `policy.npz`.

Nothing in them is executed: arrays are read without pickle, everything is checked, and sizes are limited.
"""

import io
import json
import math
import reprlib
import struct
import sys
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from dl2c.inputs import MALFORMED, checked_input, read_input, read_json, reason
from dl2c.options import Options, UnknownOption, with_options
from dl2c.outputs import output_folder
from dl2c.policy.network import (
    ACTIVATIONS,
    ActionKind,
    Floats,
    Interface,
    Layer,
    Network,
    NetworkPolicy,
    PolicyError,
    Scaling,
    checked,
)

FORMAT = "dl2c-policy"
VERSION = 1
MAX_JSON = 4 * 1024**2
MAX_ARRAYS = 256 * 1024**2
"""Bytes; what is larger is not a policy for a controller."""

LARGEST = sys.float_info.max
BROKEN = (zipfile.BadZipFile, zlib.error, struct.error, SyntaxError, RuntimeError)
"""What reading a zip file of arrays may raise besides, the last where it is encrypted."""

JSON, NPZ = "policy.json", "policy.npz"


def write_policy(policy: NetworkPolicy, directory: Path) -> Path:
    """Write both files; the path of the JSON."""
    arrays: dict[str, Any] = {}
    scalings: list[dict[str, Any]] = []
    for k, s in enumerate(policy.network.scalings):
        arrays |= {f"center_{k}": s.center, f"scale_{k}": s.scale}
        scalings.append({"center": f"center_{k}", "scale": f"scale_{k}", "clip": _limit(s.clip)})
    layers: list[dict[str, Any]] = []
    for k, layer in enumerate(policy.network.layers):
        arrays |= {f"weight_{k}": layer.weight, f"bias_{k}": layer.bias}
        layers.append({"weight": f"weight_{k}", "bias": f"bias_{k}", "activation": layer.activation})
    interface = asdict(policy.interface)
    interface["observations"] = [[n, _limit(a), _limit(b)] for n, a, b in policy.interface.observations]
    content = {
        "format": FORMAT,
        "version": VERSION,
        "model": policy.model,
        "interface": interface,
        "options": policy.options,
        "masked": policy.masked,
        "bounded": policy.network.bounded,
        "scalings": scalings,
        "layers": layers,
    }
    with output_folder(directory) as folder:
        np.savez(folder / NPZ, **arrays)
        text = json.dumps(content, indent=1, sort_keys=True, allow_nan=False)
        (folder / JSON).write_text(text + "\n", encoding="utf-8")
    return directory / JSON


def _limit(value: float) -> float | str:
    """JSON has no infinite numbers."""
    return str(value) if math.isinf(value) else value


def read_policy(path: Path) -> NetworkPolicy:
    """The policy of a `policy.json`; the arrays stand beside it. Raises `PolicyError`, `OSError`."""
    with checked_input(PolicyError, f"{path} is not a policy"):
        reader = _Reader(path, _arrays(path.with_name(NPZ)))
        top = reader.record(read_json(path, MAX_JSON), "it")
        if top.get("format") != FORMAT or top.get("version") != VERSION:
            raise PolicyError(f"it is not of version {VERSION} that `dl2c train` writes")
        return checked(_policy(reader, top))


def _policy(reader: "_Reader", top: dict[str, Any]) -> NetworkPolicy:
    scalings = [reader.record(s, "a scaling") for s in reader.items(top["scalings"], "scalings")]
    layers = [reader.record(part, "a layer") for part in reader.items(top["layers"], "layers")]
    if unknown := [part["activation"] for part in layers if part["activation"] not in ACTIVATIONS]:
        raise PolicyError(f"no activation {unknown[0]!r}; there is {', '.join(ACTIVATIONS)}")
    network = Network(
        tuple(
            Scaling(reader.array(s["center"]), reader.array(s["scale"]), reader.number(s["clip"]))
            for s in scalings
        ),
        tuple(
            Layer(reader.array(part["weight"]), reader.array(part["bias"]), part["activation"])
            for part in layers
        ),
        reader.truth(top["bounded"]),
    )
    options = reader.record(top["options"], "options")
    try:
        with_options(Options(), options)
    except UnknownOption as problem:
        raise PolicyError(str(problem)) from None
    interface = _interface(reader, reader.record(top["interface"], "interface"))
    return NetworkPolicy(reader.text(top["model"]), interface, network, reader.truth(top["masked"]), options)


def _interface(reader: "_Reader", data: dict[str, Any]) -> Interface:
    observations: list[tuple[str, float, float]] = []
    for entry in reader.items(data["observations"], "observations"):
        parts = reader.items(entry, "an observation")
        if len(parts) != 3:
            raise PolicyError("an observation is a name with two limits")
        observations.append((reader.text(parts[0]), reader.number(parts[1]), reader.number(parts[2])))
    if data["kind"] not in get_args(ActionKind) or data["dtype"] not in ("float32", "float64"):
        raise PolicyError(f"no actions {data['kind']!r} with observations {data['dtype']!r}")
    numbers = {k: tuple(map(reader.number, reader.items(data[k], k))) for k in ("low", "high")}
    made = Interface(
        observations=tuple(observations),
        dtype=data["dtype"],
        kind=data["kind"],
        counts=tuple(map(reader.whole, reader.items(data["counts"], "counts"))),
        runs=tuple(
            tuple(map(reader.whole, reader.items(r, "a run"))) for r in reader.items(data["runs"], "runs")
        ),
        inputs=tuple(map(reader.text, reader.items(data["inputs"], "inputs"))),
        squash=reader.truth(data["squash"]),
        **numbers,
    )
    if len(made.low) != len(made.high) or any(c < 1 for c in made.counts):
        raise PolicyError("its actions have no range")
    return made


class _Reader:
    """Values of JSON and arrays as what they are meant to be. All raise `PolicyError`."""

    def __init__(self, path: Path, arrays: dict[str, Floats]) -> None:
        self.path, self.arrays = path, arrays

    def record(self, value: Any, what: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise PolicyError(f"{what} is not an object")
        return cast("dict[str, Any]", value)

    def items(self, value: Any, what: str) -> list[Any]:
        if not isinstance(value, list):
            raise PolicyError(f"{what} is not a list")
        return cast("list[Any]", value)

    def text(self, value: Any) -> str:
        if not isinstance(value, str):
            raise PolicyError(f"{reprlib.repr(value)} is not a text")
        return value

    def truth(self, value: Any) -> bool:
        if not isinstance(value, bool):
            raise PolicyError(f"{reprlib.repr(value)} is neither true nor false")
        return value

    def whole(self, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not -1 <= value < 2**31:
            raise PolicyError(f"{reprlib.repr(value)} is not a whole number of this size")
        return value

    def number(self, value: Any) -> float:
        if value in ("inf", "-inf"):
            return float(value)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST:
            raise PolicyError(f"{reprlib.repr(value)} is not a number")
        return float(value)

    def array(self, name: Any) -> Floats:
        if not isinstance(name, str) or name not in self.arrays:
            raise PolicyError(f"{NPZ} has no array {name!r}")
        return self.arrays[name]


def _arrays(path: Path) -> dict[str, Floats]:
    """The arrays of a file, as doubles. Raises `PolicyError`, `OSError`."""
    content = io.BytesIO(read_input(path, MAX_ARRAYS))
    try:
        with zipfile.ZipFile(content) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MAX_ARRAYS:
                raise PolicyError(f"it is larger than {MAX_ARRAYS // 1024**2} MB")
        with np.load(content, allow_pickle=False) as file:
            return {name: _floats(name, file[name]) for name in file.files}
    except (*MALFORMED, *BROKEN) as problem:
        raise PolicyError(f"{path} holds no arrays: {reason(problem)}") from None


def _floats(name: str, array: Any) -> Floats:
    if type(array) is not np.ndarray:
        raise PolicyError(f"{name} is not an array")
    if array.dtype.str not in ("<f4", "<f8") or array.ndim > 2:
        raise PolicyError(f"{name} is not a vector or matrix of floats")
    return array.astype(np.float64)
