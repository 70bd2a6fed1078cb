"""A monitor with a program around it that asks it about a stream of records, on the host or a Cortex-M4.

The program is in tests/target, which has the form of records and verdicts too.
"""

import shutil
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY
from monitor_program import Values
from numpy.typing import NDArray

from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.monitor.check import KINDS, Kind
from dl2c.native.toolchain import EXACT_FLAGS, STRICT_FLAGS

SOURCES = REPOSITORY / "tests" / "target"
PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
CROSS = "arm-none-eabi-gcc"
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb")
HARD = ("-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
"""The unit of a Cortex-M4F; it knows single precision alone."""

SOFT = ("-mfloat-abi=soft",)
QEMU = ("qemu-system-arm", "-M", "mps2-an386", "-display", "none", "-serial", "none", "-monitor", "none")
SECONDS = 500

Records = NDArray[np.floating]
Verdicts = NDArray[np.void]


def needed(program: str, packages: str = PACKAGES) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed: apt install {packages}")


@dataclass(frozen=True, slots=True)
class Asked:
    """A unit and the program that asks it."""

    unit: Unit
    path: Path

    def verdicts(self, records: Records) -> Verdicts:
        """On the host, one for each record: `id` and `value`."""
        data = records.astype(number_of(self.unit)).tobytes()
        done = subprocess.run([self.path], input=data, capture_output=True, check=True)
        return np.frombuffer(done.stdout, answer_of(self.unit))

    def emulated(self, records: Records) -> Verdicts:
        """By the processor that qemu emulates."""
        folder = self.path.parent
        (folder / "records").write_bytes(records.astype(number_of(self.unit)).tobytes())
        command = [*QEMU, "-semihosting-config", "enable=on,target=native", "-kernel", str(self.path)]
        subprocess.run(command, cwd=folder, check=True, timeout=SECONDS, stdin=subprocess.DEVNULL)
        return np.frombuffer((folder / "verdicts").read_bytes(), answer_of(self.unit))


def number_of(unit: Unit) -> str:
    return "<f4" if unit.single else "<f8"


def answer_of(unit: Unit) -> np.dtype[np.void]:
    return np.dtype([("id", "<i4"), ("value", number_of(unit))])


def on_host(unit: Unit, folder: Path, *flags: str, compiler: str = "gcc") -> Asked:
    needed(compiler, compiler)
    written(unit, folder)
    sources = [str(folder / f"{unit.stem}_monitor.c"), str(SOURCES / "verdicts.c"), str(SOURCES / "host.c")]
    command = [compiler, *C_FLAGS, *flags, "-O2", f"-I{folder}", f"-I{SOURCES}", *sources]
    compiled([*command, "-o", "program", "-lm"], folder)
    return Asked(unit, folder / "program")


def on_target(unit: Unit, folder: Path, floats: tuple[str, ...]) -> Asked:
    """Without an operating system; of the C library only its `-lm` and copying of memory."""
    needed(CROSS)
    needed(QEMU[0])
    written(unit, folder)
    sources = [str(folder / f"{unit.stem}_monitor.c")]
    sources += [str(SOURCES / name) for name in ("verdicts.c", "cortex_m4.c")]
    machine = [CROSS, *CORTEX_M4, *floats, "-ffreestanding", "-nostdlib", f"-T{SOURCES / 'cortex_m4.ld'}"]
    command = [*machine, *C_FLAGS, "-Os", f"-I{folder}", f"-I{SOURCES}", *sources]
    compiled([*command, "-o", "program.elf", "-lm", "-lc", "-lm", "-lgcc"], folder)
    return Asked(unit, folder / "program.elf")


C_FLAGS = ("-std=c11", *STRICT_FLAGS, *EXACT_FLAGS)


def compiled(command: Sequence[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]


def written(unit: Unit, folder: Path) -> None:
    """The monitor, and what tests/target/verdicts.c knows of it."""
    folder.mkdir(parents=True, exist_ok=True)
    files = monitor_files(unit)
    for name in (f"{unit.stem}_monitor.h", f"{unit.stem}_monitor.c"):
        (folder / name).write_text(files[name], encoding="utf-8")
    (folder / "monitor_checks.h").write_text(_checks_h(unit), encoding="utf-8")


def _checks_h(unit: Unit) -> str:
    stem = unit.stem
    types = [f"typedef {stem}_{name} monitor_{name};" for name in ("state", "parameters", "verdict")]
    cases: list[str] = []
    for check in unit.monitor.checks:
        states = "before, after" if check.transition else "before"
        call = f"return {stem}_check_{check.kind}({states}, parameters);"
        cases += [f"  case {KINDS.index(check.kind)}:", f"    {call}"]
    value = "verdict->unknown ? 1 : 0" if unit.sound else "verdict->val"
    return "\n".join(
        [
            f'#include "{stem}_monitor.h"',
            f"typedef {unit.real} real;",
            *types,
            f"enum {{ STATE = {len(unit.monitor.model.variables)}, PARAMETERS = {len(unit.parameters)} }};",
            f"static real monitor_value(const monitor_verdict *verdict) {{ return {value}; }}",
            "static monitor_verdict monitor_check(int check, const monitor_state *before,",
            "  const monitor_state *after, const monitor_parameters *parameters)",
            "{",
            "  const monitor_verdict none = {-1, 0};",
            "  (void)after;",
            "  switch (check) {",
            *cases,
            "  default:",
            "    return none;",
            "  }",
            "}\n",
        ]
    )


def record(kind: Kind, parts: Sequence[Values]) -> list[float]:
    """A record of the states, one or two, and the parameters."""
    states = [*parts[:-1], *parts[:-1]][:2]
    return [float(KINDS.index(kind)), *(v for part in (*states, parts[-1]) for v in part.values())]


def records_of(rows: Iterable[Sequence[float]]) -> Records:
    return np.array(list(rows), dtype=np.float64)
