"""Studies of examples: pages that tell what the models say of themselves, and what was measured."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY
from selection import quick_among
from typer.testing import CliRunner

from dl2c.configuration import resolve_options
from dl2c.env.interface import interface_of
from dl2c.env.opening import open_library, source_of
from dl2c.experiments.commands import app
from dl2c.experiments.studies.catalogue import STUDIES, Study, study_of
from dl2c.experiments.studies.judged import judged
from dl2c.experiments.studies.page import ANNOTATED, annotations, problem
from dl2c.pipeline import step_model
from dl2c.policy.files import write_policy
from dl2c.policy.network import Layer, Network, NetworkPolicy

PREDICATE = re.compile(r"Bool (\w+)")


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.example)
def test_a_page_shows_every_predicate_that_is_annotated(study: Study) -> None:
    source = study.guarded
    model, _ = step_model(source, resolve_options({}))
    shown = {name for text in ANNOTATED.findall(source.text) for name in PREDICATE.findall(text)}
    assert shown == {p.name for p in model.predicates}
    assert study.has_goal == ("on_success=terminate" in source.text)


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.example)
def test_without_its_guards_a_model_says_the_same_but_for_them(study: Study) -> None:
    (guarded, _), (free, _) = (step_model(s, resolve_options({})) for s in (study.guarded, study.unguarded))
    assert guarded.body != free.body
    assert (guarded.predicates, guarded.precondition) == (free.predicates, free.precondition)


def test_a_study_is_a_page_with_curves_and_data(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    ran = CliRunner().invoke(app, ["study", "watertank", "--quick", "-o", str(tmp_path)])
    assert ran.exit_code == 0, ran.output
    folder = tmp_path / "watertank"
    page = (folder / "page.md").read_text(encoding="utf-8")
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert results["endured"] == {"steps": 800, "violations": 0}
    assert results["judgement"]["claims"].keys() == {"admissible", "kept", "for ever"}
    assert f"| admissible | {results['judgement']['claims']['admissible']} |" in page
    assert [row["guarded"] for row in results["rows"]] == [True, True, False, False, False]
    for picture in ("curves.png", "episodes.png"):
        assert f"]({picture})" in page and (folder / picture).stat().st_size > 10_000
    for heading in (
        "# Water tank",
        "## What is proved",
        "## What is left to learn",
        "## What guards cost and buy",
        "## Is the policy itself proved?",
    ):
        assert heading in page
    for row in results["rows"]:
        assert f"| {row['policy']} | {'with guards' if row['guarded'] else 'without'} |" in page


def untrained(folder: Path, options: dict[str, Any] | None = None) -> Path:
    """A policy of the water tank whose inflow is 0.6 - 0.1 * l, and which sees nothing else."""
    manifest = open_library(source_of("example:watertank"), options or {}).manifest
    interface = interface_of(manifest)
    names = [name for name, _, _ in interface.observations]
    weight = np.zeros((1, len(names)))
    weight[0, names.index("l")] = -0.1
    network = Network((), (Layer(weight, np.array([0.6]), "identity"),))
    return write_policy(NetworkPolicy(manifest.name, interface, network, False, manifest.options), folder)


def test_the_judgement_of_a_policy_is_that_of_its_model(tmp_path: Path) -> None:
    study = study_of("watertank")
    assert study is not None
    found = judged(untrained(tmp_path), study, seconds=20)
    rng = np.random.default_rng(7)
    most, q, l = (rng.uniform(*ends, 10**5) for ends in ((0.3, 0.6), (0.05, 0.25), (0, 5)))
    assert np.all(q < most)  # so that all of them are states of the hypothesis
    u = np.clip(0.6 - 0.1 * l, 0.0, 0.6)
    good = (u <= most) & (l + u - q <= 5) & (l + u - q >= 0)
    assert 0.2 < good.mean() < 0.95
    assert abs(found.admissible.value - good.mean()) < 0.01
    assert found.admissible.low < found.admissible.value < found.admissible.high
    assert found.claims["admissible"] == "refuted"
    most, q, l = (float(found.state[name]) for name in ("U", "q", "l"))
    asks = float(found.request["assign_u"])
    assert asks == pytest.approx(0.6 - 0.1 * l) and not (asks <= most and 0 <= l + asks - q <= 5)


def test_with_shares_it_is_judged_whether_there_is_something_admissible(tmp_path: Path) -> None:
    """In the tank there always is."""
    study = study_of("watertank")
    assert study is not None
    squashed = {"action_map": "squash"}
    found = judged(untrained(tmp_path, squashed), replace(study, options=squashed), seconds=20)
    assert found.claims == {"admissible": "proved", "kept": "proved", "for ever": "proved"}
    assert found.admissible.value == 1.0


@pytest.mark.parametrize("example", quick_among(("static_safety", "passive_safety"), ("passive_safety",)))
def test_states_on_a_circle_are_judged(tmp_path: Path, example: str) -> None:
    """Who always stands still is refused while driving, and brakes where nothing else is said."""
    study = study_of(example)
    assert study is not None
    manifest = open_library(source_of(f"example:{example}"), study.options).manifest
    interface = interface_of(manifest)
    weight = np.zeros((len(interface.low), len(interface.observations)))
    for choice, share in ((-1.0, 1.0), (0.0, 0.0)):
        network = Network((), (Layer(weight, np.array([0.0, 0.0, 0.0, choice]), "identity"),))
        policy = NetworkPolicy(manifest.name, interface, network, False, manifest.options)
        found = judged(write_policy(policy, tmp_path), study, seconds=3, states=2000)
        assert found.claims["admissible"] == ("proved" if share else "refuted")
        assert found.admissible.value == share
        assert (found.request == {"choice_0": "1"}) == (not share)


def test_a_policy_that_is_not_covered_has_a_reason(tmp_path: Path) -> None:
    study = study_of("watertank")
    assert study is not None
    folder = untrained(tmp_path)
    data = json.loads(folder.read_text())
    data["layers"][0]["activation"] = "elu"
    folder.write_text(json.dumps(data))
    found = judged(folder, study)
    assert "its network uses elu" in found.reason and not found.claims


def test_a_study_that_does_not_exist_is_said() -> None:
    ran = CliRunner().invoke(app, ["study", "bouncing_ball"])
    assert ran.exit_code == 1 and "static_safety" in str(ran.exception)


@pytest.mark.parametrize("study", STUDIES, ids=lambda s: s.example)
def test_the_page_in_docs_is_about_this_model(study: Study) -> None:
    folder = REPOSITORY / "docs" / "studies" / study.example
    page = (folder / "page.md").read_text(encoding="utf-8")
    told = (study.proved, study.learned, study.guard, study.found)
    assert all(text in page for text in (*told, problem(study.guarded.text), annotations(study.guarded.text)))
    assert f"{study.settings.steps:,} steps" in page and "failed in 0 of them" in page
    assert all((folder / picture).stat().st_size > 10_000 for picture in ("curves.png", "episodes.png"))
