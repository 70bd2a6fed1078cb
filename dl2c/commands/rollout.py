"""`dl2c rollout`: run a policy, say how its episodes ended, write every step."""

import csv
from collections import Counter
from collections.abc import Mapping
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

    keep = None if save_failures is None else failures_to(save_failures)
    recorded = {} if keep is None else {"around": lambda env: Recorder(env, keep)}
    rows = list(run(policy, model, episodes, seed, masked, **recorded, **options))
    if csv_file is not None:
        with csv_file.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, tuple(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    last = [row for row in rows if row["terminated"] or row["truncated"]]
    ends = Counter((row["status"], row["reason"]) for row in last)
    summary = {
        "episodes": episodes,
        "steps": len(rows) - episodes,
        "mean_return": sum(row["reward"] for row in rows) / episodes,
        "mean_time": sum(row["time"] for row in last) / episodes,
        "ends": [{"status": s, "reason": r, "episodes": n} for (s, r), n in sorted(ends.items())],
    }
    if json:
        print(to_json(summary))
        return
    print(
        f"{episodes} episodes, {summary['steps']} steps, mean return {summary['mean_return']:.6g}, ", end=""
    )
    print(f"mean duration {summary['mean_time']:.6g} s")
    for (status, reason), count in sorted(ends.items()):
        print(f"{count:>6}  {status}: {reason}")
