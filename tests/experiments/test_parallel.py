"""Work in several processes: what it gives, and that failures and Ctrl-C end all of it."""

import math
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from dl2c.experiments.parallel import in_parallel
from dl2c.interruption import later
from dl2c.outputs import output_folder


def silent(done: int, of: int) -> None:
    pass


def write_slowly(place: Path) -> None:
    with output_folder(place):
        (place / "begun").touch()
        time.sleep(600)


def until(there: Callable[[], bool]) -> None:
    for _ in range(6000):
        if there():
            return
        time.sleep(0.01)
    raise TimeoutError


def test_all_jobs_are_done() -> None:
    notes: list[tuple[int, int]] = []
    jobs = {n: partial(math.sqrt, n) for n in (9, 4, 1)}
    found = in_parallel(jobs, lambda done, of: notes.append((done, of)))
    assert found == {9: 3, 4: 2, 1: 1}
    assert notes == [(k, 3) for k in range(4)]


def test_a_failure_is_told_with_its_place() -> None:
    with pytest.raises(ValueError, match="math domain error") as told:
        in_parallel({"bad": partial(math.sqrt, -1), "long": partial(time.sleep, 600)}, silent)
    assert "parallel.py" in told.value.__notes__[0]
    assert not multiprocessing.active_children()


def test_a_lost_process_is_a_failure() -> None:
    with pytest.raises(RuntimeError, match="exit code 3"):
        in_parallel({"lost": partial(os._exit, 3)}, silent)


@pytest.fixture
def heeded() -> Iterator[None]:
    """Processes in the background of a shell ignore interruptions, and so would those that they start."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("everywhere", [False, True])
def test_ctrl_c_ends_all_and_leaves_nothing(
    everywhere: bool, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whether this process alone is told, or its children too, as a terminal does."""

    def interrupt() -> None:
        until((tmp_path / "out" / "begun").exists)
        for process in multiprocessing.active_children() if everywhere else ():
            os.kill(process.pid or 0, signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        in_parallel({k: partial(write_slowly, tmp_path / "out") for k in range(9)}, silent)
    assert time.monotonic() - began < 60
    assert not multiprocessing.active_children()
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["begun"]
    assert capfd.readouterr() == ("", "")


@pytest.mark.usefixtures("heeded")
def test_ctrl_c_may_come_later() -> None:
    done: list[int] = []

    def work() -> None:
        with later():
            os.kill(os.getpid(), signal.SIGINT)
            done.append(1)
        done.append(2)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == [1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ())
