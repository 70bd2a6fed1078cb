"""The page about a training stands alone, says what is there, and nothing in a model can break it."""

import json
import shutil
from dataclasses import asdict
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import needs_browser, visited
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import dl2c
from dl2c.cli import app
from dl2c.env.interface import interface_of
from dl2c.env.opening import source_of
from dl2c.policy.files import write_policy
from dl2c.policy.network import Layer, Network, NetworkPolicy
from dl2c.report.listing import listing
from dl2c.report.markup import image, page, table, tag
from dl2c.report.page import measure, report
from dl2c.report.trained import RunError, Trained, read_trained
from dl2c.training.run import Estimate, Evaluation, Point, Settings

pytest.importorskip("matplotlib")

ATTACK = "</pre></table><script>alert(1)</script><img src=x onerror=alert(1)>\"'&amp;"
QUOTED = ATTACK.replace('"', "")
HOSTILE = (
    source_of("example:watertank")
    .text.replace('def="level"', f'def="{QUOTED}"')
    .replace("/* Keep the level", f"/* {ATTACK} <script src='http://example.org/x.js'></script>")
)

VOID = {"meta", "img", "link", "input", "br"}


ONE = Estimate(1.0, 0.9, 1 - 1e-16)
ROUNDED = Evaluation(9, ONE, Estimate(0.0, 0.0, 0.3), ONE, ONE, Estimate(5.0, float("nan"), float("nan")))
"""Rounding leaves the end of an interval below the value; a single value has none."""


class Reader(HTMLParser):
    """What a page has: elements, addresses, text; that elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: set[str] = set()
        self.attributes: set[str] = set()
        self.addresses: list[str] = []
        self.words = ""
        self.open: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.add(tag)
        self.attributes |= {name for name, _ in attrs}
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "action")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


def run_folder(folder: Path, text: str) -> Path:
    """What `dl2c train` leaves of a model, with a policy of random weights."""
    env = dl2c.make(text, max_episode_steps=40)
    manifest = env.manifest
    rng = np.random.default_rng(2)
    interface = interface_of(manifest)
    layers = (Layer(rng.normal(size=(1, len(interface.observations))) / 5, np.full(1, 0.1), "tanh"),)
    write_policy(NetworkPolicy(manifest.name, interface, Network((), layers), False, {}), folder)
    curve = [
        Point(1000 * k, k % 3, 0.1 * k, 0.0, 0.5, float("nan") if k == 2 else k, 900.0) for k in range(1, 9)
    ]
    content = {
        "model": manifest.name,
        "algo": "ppo",
        "seed": 7,
        "options": manifest.options,
        "settings": asdict(Settings()),
        "seconds": 8.5,
        "curve": [asdict(p) for p in curve],
        "evaluations": [{"steps": 4000, "found": asdict(ROUNDED)}],
        "versions": {"dl2c": "0.0-test", "torch": "<b>2</b>"},
    }
    (folder / "run.json").write_text(json.dumps(content), encoding="utf-8")
    (folder / "model.kyx").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    return read_trained(run_folder(tmp_path_factory.mktemp("run"), HOSTILE))


@pytest.fixture(scope="module")
def written(trained: Trained) -> str:
    return report(trained, measure(trained, 20))


def test_a_model_cannot_break_the_page(written: str) -> None:
    seen = Reader(written)
    assert "script" not in seen.elements and not {a for a in seen.attributes if a.startswith("on")}
    assert "b" not in seen.elements
    assert "<script>alert(1)</script>" in seen.words


def test_the_page_needs_nothing_else(written: str) -> None:
    seen = Reader(written)
    assert len(seen.addresses) >= 2
    assert all(a.startswith("data:image/png;base64,") for a in seen.addresses)
    assert "default-src 'none'" in written
    assert not {"link", "iframe", "object", "form"} & seen.elements
    assert "url(" not in written and "@import" not in written


def test_the_page_says_what_was_done(trained: Trained, written: str) -> None:
    words = Reader(written).words
    for part in (
        "Water tank",
        "ppo, seed 7",
        "8,000 environment steps",
        "uniform random",
        "max_episode_steps",
    ):
        assert part in words
    assert "observation_bounds" not in words, "only options that are not the defaults"
    assert "0.0-test" in words and "1000011" in words
    assert all(line.strip() in words for line in trained.source.text.splitlines())


def test_the_command_writes_it(trained: Trained, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dl2c.report.film.LONGEST", 1.0)
    target, film = tmp_path / "page.html", tmp_path / "film.gif"
    wanted = ["-o", str(target), "--episodes", "5", "--film", str(film)]
    shown = CliRunner().invoke(app, ["report", str(trained.folder), *wanted])
    assert shown.exit_code == 0, shown.output
    assert shown.output.split() == [str(target), str(film)] and film.read_bytes()[:4] == b"GIF8"
    Reader(target.read_text(encoding="utf-8"))


def test_what_stands_beside_the_page_is_linked(
    trained: Trained, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the page's own folder, whatever folder the command runs in; the policy can drive there."""
    pytest.importorskip("ziglang")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dl2c.report.film.LONGEST", 1.0)
    wanted = ["-o", "a/page.html", "--film", "b c/film.gif", "--play", "a/drive it.html", "--episodes", "2"]
    shown = CliRunner().invoke(app, ["report", str(trained.folder), *wanted])
    assert shown.exit_code == 0, shown.output
    links = Reader((tmp_path / "a" / "page.html").read_text(encoding="utf-8")).addresses
    assert [a for a in links if not a.startswith("data:")] == ["../b%20c/film.gif", "drive%20it.html"]
    assert '"policy": {' in (tmp_path / "a" / "drive it.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("content", [None, "", "[]", "{}", '{"model": "m", "algo": 1}'])
def test_what_is_no_training_is_refused(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "run.json").write_text(content, encoding="utf-8")
    with pytest.raises(RunError, match=r"run\.json|--model"):
        read_trained(tmp_path)


def test_a_training_without_its_model_asks_for_it(trained: Trained, tmp_path: Path) -> None:
    shutil.copy(trained.folder / "run.json", tmp_path)
    with pytest.raises(RunError, match="--model"):
        read_trained(tmp_path)
    assert read_trained(tmp_path, "example:watertank").source.name.endswith("watertank.kyx")


@given(st.text(), st.text())
def test_text_stays_text(one: str, other: str) -> None:
    seen = Reader(page(one, "", table([one], [[other]]), tag("p", one, title=other), listing(other)))
    assert seen.elements <= {*VOID, "html", "head", "style", "title", "body", "main", "p"} | {
        *("table", "thead", "tbody", "tr", "th", "td", "ol", "li", "span")
    }


def test_pictures_from_elsewhere_are_refused() -> None:
    with pytest.raises(AssertionError):
        image("http://example.org/a.png", "a picture")


def test_annotations_stand_out() -> None:
    html = listing('/* @var: bound=[0:1],\n unit="m" */\nReal x; // plain\n"// @no"').html
    assert html.count('class="annotation"') == 2 and html.count('class="comment"') == 1


def test_pictures_while_learning(tmp_path: Path) -> None:
    algorithm = pytest.importorskip("stable_baselines3").PPO
    from stable_baselines3.common.vec_env import VecNormalize

    from dl2c.report.callback import PictureCallback

    env = VecNormalize(dl2c.make_sb3("example:watertank", 2))
    learner = algorithm("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, device="cpu")
    learner.learn(48, callback=PictureCallback(tmp_path, every=16, episodes=2))
    steps = sorted(int(file.stem) for file in tmp_path.glob("*.png"))
    assert steps == [16, 32, 48]
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in tmp_path.iterdir())


@pytest.mark.slow
@needs_browser
def test_a_browser_shows_the_page(written: str, tmp_path: Path) -> None:
    shot = tmp_path / "shot.png"
    done = visited(written, tmp_path, "--hide-scrollbars", "--window-size=1200,3000", f"--screenshot={shot}")
    assert done.returncode == 0, done.stderr
    from matplotlib.image import imread

    pixels = imread(shot)[:, :, :3]
    assert pixels.shape[:2] == (3000, 1200)
    bands = np.array_split(pixels, 10)
    assert all(band.std() > 0.02 for band in bands[:8])
