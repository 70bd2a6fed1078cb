"""What a policy sees of an environment and how it acts in it, as data."""

from typing import Any

from dl2c.env.actions import encoding, flat_format
from dl2c.env.encodings import Choices, Flat, OneChoice, Runs
from dl2c.env.spaces import float_type, observation_space
from dl2c.native.manifest import Manifest
from dl2c.policy.network import Interface


def interface_of(manifest: Manifest) -> Interface:
    """The interface of a model's environments, actions in the format that learning libraries take."""
    space: Any = observation_space(manifest)
    code = encoding(manifest, flat_format(manifest))
    limits = zip(manifest.observations, space.low.tolist(), space.high.tolist(), strict=True)
    observations = tuple((q.name, float(low), float(high)) for q, low, high in limits)
    dtype = "float32" if float_type(manifest) == "float32" else "float64"
    kind = code.kind
    if kind is None:
        raise AssertionError("policies act on flat spaces")
    match code:
        case OneChoice(count):
            return Interface(observations, dtype, kind, (count,))
        case Choices(counts):
            return Interface(observations, dtype, kind, tuple(counts.tolist()))
        case Runs():
            counts = tuple(len(c.alternatives) for c in manifest.choices)
            return Interface(observations, dtype, kind, counts, manifest.runs)
        case Flat(counts=counts, squash=squash):
            box: Any = code.space()
            return Interface(
                observations,
                dtype,
                kind,
                counts=tuple(counts.tolist()),
                inputs=tuple(i.key for i in manifest.inputs),
                low=tuple(box.low.tolist()),
                high=tuple(box.high.tolist()),
                squash=squash,
            )
        case _:
            return Interface(observations, dtype, kind)
