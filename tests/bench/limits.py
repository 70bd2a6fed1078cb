"""What is required of rows against the version of dl2c before work on its speed began."""

import subprocess
from collections.abc import Mapping
from pathlib import Path

START = "eab7dad02074c768933ec131fa63f3727f3035ae"
"""The revision that these ratios are of."""

ENVIRONMENTS: Mapping[str, float] = {
    "batch1": 0.97,
    "batch1024": 0.97,
    "waypoint/batch1024": 1.4,
    "bouncing_ball/batch1024": 2.5,
    "passive_safety/batch1024": 2.5,
    "acc/batch1024": 2.5,
    "dubins/dopri1024": 1.2,
    "waypoint/vector1024-batch1024": 4.0,
    "waypoint/shared1024-batch1024": 1 / 0.12,
}
"""Of `against.py`, in every example or in one. What a vector environment adds is asked where a batch is fast
enough to show it.
"""

COMMANDS: Mapping[str, float] = {
    "waypoint/build-cold": 1 / 0.45,
    "all/build-cold": 2.0,
    "build-debug": 4.0,
    "build-edited/build-cold": 2.0,
    "version/imports": 1 / 3,
    "build-kept": 2.0,
    "check": 2.0,
    "info": 2.0,
    "report": 1 / 0.3,
}
"""Of `against.py --start`."""

TRAININGS = 3.0
"""Of `trainings.py`, in every example."""


def is_start(revision: str) -> bool:
    """Whether that is the revision. Raises `CalledProcessError` for one that git lacks."""
    command = ["git", "rev-parse", "--verify", f"{revision}^{{commit}}"]
    here = Path(__file__).parent
    found = subprocess.run(command, cwd=here, capture_output=True, text=True, check=True)
    return found.stdout.strip() == START
