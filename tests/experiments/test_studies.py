"""Studies of examples: pages that tell what the models say of themselves, and what was measured."""

import json
import re
from pathlib import Path

import pytest
from conftest import REPOSITORY
from typer.testing import CliRunner

from dl2c.configuration import resolve_options
from dl2c.experiments.commands import app
from dl2c.experiments.studies.catalogue import STUDIES, Study
from dl2c.experiments.studies.page import ANNOTATED, annotations, problem
from dl2c.pipeline import step_model

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
    assert [row["guarded"] for row in results["rows"]] == [True, True, False, False, False]
    for picture in ("curves.png", "episodes.png"):
        assert f"]({picture})" in page and (folder / picture).stat().st_size > 10_000
    for heading in (
        "# Water tank",
        "## What is proved",
        "## What is left to learn",
        "## What guards cost and buy",
    ):
        assert heading in page
    for row in results["rows"]:
        assert f"| {row['policy']} | {'with guards' if row['guarded'] else 'without'} |" in page


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
