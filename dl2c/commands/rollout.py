"""`dl2c rollout`: run a policy, here or on a cluster, say how its episodes ended, write every step."""

import csv
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from dl2c.commands.arguments import Episodes, Film, Masked, Model, PolicyName, Seed, check_film
from dl2c.commands.failures import CommandError, to_json
from dl2c.commands.flags import Json
from dl2c.commands.verbosity import quiet
from dl2c.commands.waiting import working
from dl2c.outputs import output_file

if TYPE_CHECKING:
    from dl2c.report.episode import Episode

Block: TypeAlias = Mapping[str, list[Any]]
"""Some rows, as columns."""

TOLD = ("time", "reward", "terminated", "truncated", "status", "reason")
"""The columns that the summary is made of."""

Ray = Annotated[
    bool, typer.Option("--ray", help="Run on a Ray cluster: RAY_ADDRESS, one running here, or this machine.")
]
Address = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Run on the Ray cluster at this address.")
]
Mixed = Annotated[bool, typer.Option("--allow-mixed", help="Accept nodes that may round differently.")]


def rollout(
    model: Model,
    policy: PolicyName = "random",
    episodes: Episodes = 1,
    seed: Seed = 0,
    masked: Masked = True,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="Write every step to this file.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Write every step to this file.")] = None,
    save_failures: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write each failed episode to a file for `dl2c replay`."),
    ] = None,
    film: Film = None,
    ray: Ray = False,
    address: Address = None,
    allow_mixed: Mixed = False,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Run a policy and say how its episodes ended; with --csv or --parquet, every step."""
    run = (policy, model, episodes, seed, masked)
    seen = _Ended(save_failures, film)
    with working(f"running {episodes} episodes of {model}") as note:
        if ray or address is not None:
            seen.refuse()
            tables = _on_cluster(run, note, address=address, allow_mixed=allow_mixed, **options)
            blocks = _stored(tables, parquet, csv_file is None)
        elif parquet is not None:
            blocks = _stored(_as_tables(run, seen, options), parquet, csv_file is None)
        else:
            blocks = _blocks(_here(run, seen, options))
        if csv_file is not None:
            blocks = _written(blocks, csv_file)
        summary = _summary(blocks, episodes)
    seen.show()
    if json:
        print(to_json(summary))
    else:
        _show(summary)


# Where the rows come from ------------------------------------------------------


class _Ended:
    """What becomes of episodes that have ended, besides rows: files of failures, a film."""

    def __init__(self, failures: Path | None, film: Path | None) -> None:
        self._failures, self._film = failures, film
        self._seen: list[Episode] = []
        self._failed = False
        check_film(film)

    @property
    def wanted(self) -> bool:
        """Whether episodes are to be recorded."""
        return self._failures is not None or self._film is not None

    def refuse(self) -> None:
        """Raises `CommandError` where something is wanted, of episodes that are run elsewhere."""
        if self.wanted:
            option = "--film" if self._failures is None else "--save-failures"
            raise CommandError(f"{option} is for episodes run here, without --ray and --address")

    def __call__(self, episode: "Episode") -> None:
        """One has ended."""
        from dl2c.report.recording import failures_to

        self._failed |= episode.status == "failure"
        if self._failures is not None:
            failures_to(self._failures)(episode)
        if self._film is not None:
            self._seen.append(episode)

    def show(self) -> None:
        """Make the film; say where there are no failures to save."""
        if self._failures is not None and not self._failed and not quiet():
            print("no episode failed, so none is saved", file=sys.stderr)
        if self._film is not None:
            from dl2c.report.film import write_film

            with working(f"making {self._film}"):
                write_film(self._seen, self._film)


def _here(run: tuple[Any, ...], ended: _Ended, options: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    from dl2c.training.rollout import rollout as rows

    if not ended.wanted:
        return rows(*run, **options)
    from dl2c.report.recording import Recorder

    return rows(*run, around=lambda env: Recorder(env, ended), **options)


def _as_tables(run: tuple[Any, ...], ended: _Ended, options: Mapping[str, Any]) -> Iterable[Any]:
    from dl2c.env.opening import open_library, source_of
    from dl2c.training.tables import schema, tables

    shape = schema(open_library(source_of(run[1]), options).manifest)
    return tables(_here(run, ended, options), shape)


def _on_cluster(run: tuple[Any, ...], note: Callable[[str], None], **options: Any) -> Iterator[Any]:
    from dl2c.ray import SweepFailed
    from dl2c.ray import rollout as sweep

    def say(done: int) -> None:
        note(f"{done} done")

    try:
        yield from sweep(*run, note=say, **options)
    except SweepFailed as failure:
        raise CommandError(str(failure)) from None


def _blocks(rows: Iterator[dict[str, Any]]) -> Iterator[Block]:
    while some := list(islice(rows, 1000)):
        yield {name: [row[name] for row in some] for name in some[0]}


# What becomes of them ----------------------------------------------------------


def _stored(tables: Iterable[Any], path: Path | None, briefly: bool) -> Iterator[Block]:
    """Pass tables on, `briefly` only what the summary needs, and write them to a Parquet file.

    As with CSV, a file is opened when there is something to write: a mistake in the model leaves it alone.
    """
    from dl2c.training.tables import arrow, lists

    with ExitStack() as files:
        file: Any = None
        for table in tables:
            if path is not None:
                if file is None:
                    fresh = files.enter_context(output_file(path))
                    file = files.enter_context(arrow("pyarrow.parquet").ParquetWriter(fresh, table.schema))
                file.write_table(table)
            names = TOLD if briefly else table.column_names
            yield dict(zip(names, lists(table, names), strict=True))


def _written(blocks: Iterable[Block], path: Path) -> Iterator[Block]:
    """Pass blocks on and write them to a CSV file."""
    with ExitStack() as files:
        writer: Any = None
        for block in blocks:
            if writer is None:
                fresh = files.enter_context(output_file(path))
                writer = csv.writer(files.enter_context(fresh.open("w", newline="", encoding="utf-8")))
                writer.writerow(block)
            writer.writerows(zip(*block.values(), strict=True))
            yield block


def _summary(blocks: Iterable[Block], episodes: int) -> dict[str, Any]:
    rows, total, duration = 0, 0.0, 0.0
    ends: Counter[tuple[str, str]] = Counter()
    for block in blocks:
        for time, reward, terminated, truncated, status, reason in zip(
            *(block[name] for name in TOLD), strict=True
        ):
            rows, total = rows + 1, total + reward
            if terminated or truncated:
                ends[status, reason] += 1
                duration += time
    return {
        "episodes": episodes,
        "steps": rows - episodes,
        "mean_return": total / episodes,
        "mean_time": duration / episodes,
        "ends": [{"status": s, "reason": r, "episodes": n} for (s, r), n in sorted(ends.items())],
    }


def _show(summary: Mapping[str, Any]) -> None:
    print(f"{summary['episodes']} episodes, {summary['steps']} steps, ", end="")
    print(f"mean return {summary['mean_return']:.6g}, mean duration {summary['mean_time']:.6g} s")
    for end in summary["ends"]:
        print(f"{end['episodes']:>6}  {end['status']}: {end['reason']}")
