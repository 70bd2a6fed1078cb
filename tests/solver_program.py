"""Builds `solver_program.c` and talks to it: flows followed by the CVODES kernel, as tracks."""

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from dl2c.code import cgen_dir
from dl2c.native.sundials import casadi_library
from dl2c.native.toolchain import CODE_FLAGS, EXACT_FLAGS, STRICT_FLAGS

SOURCE = Path(__file__).with_name("solver_program.c")
NX = 6

DECAY, OSCILLATOR, ROBERTSON, ROCKET, BALL, BLOW_UP, UNDEFINED, DUBINS, STIFF, DRAIN, PENDULUM = range(11)
NOT_STIFF, ALWAYS_STIFF, AUTO = range(3)


def build(
    output: Path, command: str = "cc", flags: Sequence[str] = (), libraries: Sequence[str] = ()
) -> Path:
    """Compile the program, warnings being errors; what nobody calls is allowed."""
    strict = (*STRICT_FLAGS, "-Wno-unused-function", "-D_GNU_SOURCE")
    folders = [f"-I{cgen_dir() / name}" for name in ("include", "runtime")]
    linked = (*libraries, "-pthread", "-ldl", "-lm")
    arguments = (*CODE_FLAGS, *strict, *flags, *EXACT_FLAGS, *folders, SOURCE, "-o", output, *linked)
    subprocess.run((command, *arguments), check=True)
    return output


@dataclass(frozen=True)
class Track:
    """One internal step; `c[k]` are the coefficients of variable k in s, `end` is the state at s = 1."""

    start: float
    length: float
    c: tuple[tuple[float, ...], ...]
    end: tuple[float, ...]

    @property
    def degree(self) -> int:
        return len(self.c[0]) - 1

    def at(self, k: int, s: float) -> float:
        """Variable k at s, correctly rounded."""
        exact = Fraction(s)
        return float(sum((Fraction(c) * exact**i for i, c in enumerate(self.c[k])), Fraction(0)))


@dataclass(frozen=True)
class Answer:
    """What the program wrote: tracks of each flow, whether it was followed to its end, other numbers."""

    text: str
    flows: tuple[tuple[Track, ...], ...]
    done: tuple[bool, ...]
    numbers: tuple[tuple[float, ...], ...]


def ask(program: Path, *commands: str, library: Path | None = None, **environment: str) -> Answer:
    """Run commands; the program must not write to stderr."""
    result = subprocess.run(
        (program, library or casadi_library()),
        input="\n".join(commands),
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.stderr == ""
    assert result.returncode == 0, result.stdout
    flows: list[tuple[Track, ...]] = []
    done: list[bool] = []
    numbers: list[tuple[float, ...]] = []
    tracks: list[Track] = []
    for line in result.stdout.splitlines():
        match line.split():
            case ["track", start, length, degree, *rest]:
                tracks.append(_track(start, length, int(degree) + 1, [float.fromhex(w) for w in rest]))
            case ["done" | "failed" as how]:
                flows.append(tuple(tracks))
                done.append(how == "done")
                tracks = []
            case ["time" | "values", *rest]:
                numbers.append(tuple(float.fromhex(w) for w in rest))
            case _:
                pass
    return Answer(result.stdout, tuple(flows), tuple(done), tuple(numbers))


def solver(stiff: int = NOT_STIFF, rtol: float = 1e-8, atol: float = 1e-10) -> str:
    """The command that makes a solver."""
    return f"new {stiff} {rtol.hex()} {atol.hex()}"


def flow(
    kind: int, stop: float, x: Sequence[float], p: float = 0.0, command: str = "run", extra: str = ""
) -> str:
    """A command for a flow from x; variables after those given are 0, `extra` comes before them."""
    state = [*x, *[0.0] * (NX - len(x)), p]
    return f"{command} {kind} {float(stop).hex()} {extra} " + " ".join(float(v).hex() for v in state)


def _track(start: str, length: str, size: int, values: list[float]) -> Track:
    rows = tuple(tuple(values[k * size : (k + 1) * size]) for k in range(NX))
    return Track(float.fromhex(start), float.fromhex(length), rows, tuple(values[NX * size :]))
