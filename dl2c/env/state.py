"""States by name: between `{"x": 1.0, ...}` and the flat arrays of a batch."""

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from dl2c.native.manifest import InputSpec, Manifest, Quantity

if TYPE_CHECKING:
    from dl2c.native.binding import Batch
    from dl2c.native.results import Results


def read_state(manifest: Manifest, batch: "Batch", i: int = 0) -> dict[str, float]:
    """Variables and constants of environment i, exact."""
    x, p = batch.get_state(i)
    names = [q.name for q in (*manifest.variables, *manifest.constants)]
    return dict(zip(names, (*x.tolist(), *p.tolist()), strict=True))


def read_states(manifest: Manifest, batch: "Batch", places: Iterable[int]) -> list[dict[str, float]]:
    """The same of several environments at once."""
    names = [q.name for q in (*manifest.variables, *manifest.constants)]
    return [dict(zip(names, row, strict=True)) for row in batch.states(places).tolist()]


def reset_state(
    manifest: Manifest, batch: "Batch", i: int, seed: int | None, state: Mapping[str, float]
) -> None:
    """Begin an episode of environment i in `state`: every variable and every constant not fixed.

    Raises `ValueError` for missing or unknown names, `ResetFailed` if the precondition refuses the state.
    """
    quantities = (*manifest.variables, *manifest.constants)
    names = [q.name for q in quantities]
    for name in state:
        if name not in names:
            close = get_close_matches(str(name), names, 1)
            hint = f"did you mean `{close[0]}`?" if close else f"there are {', '.join(names)}"
            raise ValueError(f"no variable or constant `{name}` in {manifest.name}; {hint}")
    for q in quantities:
        if q.value is not None and state.get(q.name, q.value) != q.value:
            raise ValueError(f"`{q.name}` is fixed at {q.value:g} in this build")
    if missing := [q.name for q in quantities if q.name not in state and q.value is None]:
        raise ValueError(f"the state lacks {', '.join(missing)}")
    batch.reset_to(i, seed, _values(manifest.variables, state), _values(manifest.constants, state))


def _values(quantities: tuple[Quantity, ...], state: Mapping[str, float]) -> NDArray[np.float64]:
    return np.array([state.get(q.name, q.value) for q in quantities], np.float64)


def read_drawn(manifest: Manifest, results: "Results") -> dict[str, NDArray[Any]]:
    """What the environment decided in the last step, by key: alternatives (-1 where it did not),
    values (NaN where it did not), each for all environments in fresh memory.
    """
    choices = {
        c.key: results.drawn_choices[:, k].astype(np.int64) for k, c in enumerate(manifest.drawn_choices)
    }
    return choices | {i.key: results.drawn_inputs[:, k].copy() for k, i in enumerate(manifest.drawn_inputs)}


def drawn_reader(manifest: Manifest, batch: "Batch") -> Callable[[], dict[str, int | float]]:
    """`read_drawn` for a batch of one, as Python numbers."""
    keys = [spec.key for spec in (*manifest.drawn_choices, *manifest.drawn_inputs)]
    choices, inputs = batch.drawn_choices[0], batch.drawn_inputs[0]
    return lambda: dict(zip(keys, choices.tolist() + inputs.tolist(), strict=True))


def chosen_keys(manifest: Manifest) -> tuple[str, ...]:
    """The keys of `x := *` whose values are known, those of the agent first."""
    return tuple(spec.key for spec in (*_known_inputs(manifest), *manifest.drawn_inputs))


def _known_inputs(manifest: Manifest) -> tuple[InputSpec, ...]:
    """Under `action_map="squash"` the agent's are not known: actions are shares of what passed."""
    return () if manifest.options["action_map"] == "squash" else tuple(manifest.inputs)


def read_chosen(manifest: Manifest, batch: "Batch", i: int = 0) -> dict[str, float]:
    """The values that `x := *` took in the last step of environment i by key (`chosen_keys`), exact. Of one
    that it did not meet: NaN if the environment's, what was asked for if the agent's.
    """
    own = {spec.key: float(batch.executed_inputs[i, k]) for k, spec in enumerate(_known_inputs(manifest))}
    return own | {s.key: float(batch.drawn_inputs[i, k]) for k, s in enumerate(manifest.drawn_inputs)}


def state_line(manifest: Manifest, batch: "Batch", i: int = 0) -> str:
    """Time and state of environment i on one line, for people."""
    units = {q.name: q.unit for q in (*manifest.variables, *manifest.constants)}
    parts = [f"time={batch.time[i]:.6g}"]
    parts += [f"{name}={value:.6g}{units[name]}" for name, value in read_state(manifest, batch, i).items()]
    return "  ".join(parts)


def check_reset_options(options: Mapping[str, object], known: tuple[str, ...]) -> None:
    """Warn of what `reset(options=...)` ignores, as environments of Gymnasium do."""
    for name in options:
        if name not in known:
            gym.logger.warn(f"reset ignores the option `{name}`; there is {', '.join(known)}")
