"""An open file: its text, what is known of it, and what is known of an earlier text while that is found out.

The text is analysed in a thread, so that questions are answered meanwhile, from the last analysis with its
places moved to where they are now, or where there is none from that of the entry around the place, or from
the sections of the text. An analysis of a text that has changed since is stopped and dropped. What needs
more time than an analysis is then asked of the `Checker`; until it answers again, what it found before stays
where the text did not change.
"""

import asyncio
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dl2c.configuration import configured
from dl2c.diagnostics import CompileError, Diagnostic, in_source_order, warning
from dl2c.lsp.analysis import Analysis, analyse, skimmed
from dl2c.lsp.checker import Checker, Report, found_in
from dl2c.lsp.context import nearby
from dl2c.lsp.hover import Limits
from dl2c.lsp.positions import UNCHANGED, Encoding, Lines, Shift, normal
from dl2c.options import Options
from dl2c.progress import LOG
from dl2c.source import Source, Span

PATIENCE = 0.05
"""Seconds that an answer waits for the analysis of the present text, before an earlier one has to do."""

LONG_PATIENCE = 5.0
"""Seconds that it waits where there is no earlier one, or where that will not do."""

LONG = 20_000
"""Characters of a text that is not analysed at once."""

HEAD_START = 0.03
"""Seconds by which a question that comes with a new file is before the analysis of all of it."""

ANSWERING = 0.3
"""Seconds in which an answer is written after it is known what from; analyses wait for it."""

SENDING = 0.03
"""Seconds that it takes to send a short answer, for which they wait too. A long one, which took some time to
write, takes about twice that time.
"""

MOST_WAITING = 1.0
"""Seconds that one analysis waits for answers in all."""

PAUSE = 0.7
"""Seconds without a change before solvers are asked."""


SOLVED = frozenset(
    {
        *("dead-alternative", "constant-test", "deadlock", "postcondition-not-safe", "non-potential-shaping"),
        *("undecided-precondition", "unsampled-precondition"),
    }
)
"""Codes of warnings that solvers find."""


@dataclass(frozen=True, slots=True)
class Checked:
    """What the checker found in the text of an entry. `all` where solvers were asked too."""

    text: str
    source: Source
    found: tuple[Diagnostic, ...] = ()
    limits: Limits = field(default_factory=dict[str, tuple[float, float]])
    all: bool = False


@dataclass(frozen=True, slots=True)
class View:
    """What is known when a question is asked. `shift` leads from the text of the analysis to the present."""

    analysis: Analysis
    lines: Lines
    shift: Shift
    limits: tuple[Limits, ...]

    @property
    def fresh(self) -> bool:
        """Whether the analysis is of the present text."""
        return self.analysis.source.text == self.lines.text


class Document:
    """`published` is told when diagnostics have changed; `failed` of what went wrong in dl2c itself.

    `coloured_before` says whether colours were asked before the present text was analysed.
    """

    def __init__(
        self,
        name: str,
        encoding: Encoding,
        executor: Executor,
        checker: Checker,
        published: Callable[["Document"], None],
        failed: Callable[[str], None],
    ) -> None:
        self.name = name
        self.ending = "\n"
        self.version: int | None = None
        self.diagnostics: tuple[Diagnostic, ...] = ()
        self.coloured_before = False
        self._encoding: Encoding = encoding
        self._executor, self._checker = executor, checker
        self._published, self._failed = published, failed
        self._source = Source(name, "")
        self.lines = Lines("", encoding)
        self._nothing = Analysis(self._source)
        self._latest = self._known = self._nothing
        self._checked: tuple[Checked, ...] = ()
        self._fresh = asyncio.Event()
        self._begun = self._quiet = 0.0  # when an answer was begun, and until when analyses wait for it
        self._took = 0.0  # seconds, for the last analysis of a whole text, without waiting for answers
        self._part = self._sections = self._nothing
        self._alone = threading.Lock()
        self._running: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    def change(self, text: str, version: int | None) -> None:
        """Take a new text, and begin to find out about it."""
        first = text.find("\n")
        self.ending = "\r\n" if first > 0 and text[first - 1] == "\r" else "\n"
        self.version = version
        plain = normal(text)
        self._source = Source(self.name, plain)
        self.lines = Lines(plain, self._encoding)
        self._fresh.clear()
        self._checker.forget(self)
        if self._running is None or self._running.done():
            self._running = asyncio.ensure_future(self._follow())

    def close(self) -> None:
        """Nobody asks any more."""
        self._source = Source(self.name, "")
        self._checker.forget(self)

    async def view_at(self, place: tuple[int, int]) -> View:
        """What is known, enough for a question about the entry around a line and column."""
        if self._known is self._nothing:
            lines = self.lines
            part, shift = nearby(lines.text, lines.offset(place))
            if part != lines.text:
                return View(await self._analysed_first(Source(self.name, part)), lines, shift, ())
        return await self.view()

    async def view_of_sections(self) -> View:
        """What is known, or of a text that has just been opened its sections and comments."""
        if self._known is not self._nothing:
            return await self.view()
        self._begin()
        source, lines = self._source, self.lines
        if self._sections.source is not source:
            loop = asyncio.get_running_loop()
            self._sections = await loop.run_in_executor(self._executor, skimmed, source)
        return View(self._sections, lines, UNCHANGED, ())

    @property
    def long(self) -> bool:
        """Whether the analysis of all of the text takes a while."""
        return len(self.lines.text) > LONG

    @property
    def settled(self) -> bool:
        """Whether the analysis of the present text is known."""
        return self._fresh.is_set()

    async def view(self, patience: float | None = None) -> View:
        """What is known, of the present text if that is found out soon enough: as a rule in `PATIENCE`, for
        which a text is not waited for that took much longer before.
        """
        if not self._fresh.is_set():
            if self._known is self._nothing:
                patience = LONG_PATIENCE
            elif patience is None:
                patience = PATIENCE if self._took <= 4 * PATIENCE else 0.0
            with suppress(TimeoutError):
                await asyncio.wait_for(self._fresh.wait(), patience)
        self._begin()
        known = self._known
        return View(
            known,
            self.lines,
            Shift.between(known.source.text, self.lines.text),
            tuple(c.limits for c in self._checked) if known is self._latest else (),
        )

    def _begin(self) -> None:
        """An answer is written from now on."""
        self._begun = time.monotonic()
        self._quiet = self._begun + ANSWERING

    def answered(self) -> None:
        """The answer is known, and will be sent now."""
        now = time.monotonic()
        took = now - self._begun if now < self._quiet else 0.0
        self._quiet = now + min(SENDING + 2 * took, ANSWERING)

    # -------------------------------------------------------------- analysis

    async def _analysed_first(self, part: Source) -> Analysis:
        """The analysis of a part, for which that of the whole text waits, but not for too long."""
        until = time.monotonic() + LONG_PATIENCE

        def work() -> Analysis:
            with self._alone:
                if self._part.source.text != part.text:
                    self._part = _analysed(part, self._folder, lambda: time.monotonic() > until)
                return self._part

        return await asyncio.get_running_loop().run_in_executor(self._executor, work)

    async def _follow(self) -> None:
        """Analyse until the text no longer changes."""
        while self._latest.source is not self._source:
            source = self._source
            analysis = await self._analysed(source)
            if source is self._source:
                self._take(analysis)

    async def _analysed(self, source: Source) -> Analysis:
        waited = 0.0

        def stopped() -> bool:
            nonlocal waited
            while (left := self._quiet - time.monotonic()) > 0 and waited < MOST_WAITING:
                time.sleep(pause := min(left, SENDING / 3))
                waited += pause
            with self._alone:
                return source is not self._source

        def work() -> Analysis:
            begun = time.monotonic()
            stopped()
            found = _analysed(source, self._folder, stopped)
            if source is self._source:
                self._took = time.monotonic() - begun - waited
            return found

        try:
            if self._known is self._nothing:
                await asyncio.sleep(HEAD_START)
            return await asyncio.get_running_loop().run_in_executor(self._executor, work)
        except Exception as failure:
            LOG.error("%s", traceback.format_exc())
            self._failed(f"a bug of dl2c: {type(failure).__name__}: {failure}")
            return Analysis(source, diagnostics=(_bug(source, f"{type(failure).__name__}: {failure}"),))

    @property
    def _folder(self) -> Path:
        folder = Path(self.name).parent
        return folder if folder.is_dir() else Path.cwd()

    def _take(self, analysis: Analysis) -> None:
        """Show what the analysis of the present text found, with what the checker found before."""
        self._checked = _carried(self._checked, analysis)
        self._latest = analysis
        if analysis.names.entries or not self._known.names.entries:
            self._known = analysis
        self._fresh.set()
        self._show()
        todo = [n for n, p in enumerate(analysis.problems) if p is not None and not self._checked[n].all]
        if todo:
            task = {"name": self.name, "text": self._source.text, "entries": todo}
            task |= {"folder": str(self._folder), "pause": PAUSE}
            self._tasks.add(job := asyncio.ensure_future(self._check(task, self._source)))
            job.add_done_callback(self._tasks.discard)

    async def _check(self, task: Mapping[str, Any], source: Source) -> None:
        def told(report: Report) -> None:
            if source is self._source:
                self._take_report(report)

        try:
            await self._checker.check(self, task, told)
        except OSError as failure:
            self._failed(f"the checks that need more time cannot be started: {failure}")

    def _take_report(self, report: Report) -> None:
        if "failure" in report:
            LOG.error("%s: %s", self.name, report["failure"])
            self._failed(str(report["failure"]))
        if "entry" not in report:
            return
        number: int = report["entry"]
        before = self._checked[number]
        limits = {name: (low, high) for name, (low, high) in report.get("limits", before.limits).items()}
        found = found_in(report, self._source)
        if not report["all"]:  # what solvers found before stays until they are asked again
            found += tuple(d for d in before.found if d.code in SOLVED and d not in found)
        now = Checked(before.text, self._source, found, limits, report["all"])
        self._checked = (*self._checked[:number], now, *self._checked[number + 1 :])
        self._show()

    def _show(self) -> None:
        """Everything that is known; of an entry with errors, these alone. Where there are errors of syntax,
        what the checker found stays where the text is the same.
        """
        found = list(self._latest.diagnostics)
        if self._latest.problems:
            for problem, checked in zip(self._latest.problems, self._checked, strict=True):
                found += checked.found if problem is not None else ()
        else:
            found += (d for c in self._checked for d in _moved(c, self._latest.source))
        self.diagnostics = in_source_order(found)
        self._published(self)


def _bug(source: Source, what: str) -> Diagnostic:
    label = "nothing is known of this text; please report it with the model"
    return warning("internal-error", f"a bug of dl2c: {what}", source.start, label)


def _analysed(source: Source, folder: Path, stopped: Callable[[], bool]) -> Analysis:
    """The analysis under the options of the project around a folder, or else why these are not options."""
    try:
        options = configured(Options(), folder)
    except CompileError as refused:
        found = analyse(source, Options(), stopped)
        wrong = (replace(d, span=source.start, label=d.span.place) for d in refused.diagnostics)
        return replace(found, diagnostics=in_source_order((*found.diagnostics, *wrong)))
    return analyse(source, options, stopped)


def _carried(before: tuple[Checked, ...], new: Analysis) -> tuple[Checked, ...]:
    """What the checker found, moved to the new text: of entries whose text is the same, all; of others what
    stands where nothing changed, until they are checked again.
    """
    if not new.problems:
        return before
    by_text = {c.text: c for c in before if c.all}
    found: list[Checked] = []
    for number in range(len(new.problems)):
        text = _text_of(new, number)
        same = by_text.get(text)
        kept = same or (before[number] if number < len(before) else Checked(text, new.source))
        found.append(Checked(text, new.source, _moved(kept, new.source), kept.limits, same is not None))
    return tuple(found)


def _moved(checked: Checked, source: Source) -> tuple[Diagnostic, ...]:
    """What was found, at its places in a later text, but for what has changed there."""
    if checked.source is source or not checked.found:
        return checked.found
    shift = Shift.between(checked.source.text, source.text)
    return tuple(
        replace(d, span=Span(source, *shift.later(d.span.start, d.span.end)))
        for d in checked.found
        if not shift.touches(d.span.start, d.span.end)
    )


def _text_of(analysis: Analysis, number: int) -> str:
    """All that the check of an entry depends on: its text and that before all entries."""
    text = analysis.source.text
    spans = [e.span for e in analysis.entries]
    if not spans:
        return text
    return f"{text[: spans[0].start]}\0{text[spans[number].start : spans[number].end]}"
