"""Where an environment stands, as a value: to return to, to send elsewhere, to plan from."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dl2c.env.state import read_state

if TYPE_CHECKING:
    from dl2c.native.binding import Batch


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All that decides how an episode goes on: state, constants, counters and random stream.

    `state` holds variables and constants by name, exact. What follows a snapshot depends on it and on
    the actions alone, to the last bit. Only environments of the same build can return to it.
    """

    model: str
    key: str = field(repr=False)
    state: dict[str, float]
    memory: bytes = field(repr=False)

    @property
    def ended(self) -> bool:
        """Whether the episode is over: nothing but a reset follows."""
        return self.memory[:8] != bytes(8)


def take(batch: "Batch", i: int) -> Snapshot:
    """Where environment i stands."""
    manifest = batch.library.manifest
    return Snapshot(manifest.name, manifest.key, read_state(manifest, batch, i), batch.save(i))


def put(batch: "Batch", i: int, snapshot: Snapshot) -> None:
    """Go on in environment i from a snapshot. Raises `ValueError` for one of another build."""
    manifest = batch.library.manifest
    if (snapshot.model, snapshot.key) != (manifest.name, manifest.key):
        raise ValueError(
            f"the snapshot is of another build ({snapshot.model}): take and restore it with the same model "
            "and options"
        )
    batch.restore(i, snapshot.memory)
