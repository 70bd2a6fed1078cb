"""How fast two trees' commands are: how often they are done in a second of processor time, children's too."""

import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree, rmtree

Rates = dict[str, list[float]]
Environment = Callable[[Path], Mapping[str, str]]

TRAINED = ("--steps", "2048", "--n-envs", "8", "--algo", "ppo")
"""A training for a report."""


@dataclass(frozen=True, slots=True)
class Command:
    """What is started; a `cold` one finds nothing that is kept, a `first` one what the training left, an
    `edited` one a model with another reward. `program` is what Python runs. In a tree without the flag
    `--debug` it is left out.
    """

    row: str
    words: tuple[str, ...]
    cold: bool = False
    first: bool = False
    edited: bool = False
    program: tuple[str, ...] = ("-m", "dl2c")


OWN = (("build-edited", "build-cold"), ("version", "imports"))
"""Rows that are compared in one tree too, as `build-edited/build-cold`: how much faster the first is."""


def commands_of(model: str, run: str, edited: str) -> tuple[Command, ...]:
    """What people do with a model, with a copy that they edit, and with the folder of a training."""
    return (
        Command("imports", ("-c", "import typer, rich.console"), program=()),
        Command("version", ("--version",)),
        Command("build-kept", ("build", model)),
        Command("check", ("check", model)),
        Command("info", ("info", model)),
        Command("build-cold", ("build", model), cold=True),
        Command("build-debug", ("build", model, "--debug"), cold=True),
        Command("build-edited", ("build", edited), edited=True),
        Command("report", ("report", run, "--episodes", "50"), first=True),
        Command("report-kept", ("report", run, "--episodes", "50")),
    )


def seconds_of_commands(
    trees: Sequence[Path], examples: Sequence[str], environment: Environment, rounds: int
) -> Iterator[tuple[str, Rates, Rates]]:
    """By example, for both trees and each command, how often it is done in a second."""
    for example in examples:
        rates: list[Rates] = [{}, {}]
        for tree in trees:
            run, left = _run_of(tree, example), _left_by_training(tree)
            rmtree(run, ignore_errors=True)
            rmtree(left, ignore_errors=True)
            given = {**environment(tree), "DL2C_CACHE_DIR": str(left)}
            train = ("-m", "dl2c", "train", f"examples/{example}.kyx", "-o", str(run), *TRAINED)
            _seconds(tree, train, given)
            list(_round(tree, example, environment(tree)))  # so that all is kept
        for turn in range(rounds):
            for k in in_turn(len(trees), turn):
                for row, rate in _round(trees[k], example, environment(trees[k])):
                    rates[k].setdefault(row, []).append(rate)
        for first, second in OWN:
            rates[0][f"{first}/{second}"] = rates[0][first]
            rates[1][f"{first}/{second}"] = rates[0][second]
        yield example, rates[0], rates[1]


def kept(tree: Path) -> Path:
    """The folder for what a benchmark leaves in a tree, which git ignores."""
    return tree / "build" / "benchmark"


def in_turn(count: int, turn: int) -> list[int]:
    """The order of trees in a round: each is first as often as last."""
    return sorted(range(count), reverse=turn % 2 == 1)


def _run_of(tree: Path, example: str) -> Path:
    return kept(tree) / example


def _left_by_training(tree: Path) -> Path:
    """The cache in which the training for a report was done."""
    return kept(tree) / "trained"


def with_another_reward(text: str, number: int) -> str:
    """A model whose first reward or penalty has other decimals."""
    return re.sub(r"(reward|penalty)=(-?\d+)", rf"\1=\2.{number}", text, count=1)


def _round(tree: Path, example: str, given: Mapping[str, str]) -> Iterator[tuple[str, float]]:
    """Every command once."""
    own = Path(given["DL2C_CACHE_DIR"]) / "own"
    model, edited = tree / "examples" / f"{example}.kyx", kept(tree) / f"{example}.kyx"
    for command in commands_of(str(model), str(_run_of(tree, example)), str(edited)):
        rmtree(own, ignore_errors=True)
        if command.first:
            copytree(_left_by_training(tree), own)
        if command.edited:
            changed = with_another_reward(model.read_text(encoding="utf-8"), time.time_ns())
            edited.write_text(changed, encoding="utf-8")
        place = {"DL2C_CACHE_DIR": str(own)} if command.cold or command.first else {}
        known = _has_debug(tree)
        words = tuple(word for word in command.words if known or word != "--debug")
        yield command.row, 1.0 / _seconds(tree, (*command.program, *words), {**given, **place})


def _has_debug(tree: Path) -> bool:
    """Whether a tree's builds have the option `debug`."""
    return "    debug: bool" in (tree / "dl2c" / "options.py").read_text(encoding="utf-8")


def _seconds(tree: Path, words: Sequence[str], given: Mapping[str, str]) -> float:
    """Processor time of a command. Raises `CalledProcessError` for one that fails."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command, null = [sys.executable, *words], subprocess.DEVNULL
    subprocess.run(command, cwd=tree, env=given, stdout=null, stderr=null, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
