"""Calling a built library: batches of environments over numpy arrays.

Comes from `compile_library` with a manifest beside it. The arrays of a batch are bound once,
when it is made; a step is then one C call and one comparison. Nothing here can be pickled:
who wants an environment elsewhere sends the model's text and options.
"""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, NoReturn, final

import numpy as np
from numpy.typing import NDArray

from dl2c.native.errors import MonitorViolated, NativeError, ResetFailed
from dl2c.native.loading import find, load
from dl2c.native.manifest import Manifest
from dl2c.native.results import Results, Widths, zeros
from dl2c.native.stepping import stepping
from dl2c.native.sundials import load_solver
from dl2c.native.turns import Turns

AUTORESET = {"disabled": 0, "next_step": 1, "same_step": 2}
ON_BLOCKED = {"fallback": 0, "truncate": 1, "terminate": 2}
ACTION_MAP = {"project": 0, "squash": 1}

MOST_THREADS = 256
ERR_RESET, ERR_STATE, ERR_BLOCKED, ERR_MONITOR = -3, -4, -6, -7


@dataclass(frozen=True, slots=True)
class Sizes:
    """`dl2c_sizes`: how many entries each kind of row has; `obs_size` is bytes per observation entry,
    `snapshot_size` bytes of all that an environment keeps between steps."""

    nx: int
    np: int
    nobs: int
    nchoice: int
    ninput: int
    nenvchoice: int
    nenvinput: int
    nmask: int
    npred: int
    nflow: int
    nroot: int
    obs_size: int
    snapshot_size: int
    nscene: int


@final
@dataclass(frozen=True, slots=True)
class Library:
    """A loaded model. `ffi` and `lib` are cffi's; `sizes` is what the library says of itself."""

    manifest: Manifest
    sizes: Sizes
    ffi: Any
    lib: Any

    def batch(
        self,
        n: int,
        *,
        autoreset: str = "disabled",
        on_blocked: str = "fallback",
        action_map: str = "project",
        blocked_penalty: float = 0.0,
        max_steps: int = 1000,
        stall_limit: int = 0,
        threads: int = 1,
        shared_obs: bool = False,
    ) -> "Batch":
        """n environments, none of them begun: call `reset` first.

        `threads` of them share the work of a call; results are the same for any number. With `shared_obs`
        others may write to the observations, which are then written whole in every step. Raises
        `ValueError` for a value that is not an option, `NativeError` if the library refuses.
        """
        if not 1 <= threads <= MOST_THREADS:
            raise ValueError(f"`num_threads` is from 1 to {MOST_THREADS}, not {threads}")
        options = {
            "max_steps": max_steps,
            "stall_limit": stall_limit,
            "blocked_penalty": blocked_penalty,
            "autoreset": _code("autoreset", autoreset, AUTORESET),
            "on_blocked": _code("on_blocked", on_blocked, ON_BLOCKED),
            "action_map": _code("action_map", action_map, ACTION_MAP),
            "threads": threads,
            "shared_obs": shared_obs,
        }
        return Batch(self, n, options)

    def rates(
        self, flow: int, x: Sequence[float] | NDArray[Any], p: Sequence[float] | NDArray[Any]
    ) -> NDArray[np.float64]:
        """The right-hand sides of a flow's ODE in state x (nx) with constants p (np).

        Returns (nx), per unit of the model's time; 0 for variables that the ODE does not name. A
        term without a value gives whatever arithmetic gives. Raises `IndexError` for no such flow.
        """
        dx = np.empty(self.sizes.nx)
        memory = self.row(dx, np.float64, self.sizes.nx, "double[]")
        self.check(self.lib.dl2c_flow_rates(self._flow(flow), *self.state(x, p), memory))
        return dx

    def roots(
        self, flow: int, x: Sequence[float] | NDArray[Any], p: Sequence[float] | NDArray[Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Margins of a flow's domain and their Lie derivatives: `(g, dg)`, both (nroot).

        One for each comparison of the domain but the bounds of clocks, in the units of its sides
        (`dg`: per unit of the model's time). A margin is positive inside; for `=` and `!=` it is left
        minus right. A flow with fewer than nroot has 1 and 0 in the other places. Raises
        `IndexError` for no such flow.
        """
        g, dg = np.empty((2, self.sizes.nroot))
        memory = [self.row(a, np.float64, self.sizes.nroot, "double[]") for a in (g, dg)]
        self.check(self.lib.dl2c_flow_roots(self._flow(flow), *self.state(x, p), *memory))
        return g, dg

    def _flow(self, flow: int) -> int:
        if not 0 <= flow < self.sizes.nflow:
            raise IndexError(f"flow {flow} of a model that has {self.sizes.nflow}")
        return flow

    def state(self, x: Any, p: Any) -> tuple[Any, Any]:
        """The memory of a state (nx) and of constants (np), for a C call."""
        nx, np_ = self.sizes.nx, self.sizes.np
        return self.row(x, np.float64, nx, "double[]"), self.row(p, np.float64, np_, "double[]")

    def row(self, values: Any, dtype: type[np.generic], length: int, kind: str) -> Any:
        """The memory of a row of that length: that of `values` itself where it fits."""
        array = np.ascontiguousarray(values, dtype)
        if array.shape != (length,):
            raise ValueError(f"expected {length} values, not an array of shape {array.shape}")
        return self.ffi.from_buffer(kind, array)

    def check(self, status: int) -> None:
        """Raise what a status stands for, unless it is DL2C_OK."""
        if status == 0:
            return
        text = self.ffi.string(self.lib.dl2c_status_text(status)).decode()
        raise (ResetFailed if status in (ERR_RESET, ERR_STATE, ERR_BLOCKED) else NativeError)(text)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a loaded library cannot be pickled; send the model's text and options")


@final
class Batch(Results):
    """n environments of one model, and the arrays they read and write.

    Write `choices` and `inputs`, call `step`, read the rest; shapes are those of `dl2c_buffers`
    in dl2c.h. Every call writes into the same arrays: copy what must last.

    One call at a time: another one meanwhile, from a thread or a callback, raises `BatchBusy`, and
    after `close` `BatchClosed`.
    """

    __slots__ = (
        *("_bound", "_handle", "_lib", "_step", "_turns", "library", "n"),
        *("choices", "inputs", "obs", "final_obs"),
    )

    def __init__(self, library: Library, n: int, options: dict[str, Any]) -> None:
        """Made by `Library.batch`."""
        if n < 1:
            raise ValueError(f"a batch has at least one environment, not {n}")
        ffi, lib, s = library.ffi, library.lib, library.sizes
        super().__init__(n, Widths(s.nchoice, s.ninput, s.nenvchoice, s.nenvinput, s.nmask))
        obs = np.float32 if s.obs_size == 4 else np.float64
        self.library, self.n = library, n
        self.choices = zeros((n, s.nchoice), np.int32)
        self.inputs = zeros((n, s.ninput), np.float64)
        self.obs: NDArray[Any] = zeros((n, s.nobs), obs)
        self.final_obs: NDArray[Any] = zeros((n, s.nobs), obs)
        self._lib = lib
        self._step: Callable[[], None] = self._first_step
        self._handle = ffi.NULL
        self._turns = Turns(self._free)
        self._bound = [(name, ffi.from_buffer(array)) for name, array in self._arrays()]
        buffers = ffi.new("dl2c_buffers *")
        for name, memory in self._bound:
            setattr(buffers, name, ffi.cast("void *", memory))
        out = ffi.new("dl2c_batch **")
        self.check(lib.dl2c_batch_create(n, ffi.new("dl2c_options *", options), buffers, out))
        self._handle = ffi.gc(out[0], lib.dl2c_batch_free)

    def check_open(self) -> None:
        """Raises `BatchClosed`."""
        self._turns.check_open()

    def called(self, function: Callable[..., int], *arguments: Any) -> int:
        """The status of a C call of the environments."""
        self._turns.take()
        try:
            return function(self._handle, *arguments)
        finally:
            self._turns.end()

    def step_in_c(self, form: Literal["one", "many", "batch"], *parts: Any) -> Callable[..., Any] | None:
        """The step as a function of the action, if there is one; None where it cannot be built.

        The arguments are those parts of cgen/python/stepping.c, in their order, that are not known here.
        """
        if (extension := stepping()) is None:
            return None
        ffi, turns = self.library.ffi, self._turns
        pointers = (ffi.addressof(self._lib, "dl2c_batch_step"), self._handle)
        addresses = (int(ffi.cast("uintptr_t", p)) for p in pointers)
        known = (*addresses, turns.token, turns.closing, turns.refuse, turns.settle, self.check)
        return getattr(extension, form)((*known, *parts))

    def step(self) -> None:
        """Advance every environment by one step: reads `choices` and `inputs`, writes all else."""
        self._step()

    def _first_step(self) -> None:
        self._step = self.step_in_c("batch", None, True) or self._python_step
        self._step()

    def _python_step(self) -> None:
        self.check(self.called(self._lib.dl2c_batch_step))

    def reset(self, mask: NDArray[np.bool_] | None = None, seeds: NDArray[np.uint64] | None = None) -> None:
        """Begin an episode where `mask` (n) is set, everywhere without one.

        With `seeds` (n) those environments restart their random streams, else they go on with
        their next episode. Raises `ResetFailed` if no initial state is found.
        """
        ffi = self.library.ffi
        masks = ffi.NULL if mask is None else self.library.row(mask, np.bool_, self.n, "uint8_t[]")
        streams = ffi.NULL if seeds is None else self.library.row(seeds, np.uint64, self.n, "uint64_t[]")
        self.check(self.called(self._lib.dl2c_batch_reset, masks, streams))

    def reset_to(
        self, i: int, seed: int | None, x: Sequence[float] | NDArray[Any], p: Sequence[float] | NDArray[Any]
    ) -> None:
        """Begin an episode of environment i in state x (nx) with constants p (np).

        `seed` restarts its random stream. Raises `ResetFailed` if the precondition refuses the
        state or no run is possible from it.
        """
        library, i = self.library, self._index(i)
        stream = library.ffi.NULL if seed is None else library.row([seed], np.uint64, 1, "uint64_t[]")
        self.check(self.called(self._lib.dl2c_batch_reset_to, i, stream, *library.state(x, p)))

    def decides(self) -> NDArray[np.bool_]:
        """In which environments (n) the agent has a decision to take in the next step; elsewhere it makes no
        difference what it asks for."""
        found = np.empty(self.n, np.bool_)
        memory = self.library.row(found, np.bool_, self.n, "uint8_t[]")
        self.check(self.called(self._lib.dl2c_batch_decides, memory))
        return found

    def get_state(self, i: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """State (nx) and constants (np) of environment i, in fresh memory."""
        x, p = np.empty(self.library.sizes.nx), np.empty(self.library.sizes.np)
        self.check(self.called(self._lib.dl2c_batch_get_state, self._index(i), *self.library.state(x, p)))
        return x, p

    def states(self, places: Iterable[int]) -> NDArray[np.float64]:
        """The state and the constants of so many environments (k, nx + np), in fresh memory."""
        indices, nx = [self._index(i) for i in places], self.library.sizes.nx
        found = np.empty((len(indices), nx + self.library.sizes.np))
        read, row = self._lib.dl2c_batch_get_state, found.shape[1]
        x = self.library.row(found.reshape(-1), np.float64, found.size, "double[]")

        def read_all(handle: Any) -> int:
            status = 0
            for k, i in enumerate(indices):
                status = status or int(read(handle, i, x + k * row, x + (k * row + nx)))
            return status

        self.check(self.called(read_all))
        return found

    def set_state(self, i: int, x: Sequence[float] | NDArray[Any], p: Sequence[float] | NDArray[Any]) -> None:
        """Overwrite them as they are, mid-episode; the mask follows. For planners and tests."""
        self.check(self.called(self._lib.dl2c_batch_set_state, self._index(i), *self.library.state(x, p)))

    def save(self, i: int) -> bytes:
        """All that environment i keeps between steps (`snapshot_size` bytes)."""
        kept = np.empty(self.library.sizes.snapshot_size, np.uint8)
        memory = self.library.row(kept, np.uint8, len(kept), "uint8_t[]")
        self.check(self.called(self._lib.dl2c_batch_save, self._index(i), memory))
        return kept.tobytes()

    def restore(self, i: int, kept: bytes) -> None:
        """Go on in environment i from what `save` of the same library returned."""
        memory = self.library.row(
            np.frombuffer(kept, np.uint8), np.uint8, self.library.sizes.snapshot_size, "uint8_t[]"
        )
        self.check(self.called(self._lib.dl2c_batch_restore, self._index(i), memory))

    def close(self) -> None:
        """Free the environments, at the end of a call that is under way; the arrays stay."""
        self._turns.close()

    def _free(self) -> None:
        handle, self._handle = self._handle, self.library.ffi.NULL
        self.library.ffi.release(handle)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a batch cannot be pickled; send the model's text and options")

    def arrays(self) -> list[NDArray[Any]]:
        """All arrays that a step reads or writes."""
        return [array for _, array in self._arrays()]

    def _arrays(self) -> list[tuple[str, NDArray[Any]]]:
        """Every field of `dl2c_buffers` with its array."""
        names = [name for name, _ in self.library.ffi.typeof("dl2c_buffers").fields]
        return [(name, getattr(self, "began" if name == "reset" else name)) for name in names]

    def _index(self, i: int) -> int:
        if not 0 <= i < self.n:
            raise IndexError(f"environment {i} of a batch of {self.n}")
        return i

    def check(self, status: int) -> None:
        """As `Library.check`; `MonitorViolated` for a step that the model's monitor does not accept."""
        if status == ERR_MONITOR:
            i = int(np.flatnonzero(self.reason < 0)[0])
            number = -int(self.reason[i])
            found = [c for c in self.library.manifest.conditions if c.number == number]
            text = ", ".join(f"{c.check}: {c.text}" for c in found) or "it does not say what"
            raise MonitorViolated(
                f"environment {i} violates condition {number} of its monitor, {text}", i, number
            )
        self.library.check(status)


def load_library(directory: Path) -> Library:
    """Load the library and the manifest of a folder that `compile_library` filled.

    Builds of one model can be loaded side by side, also after the folder was built anew.
    Raises `NativeError` if the two files do not fit each other or this version of dl2c.
    """
    manifest = Manifest.read(directory / "manifest.json")
    module = load(find(directory))
    ffi, lib = module.ffi, module.lib
    found = (lib.dl2c_abi_version(), lib.dl2c_stream_version())
    if found != (manifest.abi_version, manifest.stream_version):
        raise NativeError(
            f"the library of {manifest.name} has ABI and stream version {found}, its manifest says "
            f"{(manifest.abi_version, manifest.stream_version)}; build the model again"
        )
    if any(flow.kernel == "cvodes" for flow in manifest.flows):
        load_solver(ffi, lib, manifest.options["sundials"])
    elif any(flow.kernel == "linear" for flow in manifest.flows):
        with suppress(NativeError):
            load_solver(ffi, lib, manifest.options["sundials"])
    raw = ffi.new("dl2c_sizes *")
    lib.dl2c_model_sizes(raw)
    sizes = Sizes(**{f.name: int(getattr(raw, f.name)) for f in fields(Sizes)})
    m, s = manifest, sizes
    told = (m.variables, m.constants, m.observations, m.choices, m.inputs, m.drawn_choices, m.drawn_inputs)
    masked = sum(len(choice.alternatives) for choice in m.choices)
    described = (*map(len, (*told, m.predicates, m.flows)), masked)
    wanted = (s.nx, s.np, s.nobs, s.nchoice, s.ninput, s.nenvchoice, s.nenvinput, s.npred, s.nflow, s.nmask)
    if described != wanted:
        raise NativeError(f"the manifest of {manifest.name} describes another library; build the model again")
    return Library(manifest, sizes, ffi, lib)


def _code(option: str, value: str, codes: dict[str, int]) -> int:
    if value not in codes:
        raise ValueError(f"`{option}` takes {', '.join(map(repr, codes))}, not {value!r}")
    return codes[value]
