"""How fast `dl2c train` learns as a multiple of another revision, and whether it learns as much by then.

    python tests/bench/trainings.py REV [--examples waypoint,acc] [--algo maskable-ppo] [--steps N] \
        [--require 2]

Both trees train policies with the same seeds in turn, with the defaults of each. A row has the ratio of
environment steps per second, and by how much the policies earn more than those of the other tree, as a share
of what these earn more than a random policy; each with its interval of 95 %. Exit 1 if the upper end of a
ratio is below what is required, or that of a share below -`TOLERATED`. Needs git.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from bench.against import ROOT, checked_out, environment
from bench.intervals import Interval, interval, ratio_interval
from bench.limits import TRAININGS, is_start
from bench.processes import in_turn

WORKER = Path(__file__).with_name("training_worker.py")

SEEDS = 5

TOLERATED = 0.02
"""The share of what is learned that may be lost."""


@dataclass(frozen=True, slots=True)
class Trained:
    """Steps per second of a training, and mean returns of its policy and of one that acts at random."""

    rate: float
    learned: float
    random: float


def faster(here: Sequence[Trained], there: Sequence[Trained]) -> Interval:
    """How many times as many steps a second: the geometric mean over the seeds."""
    return ratio_interval([t.rate for t in here], [t.rate for t in there])


def better(here: Sequence[Trained], there: Sequence[Trained]) -> Interval:
    """How much more is earned, as a share of what the other tree learned."""
    gain = abs(fmean(t.learned - t.random for t in there)) or 1.0
    return interval([(a.learned - b.learned) / gain for a, b in zip(here, there, strict=True)])


def trained(tree: Path, example: str, algo: str, steps: int, seed: int) -> Trained:
    """One training in a tree. Raises `CalledProcessError` if it fails."""
    command = [sys.executable, str(WORKER), f"examples/{example}.kyx", algo, str(steps), str(seed)]
    done = subprocess.run(
        command, cwd=tree, env=environment(tree), capture_output=True, text=True, check=True
    )
    said = json.loads(done.stdout.splitlines()[-1])
    return Trained(said["rate"], said["return"], said["random"])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("revision")
    parser.add_argument("--examples", default=",".join(sorted(p.stem for p in ROOT.glob("examples/*.kyx"))))
    parser.add_argument("--algo", default="ppo", choices=("ppo", "maskable-ppo"))
    parser.add_argument("--steps", type=int, default=400_000)
    parser.add_argument("--require", type=float, metavar="RATIO", help="Else limits.py says it, or 0.")
    asked = parser.parse_args()
    required = asked.require
    if required is None:
        required = TRAININGS if is_start(asked.revision) else 0.0
    met = True
    with checked_out(asked.revision) as other:
        trees = [ROOT, other]
        print(f"{'example':20}{'times as many steps a second':36}share more that is earned")
        for example in asked.examples.split(","):
            found: list[list[Trained]] = [[], []]
            for seed in range(SEEDS):
                for k in in_turn(2, seed):
                    found[k].append(trained(trees[k], example, asked.algo, asked.steps, seed))
            speed, share = faster(*found), better(*found)
            fits = speed.high >= required and share.high >= -TOLERATED
            met = met and fits
            print(f"{example:20}{speed!s:36}{share}{'' if fits else '  FAIL'}", flush=True)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
