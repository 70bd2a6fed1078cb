"""Measures what the pages of environments say of policies: `make environments`, half an hour on one core.

    python docs/measure.py [NAME ...] [--quick]

For each model of `examples/` it trains five policies, evaluates them beside a random and a fixed one, and
writes `docs/environments/NAME.json`, a film of one episode and a still picture of it. Needs the extras
`train` and `film`. `--quick` hardly trains, and writes to `build/environments`.
"""

import argparse
import json
import math
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from environment_pages import EXAMPLES, NUMBERS, STUDIES, TUNED, model_digest
from PIL import Image, ImageOps

from dl2c.env.opening import compilation_of, source_of
from dl2c.experiments.paper.statistics import mean_over_seeds, rate_over_seeds
from dl2c.experiments.studies.page import problem
from dl2c.outputs import write_output
from dl2c.picture.layout import FOOTER, HEADER
from dl2c.report.episode import Episode
from dl2c.report.film import FRAMES, LONGEST, frames_of
from dl2c.report.pictures import episodes_of
from dl2c.training.configured import read_configuration
from dl2c.training.evaluation import FIRST_SEED, Outcomes, outcomes
from dl2c.training.run import Algorithm, Estimate, Settings

SEEDS = (0, 1, 2, 3, 4)
EPISODES = 400
AGAIN = 2 * FIRST_SEED
"""Seed of the episodes in which the best policy is measured again: who is the best of many was lucky, too."""

TRIED = 20
"""Episodes among which the one to film is chosen."""

PICTURES, BETWEEN, LARGEST = 120, 80, 150_000
"""Pictures of a film at most, milliseconds from one to the next, and bytes at most."""

EDGE = 6
"""Blank pixels around a still picture."""


@dataclass(frozen=True, slots=True)
class Training:
    """How the policies of a model are trained, and the command that does it."""

    model: str
    algo: Algorithm
    settings: Settings
    command: str
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def masked(self) -> bool:
        """Whether its policies see masks."""
        return self.algo == "maskable-ppo"


def training_of(name: str) -> Training | None:
    """The settings of `examples/tuned`; None for a model without a file there, which decides nothing."""
    tuned = TUNED / f"{name}.yaml"
    if not tuned.exists():
        return None
    given = read_configuration(tuned)
    settings = Settings(steps=given["steps"], n_envs=given.get("n_envs"), hyper=given.get("hyper", {}))
    model = f"examples/{name}.kyx"
    command = f"dl2c train {model} --config examples/tuned/{name}.yaml"
    return Training(model, given["algo"], settings, command, given.get("options", {}))


@dataclass(frozen=True, slots=True)
class Actor:
    """A policy that is measured, and what its environments need."""

    policy: str | Path
    masked: bool = True
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def episodes(self, model: Path, seed: int) -> Outcomes:
        """What becomes of it."""
        return outcomes(self.policy, model, EPISODES, seed, self.masked, **self.options)


def measured(name: str, folder: Path, training: Training | None) -> dict[str, Any]:
    """All numbers of a model; writes its film, too."""
    model = EXAMPLES / f"{name}.kyx"
    actors = {"random": [Actor("random")], "first": [Actor("first")]}
    with tempfile.TemporaryDirectory() as scratch:
        if training is not None:
            actors["trained"] = list(trained(training, Path(scratch)))
        else:
            del actors["random"]
        found = {key: [actor.episodes(model, FIRST_SEED) for actor in some] for key, some in actors.items()}
        every = [*chain(*(zip(actors[key], found[key], strict=True) for key in actors))]
        best = max(every, key=lambda pair: float(pair[1].total.mean()))[0]
        learned = [pair for pair in every if pair[0].policy != "first"] or every
        shown = max(learned, key=lambda pair: float(pair[1].total.mean()))[0]
        rows = {key: row(some) for key, some in found.items()}
        kind = next(key for key, some in actors.items() if best in some)
        rows["best"] = row([best.episodes(model, AGAIN)]) | {"from": kind}
        film = filmed(shown, model, folder / f"{name}.webp")
    if (study := studied(name)) is not None and study["return"]["value"] > rows["best"]["return"]["value"]:
        rows["best"] = study
    return {
        "model": model_digest(compilation_of(model, {})),
        "episodes": EPISODES,
        "seeds": len(SEEDS) if training else 0,
        "command": training.command if training else "",
        "hyper": dict(training.settings.hyper) if training else {},
        "options": dict(training.options) if training else {},
        "rows": rows,
        "film": film,
    }


def trained(training: Training, folder: Path) -> Iterator[Actor]:
    """A policy of each seed."""
    from dl2c.training.learning import train

    for seed in SEEDS:
        run = train(
            EXAMPLES.parent / training.model,
            training.algo,
            seed=seed,
            directory=folder / str(seed),
            settings=training.settings,
            whole=True,
            **training.options,
        )
        print(f"{training.model} seed {seed}: {run.seconds:.0f} s", flush=True)
        yield Actor(run.policy, training.masked, training.options)


def row(found: Sequence[Outcomes]) -> dict[str, Any]:
    """The numbers of one policy, or of those of several seeds."""
    return {
        "return": asdict(mean_over_seeds([o.total for o in found])),
        "success": asdict(rate_over_seeds([o.success for o in found])),
        "violations": asdict(rate_over_seeds([o.violated for o in found])),
    }


def studied(name: str) -> dict[str, Any] | None:
    """What the policy of a study achieved with its guards, if its page is about this model; None without."""
    page = STUDIES / name / "page.md"
    if not page.exists():
        return None
    text = page.read_text(encoding="utf-8")
    if problem(source_of(EXAMPLES / f"{name}.kyx").text) not in text:
        return None
    head, *table = [line.strip("| ").split(" | ") for line in text.splitlines() if line[:1] == "|"]
    line = next(line for line in table if line[:2] == ["learned with guards", "with guards"])
    cells = dict(zip(head, line, strict=True))
    titles = {"success": "success", "violations": "violations", "return": "mean return"}
    found: dict[str, Any] = {key: asdict(written(cells[t])) for key, t in titles.items() if t in cells}
    steps = re.search(r"trained for ([\d,]+) steps", text)
    assert steps is not None, "a study says how long it trained"
    return found | {"from": "study", "steps": int(steps[1].replace(",", ""))}


def written(cell: str) -> Estimate:
    """`12.3% [4.5%, 67.8%]` or the same without percent."""
    scale = 0.01 if "%" in cell else 1.0
    return Estimate(*(round(float(number) * scale, 10) for number in re.findall(r"-?\d+\.?\d*", cell)))


def filmed(actor: Actor, model: Path, path: Path) -> dict[str, Any]:
    """Write the film of a typical episode and a still picture of it. Who acts, and how fast it is shown."""
    episodes = episodes_of(actor.policy, model, TRIED, 0, actor.masked, **actor.options)
    good = [e for e in episodes if e.status == "success"]
    good = good if 2 * len(good) >= TRIED else episodes
    episode = sorted(good, key=lambda e: (e.moments[-1].time, e.start.seed))[len(good) // 2]
    pictures = [Image.fromarray(np.asarray(frame)) for frame in frames_of(episode)]
    stride = max(round(BETWEEN * FRAMES / 1000), math.ceil(len(pictures) / PICTURES))
    while True:
        kept = [*pictures[::stride], pictures[-1]]
        kept[0].save(
            path,
            save_all=True,
            append_images=kept[1:],
            duration=[BETWEEN] * (len(kept) - 1) + [1500],
            loop=0,
            lossless=True,
            minimize_size=True,
            method=4,
            quality=80,
        )
        if path.stat().st_size <= LARGEST:
            break
        stride += 1
    still = scene(kept[len(kept) * 2 // 5]).quantize(64, dither=Image.Dither.NONE)
    still.save(path.with_suffix(".png"), optimize=True)
    return {
        "policy": actor.policy if actor.policy in ("first", "random") else "trained",
        "seed": episode.start.seed,
        "speed": round(speed(episode, stride), 1),
    }


def scene(picture: Image.Image) -> Image.Image:
    """What a picture shows between its header and its footer, without what is blank around it."""
    middle = picture.crop((0, HEADER, picture.width, picture.height - FOOTER))
    left, top, right, bottom = ImageOps.invert(middle).getbbox() or (0, 0, *middle.size)
    ends = min(right + EDGE, middle.width), min(bottom + EDGE, middle.height)
    return middle.crop((max(left - EDGE, 0), max(top - EDGE, 0), *ends))


def speed(episode: Episode, stride: int) -> float:
    """How many seconds of the model a second of the film shows."""
    slow = max(episode.moments[-1].time / LONGEST, 1.0)
    return stride / FRAMES * 1000 / BETWEEN * slow


def main() -> None:
    """Measure, and write."""
    parser = argparse.ArgumentParser(description="Measure what the pages of environments say.")
    parser.add_argument("names", nargs="*", help="Of models; all without any.")
    parser.add_argument(
        "--quick", action="store_true", help="Train hardly at all; write to build/environments."
    )
    given = parser.parse_args()
    folder = Path("build/environments") if given.quick else NUMBERS
    folder.mkdir(parents=True, exist_ok=True)
    for name in given.names or sorted(path.stem for path in EXAMPLES.glob("*.kyx")):
        training = training_of(name)
        if given.quick and training is not None:
            tiny = {"n_steps": 16, "batch_size": 64, "n_epochs": 1}
            training = replace(training, settings=Settings(steps=128, n_envs=8, hyper=tiny))
        found = measured(name, folder, training)
        write_output(folder / f"{name}.json", json.dumps(found, indent=1, allow_nan=False) + "\n")
        print(f"{name}: {found['rows']['best']['return']['value']:.4g}", flush=True)


if __name__ == "__main__":
    main()
