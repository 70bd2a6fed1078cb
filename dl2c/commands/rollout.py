"""`dl2c rollout`: run a policy, say how its episodes ended, write every step."""

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from dl2c.commands.arguments import Episodes, Masked, Model, PolicyName, Seed
from dl2c.commands.failures import to_json
from dl2c.commands.flags import Json


def rollout(
    model: Model,
    policy: PolicyName = "random",
    episodes: Episodes = 1,
    seed: Seed = 0,
    masked: Masked = True,
    csv_file: Annotated[Path | None, typer.Option("--csv", help="Write every step to this file.")] = None,
    save_failures: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Write each failed episode to a file for `dl2c replay`."),
    ] = None,
    json: Json = False,
    *,
    options: Mapping[str, Any],
) -> None:
    """Run a policy and say how its episodes ended; with --csv, every step."""
    from dl2c.report.recording import Recorder, failures_to
    from dl2c.training.rollout import rollout as run

    def around(env: Any) -> Any:
        return env if save_failures is None else Recorder(env, failures_to(save_failures))

    rows = list(run(policy, model, episodes, seed, masked, around, **options))
    if csv_file is not None:
        with csv_file.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, tuple(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    summary = _summary(rows, episodes)
    if json:
        print(to_json(summary))
    else:
        _show(summary)


def _summary(rows: Sequence[Mapping[str, Any]], episodes: int) -> dict[str, Any]:
    last = [row for row in rows if row["terminated"] or row["truncated"]]
    ends = Counter((row["status"], row["reason"]) for row in last)
    return {
        "episodes": episodes,
        "steps": len(rows) - episodes,
        "mean_return": sum(row["reward"] for row in rows) / episodes,
        "mean_time": sum(row["time"] for row in last) / episodes,
        "ends": [{"status": s, "reason": r, "episodes": n} for (s, r), n in sorted(ends.items())],
    }


def _show(summary: Mapping[str, Any]) -> None:
    rates = f"mean return {summary['mean_return']:.6g}, mean duration {summary['mean_time']:.6g} s"
    print(f"{summary['episodes']} episodes, {summary['steps']} steps, {rates}")
    for end in summary["ends"]:
        print(f"{end['episodes']:>6}  {end['status']}: {end['reason']}")
