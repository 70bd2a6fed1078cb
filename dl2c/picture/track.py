"""What a picture needs of an episode: states over time, and what happened in each step."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dl2c.flows.watch import flows_come_last
from dl2c.ir.arrays import values
from dl2c.ir.model import Model, Symbol


@dataclass(frozen=True, slots=True)
class Track:
    """The states of an episode by name at `times` (seconds), the first one at 0; of each of the steps between
    them whether its request blocked. `status` and `reason` are those of the last step.
    """

    times: tuple[float, ...]
    states: tuple[Mapping[str, float], ...]
    blocked: tuple[bool, ...]
    status: str = "none"
    reason: str = ""

    def values(self, name: str) -> NDArray[np.float64]:
        """A variable or constant at `times`."""
        return np.array([state[name] for state in self.states])

    def curve(self, name: str, moves: bool) -> NDArray[np.float64]:
        """The same to be drawn: of a variable that no flow moves the first step's value from the beginning,
        since the one before holds for no time.
        """
        values = self.values(name)
        if not moves and len(values) > 1:
            values[0] = values[1]
        return values

    @property
    def end(self) -> str:
        """How it ended, in words; "" while it runs."""
        return self.reason if self.status == "none" else f"{self.status}: {self.reason}"

    def then(
        self, time: float, state: Mapping[str, float], blocked: bool, status: str, reason: str
    ) -> "Track":
        """This and one more step."""
        times, states = (*self.times, time), (*self.states, state)
        return Track(times, states, (*self.blocked, blocked), status, reason)


def symbols_at(model: Model, state: Mapping[str, float]) -> dict[Symbol, float]:
    """A state by symbol."""
    constants = {c.symbol: state[c.name] for c in model.constants}
    return {v.symbol: state[v.name] for v in model.variables} | constants


def moving(model: Model) -> set[str]:
    """Variables that some differential equation names. Others change only between two steps."""
    return {x for flow in model.flows for x, _ in flow.equations}


def events(model: Model, track: Track) -> list[int]:
    """After which states a flow ended before its time was up, because its domain did; none where a step
    does not show that, having other flows or statements after them. Failures end flows too.
    """
    if len(model.flows) != 1 or not flows_come_last(model.body) or model.duration == "agent":
        return []
    flow = model.flows[0]
    if flow.drawn:
        return []
    longest = math.inf if flow.cap is None else float(flow.cap)
    last = len(track.times) - (track.status == "failure")
    columns = {q.symbol: track.values(q.name)[1:last] for q in (*model.variables, *model.constants)}
    lasted = np.diff(track.times[:last])
    full = np.zeros(len(lasted), np.bool_)
    for horizon in flow.horizons:
        bound = values(horizon.bound, columns)
        full |= (columns[Symbol(horizon.clock, "variable")] == bound) | np.isnan(bound)
    early = lasted < longest * (1 - 1e-9)
    if flow.reach is not None:
        early |= lasted > longest * (1 + 1e-9)
    return (np.flatnonzero(early & ~full) + 1).tolist()
