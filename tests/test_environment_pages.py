"""The pages of environments: every example has one, whose numbers are about the model as it is."""

import json
import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from test_docs import DOCS, ROOT, run

from dl2c.training.configured import read_configuration
from dl2c.training.hyper import CAREFUL, complete
from dl2c.training.run import Settings

sys.path.insert(0, str(DOCS))
from environment_pages import (
    Page,
    achieved,
    described,
    environment,
    first_sentence,
    has_goal,
    model_digest,
    proof,
)
from measure import training_of

NAMES = sorted(path.stem for path in (ROOT / "examples").glob("*.kyx"))
FOLDER = DOCS / "environments"
TUNED = sorted((ROOT / "examples" / "tuned").glob("*.yaml"))
LARGEST = 150_000


def numbers(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def test_every_example_has_a_page_and_no_other() -> None:
    pages = {path.stem for path in FOLDER.glob("*.md")} - {"index"}
    assert pages == {*NAMES} == {path.stem for path in FOLDER.glob("*.json")}
    listed = (FOLDER / "index.md").read_text(encoding="utf-8").partition("{toctree}")[2]
    assert re.findall(r"^(\w+)$", listed, flags=re.M) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_its_film_and_what_is_generated(name: str) -> None:
    text = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert f"]({name}.webp)" in text
    assert re.findall(r"^```\{dl2c\} (\w+ \w+)$", text, flags=re.M) == [f"film {name}", f"environment {name}"]
    film = FOLDER / f"{name}.webp"
    assert film.stat().st_size <= LARGEST and (FOLDER / f"{name}.png").stat().st_size <= LARGEST
    with Image.open(film) as picture:
        assert getattr(picture, "n_frames", 1) > 10


@pytest.mark.parametrize("name", NAMES)
def test_numbers_are_about_the_model_as_it_is(name: str) -> None:
    assert numbers(name)["model"] == model_digest(Page(name).compilation), "run `make environments`"


@pytest.mark.parametrize("name", NAMES)
def test_policies_were_trained_as_the_settings_are_now(name: str) -> None:
    pytest.importorskip("yaml")
    found, training = numbers(name), training_of(name)
    now = ("", {}, {}) if training is None else (training.command, training.settings.hyper, training.options)
    assert (found["command"], found["hyper"], found["options"]) == now, "run `make environments`"


@pytest.mark.parametrize("name", NAMES)
def test_a_page_names_all_of_a_model(name: str) -> None:
    page = Page(name)
    manifest, text = page.manifest, "\n\n".join(described(page))
    spaces, _, rest = text.partition("## Rewards and ends")
    rewards, _, constants = rest.partition("## Constants")
    for quantity in manifest.observations:
        assert re.search(rf"^\| `{quantity.name}` \| {re.escape(quantity.description)}", spaces, flags=re.M)
    for constant in manifest.constants:
        assert f"| `{constant.name}` |" in constants
    for one in (*manifest.choices, *manifest.inputs, *manifest.drawn_choices, *manifest.drawn_inputs):
        assert f"| `{one.key}`" in spaces
    for predicate in manifest.predicates:
        assert f"**{predicate.name}** (`@{predicate.category}`)" in rewards
    assert f"After {manifest.options['max_episode_steps']} steps" in rewards
    assert ("| success |" in "".join(achieved(page))) == has_goal(page)


def test_rewards_and_ends_are_in_words() -> None:
    text = "\n".join(described(Page("waypoint")))
    assert "pays `-1000` where it does not" in text and "pays `1000` where it holds" in text
    assert "where it fails when it is due, the episode is terminated, with status `failure`" in text


def test_a_page_says_what_is_proved_and_what_is_not() -> None:
    waypoint = "\n".join(proof(Page("waypoint")))
    assert "- *program*: not checked, that some run succeeds is not checked" in waypoint
    forced = "\n".join(proof(Page("forced_acceleration")))
    assert "**proved**" in forced and "- *safety isSafe (loop 1)*: unknown" in forced


def test_nothing_is_trained_where_nothing_is_decided() -> None:
    deciding = {n for n in NAMES if Page(n).manifest.choices or Page(n).manifest.inputs}
    assert deciding == {n for n in NAMES if "trained" in numbers(n)["rows"]} == {*COMMANDS}
    text = environment("forced_acceleration")
    assert "There is nothing to train." in text and "nothing to decide" in text


def test_comments_and_scenes_do_not_change_what_a_model_is(tmp_path: Path) -> None:
    from dl2c.env.opening import compilation_of

    text = (ROOT / "examples" / "watertank.kyx").read_text(encoding="utf-8")
    other = re.sub(r"/\* @scene:.*?\*/", "", text, flags=re.S).replace("Keep the level", "Keep a level")
    costly = text.replace("reward=1,", "reward=2,")
    longer = text.replace("max_steps=200", "max_steps=300")
    path, found = tmp_path / "model.kyx", list[str]()
    for version in (text, other, costly, longer):
        path.write_text(version, encoding="utf-8")
        found.append(model_digest(compilation_of(path, {})))
    assert found[0] == found[1] and len({*found}) == 3


def test_the_first_sentence_of_an_example() -> None:
    assert first_sentence("/* Go there,\n * and stop. Then rest.\n */") == "Go there, and stop."


@pytest.mark.parametrize("path", TUNED, ids=lambda path: path.stem)
def test_tuned_settings_are_read(path: Path) -> None:
    pytest.importorskip("sb3_contrib")
    found = read_configuration(path)
    assert found["model"] == f"examples/{path.stem}.kyx"
    complete(found["algo"], Settings(hyper=found["hyper"]))
    said = path.read_text(encoding="utf-8").partition("return")[2]
    if "which no trial surpassed" in said:
        assert found["hyper"].items() >= CAREFUL.items() and not found.get("options")
        return
    better, before = re.findall(r"(-?[\d.]+)(?:,|\.\n)", said)[:2]
    assert float(better) >= float(before)


COMMANDS = {name: numbers(name)["command"] for name in NAMES if numbers(name)["command"]}


@pytest.mark.slow  # trains; of these environments test_readme.py trains one, without its tuned settings
@pytest.mark.parametrize("name", COMMANDS)
def test_the_command_of_a_page_trains(name: str, tmp_path: Path) -> None:
    """With few steps: the last value of a flag counts."""
    pytest.importorskip("sb3_contrib")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    words = [*shlex.split(COMMANDS[name]), *shlex.split("--steps 64 --n-envs 4 -o out")]
    run(tmp_path, sys.executable, "-m", *words)
    assert (tmp_path / "out" / "policy.json").exists()


@pytest.mark.slow
def test_measuring_writes_what_pages_need(tmp_path: Path) -> None:
    for library in ("sb3_contrib", "pygame"):
        pytest.importorskip(library)
    run(tmp_path, sys.executable, str(DOCS / "measure.py"), "--quick", "waypoint")
    found = json.loads((tmp_path / "build" / "environments" / "waypoint.json").read_text(encoding="utf-8"))
    assert {*found} == {*numbers("waypoint")} and found["rows"].keys() == numbers("waypoint")["rows"].keys()
    with Image.open(tmp_path / "build" / "environments" / "waypoint.webp") as film:
        assert getattr(film, "n_frames", 1) > 10
