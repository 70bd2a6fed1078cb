"""Pages in a real browser: what they show is what happens, by clicks, keys and touches."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import needs_browser
from devtools import Page
from devtools import browser as chromium
from play.pages import EXAMPLES, READY, needs_zig, opened, replayed, text_of
from typer.testing import CliRunner

from dl2c.cli import app
from dl2c.env.opening import source_of
from dl2c.play.build import playable
from dl2c.play.page import MODULES, page_of, script
from dl2c.source import Source

pytestmark = [needs_browser, needs_zig]

LARGEST = 400_000
"""Bytes of a page without a policy."""

AT = "page.episode.at"
UNDRAWN = "l^13 + l^2 * goal^2 = goal^13 + 1"
"""Of which no initial states are drawn; l = goal = 1 is one."""

STATUS = "document.getElementById('status').textContent"


def button(text: str) -> str:
    return f"[...document.querySelectorAll('button')].find((b) => b.textContent.trim() === {text!r})"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


def test_modules_import_nothing_but_each_other() -> None:
    text = script()
    assert not re.search(r"^(import|export)\b", text, re.MULTILINE) and len(MODULES) == len(set(MODULES))
    declared = re.findall(r"^(?:async )?(?:const|let|function|class) (\w+)", text, re.MULTILINE)
    assert len(declared) == len(set(declared))


def test_an_episode_by_clicks_is_replayed_bit_for_bit(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "waypoint", tmp_path)
    for _ in range(6):
        page.click("document.querySelector('.alternative[aria-disabled=\"false\"]')")
    page.click(button("Step"))
    page.click(button("Back"))
    assert page(AT) == 6 and "step 6" in page("document.getElementById('numbers').textContent")
    recording = page("page.episode.recording()")
    assert len(json.loads(recording)["steps"]) == 6
    assert "bit for bit" in replayed(recording, tmp_path)


def test_an_episode_is_saved(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "waypoint", tmp_path)
    page.press("ArrowRight")
    page.downloads_to(tmp_path)
    page.click(button("Save this episode"))
    saved = tmp_path / "Waypoint-7.json"
    for _ in range(100):
        if saved.exists():
            break
        page("new Promise((done) => setTimeout(done, 50))")
    assert saved.read_text(encoding="utf-8") == page("page.episode.recording()")


def test_nothing_is_requested_and_the_page_is_small(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "watertank", tmp_path)
    page.press("ArrowRight")
    assert page.asked == [] and page.said == [] and len(text_of("watertank").encode()) < LARGEST
    assert page("fetch('https://example.org').then(() => 'sent', () => 'refused')") == "refused"
    other = (
        "document.body.append(Object.assign(document.createElement('script'), {textContent: 'other = 1'}))"
    )
    assert page(f"({other}, typeof other)") == "undefined"


def test_keys_drive_and_go_back(browser: Page, tmp_path: Path) -> None:
    """Arrows step, go back and move an input; what was after that is forgotten."""
    page = opened(browser, "pendulum", tmp_path)
    for k in range(6):
        page.press("ArrowUp" if k % 3 else "ArrowDown")
        page.press("ArrowRight")
    far = page("page.episode.now.x.join()")
    for _ in range(2):
        page.press("ArrowLeft")
    assert page(AT) == 4 and page("page.episode.steps.length") == 6
    page.press("ArrowDown")
    page.press("ArrowRight")
    page.press("ArrowRight")
    assert page(AT) == 6 == page("page.episode.steps.length") and page("page.episode.now.x.join()") != far
    said = replayed(page("page.episode.recording()"), tmp_path)
    assert "bit for bit" in said or "within 1e-12" in said


def test_time_passes_as_it_does_in_the_model(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "pendulum", tmp_path)
    page.click(button("Restart"))
    page.press(" ")
    assert page("new Promise((r) => setTimeout(() => r(page.player.running), 600))")
    page.press(" ")
    page("new Promise((r) => setTimeout(r, 100))")
    assert not page("page.player.running") and 0.1 < page("page.player.shown") < 1.5


def test_pressing_a_plot_goes_to_that_time(browser: Page, tmp_path: Path) -> None:
    """In the middle of a strip is the middle of the episode's time."""
    page = opened(browser, "watertank", tmp_path)
    for _ in range(9):
        page.press("ArrowRight")
    times = page("[page.episode.first, ...page.episode.steps].map((m) => m.time)")
    nearest = min(range(10), key=lambda k: abs(times[k] - times[-1] / 2))
    page("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    page.click("document.querySelector('.plot .u-over')")
    assert page(AT) == nearest and page("page.episode.steps.length") == 9
    drawn = page("page.plots.strips.map((s) => [s.chart.data[0].at(-1), s.chart.data[1].length])")
    assert all(last == times[-1] and count >= 10 for last, count in drawn) and page.said == []


def test_a_step_that_differs_is_found(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "pendulum", tmp_path)
    page.press("ArrowRight")
    page.press("ArrowRight")
    content = json.loads(page("page.episode.recording()"))
    content["steps"][1]["state"]["w"] *= 1 + 1e-9
    file = tmp_path / "episode.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    done = CliRunner().invoke(app, ["replay", str(file)])
    assert done.exit_code == 1 and "step 2 differs: w is" in done.output


def test_the_test_that_says_no_is_named(browser: Page, tmp_path: Path) -> None:
    """Where the robot stands outside the goal area it may not brake there: the page says which test fails."""
    page = opened(browser, "waypoint", tmp_path)
    masked = "document.querySelector('.alternative[aria-disabled=\"true\"]')"
    for _ in range(40):
        if page(f"{masked} !== null && {AT} > 0"):
            break
        page.press("ArrowRight")
    before = page(AT)
    assert re.search(r"fails by [\d.]+", page(f"{masked}.querySelector('small').textContent"))
    page.click(masked)
    assert page(AT) == before and "fails by" in page(STATUS)
    assert page("document.querySelectorAll('pre mark.broken').length") > 0
    assert page("document.querySelectorAll('pre mark.ran').length") > 0


def test_a_beginning_is_checked_against_the_assumptions(browser: Page, tmp_path: Path) -> None:
    page = opened(browser, "watertank", tmp_path)
    field = "document.querySelector('[aria-label=\"l at the beginning\"]')"
    write = f"((text) => {{ {field}.value = text; {field}.dispatchEvent(new Event('input')); }})"
    page(f"{write}('5.5')")
    assert page("document.querySelector('#values p').textContent") == (
        "Not an initial state: l <= m fails by 0.5."
    )
    assert page(f"{button('Begin here')}.disabled")
    page(f"{write}('2.5')")
    page.click(button("Begin here"))
    page.click(button("Step"))
    assert page("page.episode.first.x[0]") == 2.5
    assert "bit for bit" in replayed(page("page.episode.recording()"), tmp_path)


def test_admissible_values_are_shown(browser: Page, tmp_path: Path) -> None:
    """Into a full tank may flow no more than what leaves it, whatever is asked for."""
    page = opened(browser, "watertank", tmp_path)
    page(
        "page.restart(7n, {...Object.fromEntries(page.episode.names.map((n, k) =>"
        " [n, [...page.episode.first.x, ...page.episode.first.p][k]])), l: 5})"
    )
    outflow = page("page.episode.first.p[page.facts.constants.findIndex((c) => c.name === 'q')]")
    assert page("document.querySelector('.input small').textContent") == f"admissible: 0 to {outflow:.5g}"
    page("page.ask(0, 0.6)")
    page.click(button("Step"))
    assert abs(page("page.episode.now.executedInputs[0]") - outflow) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_plays(example: str, browser: Page, tmp_path: Path) -> None:
    """A hundred steps by clicks, by keys and by touches, each episode replayed."""
    assert len(text_of(example).encode()) < LARGEST
    alternative = "document.querySelector('.alternative[aria-disabled=\"false\"]')"
    for how in ("click", "press", "tap"):
        page = opened(browser, example, tmp_path)
        if how == "tap":
            page.looks(390, 844, touch=True)
        taken = 0
        for k in range(100):
            if page("page.episode.over"):
                replayed(page("page.episode.recording()"), tmp_path)
                page(f"page.restart({k}n)")
            before = page(AT)
            if how == "press":
                page.press(str(1 + k % 4))
                page.press("ArrowUp" if k % 2 else "ArrowDown")
                if page(AT) == before:
                    page.press("ArrowRight")
            else:
                act = page.click if how == "click" else page.tap
                act(alternative if page(f"{alternative} !== null") else button("Step"))
                if page(AT) == before:
                    act(button("Step"))
            taken += page(AT) > before
        assert taken == 100
        replayed(page("page.episode.recording()"), tmp_path)
    assert page.said == [] and page.asked == []


def test_a_push_ends_what_can_be_replayed(browser: Page, tmp_path: Path) -> None:
    """What was before it is recorded; the episode goes on."""
    page = opened(browser, "waypoint", tmp_path)
    for _ in range(3):
        page.press("ArrowRight")
    before = page("page.episode.now.x.join()")
    page.click(button("Push the state"))
    assert page("page.episode.now.x.join()") != before and "recording ends" in page(STATUS)
    page.press("ArrowRight")
    recording = page("page.episode.recording()")
    assert page(AT) == 4 and len(json.loads(recording)["steps"]) == 3
    assert "bit for bit" in replayed(recording, tmp_path)


def test_text_of_a_model_is_no_markup(browser: Page, tmp_path: Path) -> None:
    """Nor does it end the elements in which it stands."""
    attack = "</script><img src=x onerror=window.other=1></title><script>window.other=1</script>"
    model = source_of("example:watertank").text.replace('def="level"', f'def="{attack}"')
    model = model.replace("/* Keep", f"/* {attack} Keep").replace('"Water tank"', f'"{attack}"')
    path = tmp_path / "page.html"
    path.write_text(page_of(playable(Source("hostile.kyx", model), {})), encoding="utf-8")
    browser.begin()
    browser.open(path, READY)
    assert browser("typeof other") == "undefined" and browser.said == [] and browser.asked == []
    assert browser("document.querySelectorAll('img, main script').length") == 0
    assert browser("document.querySelector('h1').textContent") == attack == browser("document.title")


def test_where_no_state_can_be_drawn_one_is_written(browser: Page, tmp_path: Path) -> None:
    text = source_of("example:watertank").text.replace("inTank(l)\n    ->", f"inTank(l) & {UNDRAWN}\n    ->")
    made = playable(Source("tank.kyx", text), {})
    assert made.build.sampling is None
    path = tmp_path / "page.html"
    path.write_text(page_of(made), encoding="utf-8")
    browser.begin()
    browser.open(path, READY)
    assert "No admissible initial state" in browser(STATUS) and browser("page.episode.over")
    for name, text in {"l": "1", "goal": "1", "U": "0.5", "q": "0.1"}.items():
        field = f"document.querySelector('[aria-label=\"{name} at the beginning\"]')"
        browser(f"{field}.value = '{text}', {field}.dispatchEvent(new Event('input'))")
    browser.click(button("Begin here"))
    browser.press("ArrowRight")
    assert browser(AT) == 1 and "bit for bit" in replayed(browser("page.episode.recording()"), tmp_path)
