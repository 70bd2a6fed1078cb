"""What a training gives in one tree, asked by `trainings.py`.

    python training_worker.py MODEL ALGO STEPS SEED

prints as JSON the environment steps per second of learning and the mean return of the policy, and of one that
acts at random. PYTHONPATH says which tree is measured.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

from dl2c.training.evaluation import FIRST_SEED, outcomes
from dl2c.training.learning import train
from dl2c.training.run import Algorithm, Point, Settings

EPISODES = 200


def main() -> None:
    model, algo, steps, seed = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    chosen: Algorithm = "maskable-ppo" if algo == "maskable-ppo" else "ppo"
    seen: list[tuple[int, float]] = []

    def note(point: Point) -> None:
        seen.append((point.steps, time.perf_counter()))

    with tempfile.TemporaryDirectory() as folder:
        run = train(
            model,
            chosen,
            seed=seed,
            directory=Path(folder),
            settings=Settings(steps=steps),
            progress=note,
            whole=True,
        )
        masked = chosen == "maskable-ppo"
        learned, random = (
            float(outcomes(policy, model, EPISODES, FIRST_SEED, masked).total.mean())
            for policy in (run.policy, "random")
        )
    (first, begun), (last, ended) = seen[0], seen[-1]
    print(json.dumps({"rate": (last - first) / (ended - begun), "return": learned, "random": random}))


if __name__ == "__main__":
    main()
