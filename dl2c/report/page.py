"""The report of a training: one HTML page that needs nothing else, neither files nor a network."""

import platform
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from dl2c.diagnostics import render
from dl2c.env.opening import open_library
from dl2c.native.manifest import Manifest, Quantity
from dl2c.options import Options, with_options
from dl2c.picture.figure import data_uri, episode_figure
from dl2c.report.blame import blamed, model_of
from dl2c.report.episode import Episode
from dl2c.report.listing import listing
from dl2c.report.markup import Markup, image, page, section, table, tag
from dl2c.report.pictures import curves_figure, track_of
from dl2c.report.recording import Recording
from dl2c.report.trained import Trained
from dl2c.training.evaluation import FIRST_SEED, evaluate
from dl2c.training.run import PROOF, Evaluation
from dl2c.version import __version__

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")

SHOWN = 12
"""Episodes in a picture."""

LIBRARIES = ("numpy", "gymnasium", "torch", "stable-baselines3", "sb3-contrib")


@dataclass(frozen=True, slots=True)
class Measured:
    """What was found of a trained policy and of two that learn nothing under the same options, each with its
    name and whether it sees masks, and the first episodes of the trained one.
    """

    found: tuple[tuple[str, bool, Evaluation], ...]
    seen: list[Episode]


def measure(trained: Trained, episodes: int = 200) -> Measured:
    """Run the policies once more, in so many episodes each. Raises what `evaluate` raises."""
    recording = Recording(SHOWN, FIRST_SEED)
    found: list[tuple[str, bool, Evaluation]] = []
    for name, masked, policy, watch in (
        (f"trained ({trained.algo})", trained.masked, trained.folder, recording),
        ("uniform random", True, "random", None),
        ("first enabled", True, "first", None),
    ):
        options = dict(trained.options)
        one = evaluate(policy, trained.source, episodes, masked=masked, watch=watch, **options)
        found.append((name, masked, one))
    return Measured(tuple(found), recording.episodes())


def report(trained: Trained, measured: Measured, links: Mapping[str, str] | None = None) -> str:
    """The page. `links` are titles of files that stand beside it, and their addresses."""
    manifest = open_library(trained.source, dict(trained.options)).manifest
    curves = curves_figure(trained.curve, trained.evaluations)
    parts = [
        tag("h1", manifest.name),
        tag("p", _summary(trained), class_="lead"),
        *(tag("p", tag("a", title, href=address)) for title, address in (links or {}).items()),
        section("Results", _results(measured)),
        *_proof(trained),
        section("Learning", image(data_uri(curves), "learning curve")),
        _trajectories(measured.seen),
        *_failure(measured.seen),
        section("Environment", *_environment(manifest)),
        section("Model", listing(trained.source.text)),
        section("How it was made", *_provenance(trained)),
    ]
    return page(f"{manifest.name}: {trained.algo}, seed {trained.seed}", STYLE, *parts)


def _proof(trained: Trained) -> Iterator[Markup]:
    """The section on what was proved, if there is a report of that in the folder."""
    if (trained.folder / PROOF).is_file():
        from dl2c.report.proof import proof_section

        yield from proof_section(trained)


def _summary(trained: Trained) -> str:
    steps = trained.curve[-1]["steps"] if trained.curve else 0
    stopped = ", stopped early" if trained.interrupted else ""
    took = f"{steps:,} environment steps in {trained.seconds:.0f} s"
    return f"{trained.algo}, seed {trained.seed}, {took}{stopped}"


def _results(measured: Measured) -> Markup:
    cells = [(name, "yes" if masked else "no", *_rates(one)) for name, masked, one in measured.found]
    heads = ("policy", "masks", "success", "safety violated", "blocked", "time to success / s", "return")
    episodes = measured.found[0][-1].episodes
    about = f"{episodes} episodes each, seeds from {FIRST_SEED:,}; 95 % intervals in brackets."
    return tag("div", table(heads, cells), tag("p", about, class_="note"))


def _rates(found: Evaluation) -> tuple[str, ...]:
    fractions = (found.success, found.violations, found.blocked)
    return (
        *(e.shown(".1%", "–") for e in fractions),
        found.travel_time.shown(".3g", "–"),
        found.episode_return.shown(".4g", "–"),
    )


def _trajectories(seen: list[Episode]) -> Markup:
    model = model_of(seen[0])
    picture = data_uri(episode_figure(model, [track_of(e) for e in seen], model.name))
    about = (
        f"{len(seen)} episodes of the trained policy, seeds from {FIRST_SEED:,}. The dark one is the first; "
        "marks, thresholds and shaded regions are its own."
    )
    heads = ("seed", "steps", "time / s", "return", "end")
    rows = [
        (
            f"{e.start.seed}",
            f"{len(e.moments)}",
            f"{e.moments[-1].time:.4g}",
            f"{sum(m.reward for m in e.moments):.4g}",
            f"{e.status}: {e.reason}",
        )
        for e in seen
    ]
    return section("Episodes", image(picture, "episodes"), tag("p", about, class_="note"), table(heads, rows))


def _failure(seen: list[Episode]) -> Iterator[Markup]:
    """The first of the episodes that failed, and the condition it violates."""
    failed = next((e for e in seen if e.failed), None)
    if failed is not None:
        model = model_of(failed)
        said = "\n\n".join(render(d) for d in blamed(failed, model)) or f"{failed.status}: {failed.reason}"
        picture = data_uri(episode_figure(model, [track_of(failed)]))
        yield section(f"Failure of seed {failed.start.seed}", image(picture, "a failure"), tag("pre", said))


def _environment(manifest: Manifest) -> Iterator[Markup]:
    constants, theorem = {q.name for q in manifest.constants}, manifest.theorem
    yield tag("h3", "Theorem")
    yield table(("name", "invariant", "known"), [(theorem.name, theorem.invariant, theorem.known)])
    yield tag("h3", "Observations")
    yield table(
        ("name", "range", "unit", "meaning", ""),
        [(*_quantity(q), "constant" if q.name in constants else "") for q in manifest.observations],
    )
    yield tag("h3", "Decisions of the agent")
    decisions = [(c.key, c.name, " | ".join(c.alternatives)) for c in manifest.choices]
    decisions += [(i.key, "", f"{i.low:g} to {i.high:g}") for i in manifest.inputs]
    yield table(("key", "name", "alternatives or range"), decisions)
    yield tag("h3", "Predicates")
    yield table(("name", "category"), [(p.name, p.category) for p in manifest.predicates])


def _quantity(q: Quantity) -> tuple[str, str, str, str]:
    return q.name, f"{q.low:g} to {q.high:g}", q.unit, q.description


def _provenance(trained: Trained) -> Iterator[Markup]:
    changed = {n: v for n, v in trained.options.items() if not _is_default(n, v)}
    for title, values in (
        ("Options that are not the defaults", changed),
        ("Settings", _flat(trained.settings)),
        ("Versions", _versions(trained)),
    ):
        yield tag("h3", title)
        yield table(("name", "value"), [(name, f"{value}") for name, value in values.items()])


def _is_default(name: str, value: Any) -> bool:
    return getattr(with_options(Options(), {name: value}), name) == getattr(Options(), name)


def _flat(settings: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= {f"{name}.{k}": v for k, v in value.items()} if isinstance(value, dict) else {name: value}  # pyright: ignore[reportUnknownVariableType] # JSON
    return flat


def _versions(trained: Trained) -> dict[str, str]:
    """Those that the training wrote down; else those of now."""
    here = {"python": platform.python_version(), "system": f"{platform.system()} {platform.machine()}"}
    if trained.versions:
        return {**{k: str(v) for k, v in trained.versions.items()}, **here}
    found = {"dl2c": __version__}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return {**found, **here}
