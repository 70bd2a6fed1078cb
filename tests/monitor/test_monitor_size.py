"""How much code and stack the checks of an exported monitor take; both are goldens, growth fails.

What checks do not call, such as the fallback, is left out, as linkers do with `--gc-sections`. Stack is
that of the deepest chain of calls from a check, without functions of the compiler's and the C library.
Compilers differ, so a golden may be exceeded by a sixth and 32 bytes.
"""

import json
import platform
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY
from selection import quick_among
from target_program import CORTEX_M4, CROSS, HARD, needed

from dl2c.commands.monitor import unit_of
from dl2c.emit.monitor.files import monitor_files
from dl2c.emit.monitor.monitor_h import Unit
from dl2c.native.toolchain import EXACT_FLAGS

EXAMPLES = sorted(p.stem for p in (REPOSITORY / "examples").glob("*.kyx"))
GOLDEN = REPOSITORY / "tests" / "golden" / "monitor_size"
MACHINES = {
    "x86-64": ("gcc", "ld", "size"),
    "cortex-m4": (CROSS, "arm-none-eabi-ld", "arm-none-eabi-size", *CORTEX_M4),
    "cortex-m4f": (CROSS, "arm-none-eabi-ld", "arm-none-eabi-size", *CORTEX_M4, *HARD),
}
FORMS = [(real, sound) for real in ("double", "float") for sound in (False, True)]

Sizes = dict[str, dict[str, int]]


def measured(unit: Unit, machine: str, folder: Path) -> dict[str, int]:
    """Bytes of code with its constants, and of stack."""
    compiler, linker, size, *flags = MACHINES[machine]
    checks = [f"{unit.stem}_check_{check.kind}" for check in unit.monitor.checks]
    folder.mkdir(parents=True)
    for name, text in monitor_files(unit).items():
        (folder / name).write_text(text, encoding="utf-8")
    source = f"{unit.stem}_monitor.c"
    options = [
        "-std=c99",
        "-Os",
        *flags,
        "-ffreestanding",
        "-ffunction-sections",
        "-fdata-sections",
        "-fno-asynchronous-unwind-tables",
        "-fstack-usage",
        "-fcallgraph-info=su",
        *EXACT_FLAGS,
    ]
    subprocess.run([compiler, *options, "-c", source, "-o", "monitor.o"], cwd=folder, check=True)
    kept = [part for check in checks for part in ("-u", check)]
    link = [linker, "-r", "--gc-sections", "-e", checks[0], *kept, "monitor.o", "-o", "checks.o"]
    subprocess.run(link, cwd=folder, check=True)
    said = subprocess.run([size, "checks.o"], cwd=folder, check=True, capture_output=True, text=True).stdout
    text, data, bss = map(int, said.splitlines()[1].split()[:3])
    assert data == bss == 0, "a monitor has no static state"
    return {"text": text, "stack": deepest((folder / "monitor.ci").read_text(encoding="utf-8"), checks)}


def deepest(graph: str, entries: list[str]) -> int:
    """Bytes of the deepest chain from a function in what `-fcallgraph-info=su` writes."""
    node = r'title: "([^"]*)" label: "[^"]*?(\d+) bytes \((?:static|dynamic,bounded)\)'
    frames = {name: int(size) for name, size in re.findall(node, graph)}
    calls: dict[str, set[str]] = {name: set() for name in frames}
    for caller, callee in re.findall(r'sourcename: "([^"]*)" targetname: "([^"]*)"', graph):
        calls[caller].add(callee)

    def depth(name: str) -> int:
        return frames.get(name, 0) + max(map(depth, calls.get(name, ())), default=0)

    assert frames.keys() >= set(entries)
    return max(map(depth, entries))


@pytest.fixture(scope="module", params=quick_among(EXAMPLES, ("evasion", "watertank")))
def forms(request: pytest.FixtureRequest) -> tuple[str, dict[str, Unit]]:
    """An example, and its monitor in every form."""
    example: str = request.param
    return example, {
        f"{real}{' sound' * sound}": unit_of(f"example:{example}", {}, real=real, sound=sound)
        for real, sound in FORMS
    }


@pytest.mark.parametrize("machine", MACHINES)
def test_code_and_stack_do_not_grow(
    forms: tuple[str, dict[str, Unit]],
    machine: str,
    golden: Any,
    request: pytest.FixtureRequest,
    tmp_path: Path,
) -> None:
    """After a growth that is meant, write the goldens with `--update-golden`."""
    needed(MACHINES[machine][0])
    if machine == "x86-64" and platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("this is no x86-64")
    example, units = forms
    found = {name: measured(unit, machine, tmp_path / name) for name, unit in units.items()}
    path = GOLDEN / machine / f"{example}.json"
    if request.config.getoption("--update-golden"):
        golden(path, json.dumps(found, indent=1) + "\n")
    listed: Sizes = json.loads(path.read_text(encoding="utf-8"))
    assert listed.keys() == found.keys()
    for name, sizes in found.items():
        for what, size in sizes.items():
            assert size <= listed[name][what] * 7 / 6 + 32, (name, what)


@pytest.mark.parametrize("machine", ["cortex-m4f", "cortex-m4"])
def test_a_controller_check_fits_a_small_processor(machine: str, tmp_path: Path) -> None:
    needed(CROSS)
    unit = unit_of("example:waypoint", {}, ("controller",), real="float")
    assert 1000 < measured(unit, machine, tmp_path / "unit")["text"] <= 2048


def test_the_deepest_chain_is_found() -> None:
    graph = "".join(
        f'node: {{ title: "{n}" label: "{n}\\nm.c:1:2\\n{k} bytes (static)" }}\n'
        for n, k in (("a", 16), ("b", 100), ("c", 40), ("d", 64))
    )
    graph += "".join(f'edge: {{ sourcename: "{a}" targetname: "{b}" }}\n' for a, b in ("ac", "cd", "ad"))
    assert deepest(graph, ["a", "b"]) == 16 + 40 + 64
    assert deepest(graph, ["b"]) == 100
