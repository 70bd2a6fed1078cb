"""Pages for those who see little, press no mouse, or look at a phone."""

import json
import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import needs_browser
from devtools import Page
from devtools import browser as chromium
from play.pages import EXAMPLES, needs_zig, opened

pytestmark = [needs_browser, needs_zig]

AXE = "axe-core@4.10.3"

UNNAMED = """[...document.querySelectorAll('button, input, select, canvas')].filter((e) =>
  !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length)).map((e) => e.outerHTML)"""

CONTRAST = """(() => {
  const part = (v) => v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4;
  const light = (c) => {
    const [r, g, b] = c.match(/[\\d.]+/g).map(Number).map(part);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const c = getComputedStyle(e).backgroundColor;
      if (c !== 'rgba(0, 0, 0, 0)') return c;
    }
    return 'rgb(255, 255, 255)';
  };
  const texts = [...document.querySelectorAll('body *')].filter((e) => e.checkVisibility()
    && [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()));
  return Math.min(...texts.map((e) => {
    const [a, b] = [light(getComputedStyle(e).color), light(behind(e))];
    return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  }));
})()"""
"""The least ratio of the luminances of a text and what is behind it (WCAG 2.1, 1.4.3)."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


def test_controls_have_names_and_text_stands_out(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "waypoint", tmp_path)
    page.press("ArrowRight")
    assert page(UNNAMED) == []
    for dark in (False, True):
        page.looks(1280, 900, dark=dark)
        assert page(CONTRAST) >= 4.5, "dark" if dark else "light"


SETTLED_WIDTH = """new Promise((answer) => {
  const begun = performance.now();
  const look = () => {
    const width = document.documentElement.scrollWidth;
    if (width <= screen.width || performance.now() - begun > 5000) answer(width);
    else requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
})"""
"""The width of the page, as soon as it fits, or else after five seconds: a busy browser lays it out late."""


def test_a_phone_shows_everything_in_its_width(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "waypoint", tmp_path)
    page.looks(390, 844, touch=True)
    assert page(SETTLED_WIDTH) <= 390
    page.tap("document.querySelector('.alternative[aria-disabled=\"false\"]')")
    assert page("page.episode.at") == 1
    controls = "[...document.querySelectorAll('button, select')].map((e) => e.getBoundingClientRect().height)"
    assert min(page(controls)) >= 24


def test_tab_reaches_every_control(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "waypoint", tmp_path)
    reached = set[str]()
    for _ in range(60):
        page.press("Tab")
        reached.add(page("document.activeElement.id || document.activeElement.textContent"))
    assert {"run", "step", "timeline", "guards", "seed", "record", "keys", "listing"} <= reached


@pytest.fixture(scope="module")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The text of axe-core, from npm."""
    npm, folder = shutil.which("npm"), tmp_path_factory.mktemp("axe")
    if npm is None:
        pytest.skip("there is no npm")
    got = subprocess.run([npm, "pack", AXE], cwd=folder, capture_output=True, check=False, timeout=120)
    if got.returncode != 0:
        pytest.skip("npm does not give axe-core")
    with tarfile.open(next(folder.glob("*.tgz"))) as archive:
        member = archive.extractfile("package/axe.min.js")
        assert member is not None
        return member.read().decode("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_axe_finds_nothing(example: str, axe: str, browser: Page, tmp_path: Path) -> None:
    page = opened(browser, example, tmp_path)
    page(f"{axe}; 0")
    for dark in (False, True):
        page.looks(1280, 900, dark=dark)
        found = page("axe.run().then((r) => r.violations.map((v) => [v.id, v.nodes.map((n) => n.html)]))")
        assert found == [], json.dumps(found, indent=1)
