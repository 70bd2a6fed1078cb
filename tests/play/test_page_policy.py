"""A policy in a page decides as it does in Python; a monitor takes over where it asks for too much."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import needs_browser
from devtools import Page
from devtools import browser as chromium
from play.pages import READY, needs_zig, replayed
from typer.testing import CliRunner

from dl2c.cli import app
from dl2c.env.interface import interface_of
from dl2c.env.opening import manifest_of
from dl2c.policy.files import write_policy
from dl2c.policy.network import Layer, Network, NetworkPolicy, Scaling

pytestmark = [needs_browser, needs_zig]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


def policy_for(example: str, action_format: str) -> NetworkPolicy:
    """One of random numbers that sees everything."""
    manifest = manifest_of(f"example:{example}", {"action_format": action_format})
    io, rng = interface_of(manifest), np.random.default_rng(2)
    size = len(io.observations)
    scaling = Scaling(rng.normal(size=size), rng.uniform(1, 9, size), 5.0)
    layers = (
        Layer(rng.normal(size=(16, size)), rng.normal(size=16), "elu"),
        Layer(rng.normal(size=(io.outputs, 16)), rng.normal(size=io.outputs), "identity"),
    )
    network = Network((scaling,), layers, bounded=io.kind == "box")
    return NetworkPolicy(manifest.name, io, network, io.kind != "box", {"action_format": action_format})


@pytest.mark.parametrize(
    ("example", "action_format"),
    [("waypoint", "auto"), pytest.param("acc", "box", marks=pytest.mark.slow)],
    ids=["alternatives", "numbers"],
)
def test_a_policy_drives(example: str, action_format: str, browser: Page, tmp_path: Path) -> None:
    policy = policy_for(example, action_format)
    write_policy(policy, tmp_path / "policy")
    path = tmp_path / "page.html"
    command = ["play", f"example:{example}", "--policy", str(tmp_path / "policy"), "-o", str(path)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0 and done.output.strip() == str(path)
    browser.begin()
    browser.open(path, READY)
    browser("page.restart(7n)")
    browser.click("document.getElementById('drives')")
    browser("document.activeElement.blur()")
    for _ in range(15):
        seen = np.array([browser("[...page.engine.view('obs')]")], policy.interface.dtype)
        masks = np.array([browser("page.episode.now.mask")], np.bool_)
        wanted = policy.act(seen, masks)[0]
        browser.press("ArrowRight")
        step = browser("({choices: page.episode.now.choices, inputs: page.episode.now.inputs})")
        asked = [*step["inputs"], *step["choices"]]
        expected = np.atleast_1d(wanted)
        if policy.interface.kind == "box":
            inputs = len(policy.interface.inputs)
            expected = np.append(expected[:inputs], np.rint(expected[inputs:]))
        np.testing.assert_allclose(asked, expected, rtol=1e-6)
        if browser("page.episode.over"):
            break
    replayed(browser("page.episode.recording()"), tmp_path)
    if policy.interface.kind != "box":
        shares = browser("page.request.shares")
        assert abs(sum(shares) - 1) < 1e-9 or browser("page.episode.over")


@pytest.mark.slow
def test_the_monitor_takes_over(browser: Page, tmp_path: Path) -> None:
    """It accepts an acceleration that is admissible, and brakes instead of one that is not."""
    write_policy(policy_for("acc", "box"), tmp_path / "policy")
    path = tmp_path / "page.html"
    command = ["play", "example:acc", "--policy", str(tmp_path / "policy"), "-o", str(path)]
    assert CliRunner().invoke(app, command).exit_code == 0
    browser.begin()
    browser.open(path, READY)
    browser("page.restart(7n)")
    browser.click("document.getElementById('guards')")
    browser("document.activeElement.blur()")
    browser("page.choose(0, 0), page.ask(0, 0)")
    browser("page.episode.over || page.once()")
    assert browser("page.episode.now.choices") == [0]
    assert browser("document.getElementById('status').textContent") == ""
    browser("page.ask(0, 3)")
    browser("page.once()")
    assert browser("page.episode.now.choices") == [1]
    assert "The monitor took over: a is not admissible" in browser(
        "document.getElementById('status').textContent"
    )
