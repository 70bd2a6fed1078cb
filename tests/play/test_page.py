"""Pages in a real browser: what they show is what happens, by clicks, keys and touches."""

import json
import re
from pathlib import Path

import pytest
from browser import needs_browser
from play.pages import EXAMPLES, found_by, made, needs_zig, page
from typer.testing import CliRunner

from dl2c.cli import app
from dl2c.play.page import MODULES, script

pytestmark = [needs_browser, needs_zig]

LARGEST = 400_000
"""Bytes of a page without a policy."""

FINISH = "page.player.shown = page.episode.now.time; page.draw();"

BY_BUTTONS = """
const enabled = () => [...document.querySelectorAll('.alternative[aria-disabled="false"]')];
let restarts = 0;
for (let k = 0; page.episode.at < 100 && k < 400; k++) {
  if (page.episode.over) { byText("New").click(); restarts += 1; continue; }
  const before = page.episode.at;
  const buttons = enabled();
  if (buttons.length > 0) buttons[k % buttons.length].click();
  if (page.episode.at === before) byText("Step").click();
  if (page.episode.steps.length > 100) break;
}
"""

RECORDED = """
return { at: page.episode.at, restarts, recording: page.episode.recording(), numbers:
  document.getElementById("numbers").textContent, requests: performance.getEntriesByType("resource").length };
"""


def replayed(recording: str, folder: Path) -> str:
    """What `dl2c replay` says of a recording that it accepts."""
    file = folder / "episode.json"
    file.write_text(recording, encoding="utf-8")
    done = CliRunner().invoke(app, ["replay", "-q", str(file)])
    assert done.exit_code == 0, done.output
    return done.output


def test_modules_import_nothing_but_each_other() -> None:
    text = script()
    assert not re.search(r"^(import|export)\b", text, re.MULTILINE) and len(MODULES) == len(set(MODULES))
    declared = re.findall(r"^(?:async )?(?:const|let|function|class) (\w+)", text, re.MULTILINE)
    assert len(declared) == len(set(declared))


def test_an_episode_by_buttons_is_replayed_bit_for_bit(tmp_path: Path) -> None:
    found = found_by(page("waypoint"), BY_BUTTONS + RECORDED, tmp_path / "page")
    assert found["requests"] == 0 and len(page("waypoint").encode()) < LARGEST
    steps = json.loads(found["recording"])["steps"]
    assert len(steps) == found["at"] > 0 and f"step {found['at']}" in found["numbers"]
    assert "bit for bit" in replayed(found["recording"], tmp_path)


def test_keys_drive_and_go_back(tmp_path: Path) -> None:
    """Digits choose, arrows step, go back and move an input; what was after that is forgotten."""
    found = found_by(
        page("pendulum"),
        """
        page.restart(3n);
        for (let k = 0; k < 20; k++) { key(k % 3 ? "ArrowUp" : "ArrowDown"); key("ArrowRight"); }
        const far = page.episode.now.x.join();
        for (let k = 0; k < 5; k++) key("ArrowLeft");
        const back = page.episode.at;
        for (let k = 0; k < 5; k++) key("ArrowRight");
        const others = page.episode.now.x.join() !== far;
        key("5");
        key(" ");
        const running = page.player.running;
        await wait(400);
        key(" ");
        return { back, others, running, at: page.episode.at, kept: page.episode.steps.length,
          recording: page.episode.recording() };
        """,
        tmp_path / "page",
    )
    assert found["back"] == 15 and found["others"] and found["running"]
    assert found["at"] == found["kept"] > 20
    assert "within 1e-12" in replayed(found["recording"], tmp_path)


def test_a_step_that_differs_is_found(tmp_path: Path) -> None:
    found = found_by(page("pendulum"), 'page.restart(3n); key("ArrowRight"); key("ArrowRight");'
                     "return page.episode.recording();", tmp_path / "page")
    content = json.loads(found)
    content["steps"][1]["state"]["w"] *= 1 + 1e-9
    file = tmp_path / "episode.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    done = CliRunner().invoke(app, ["replay", str(file)])
    assert done.exit_code == 1 and "step 2 differs: w is" in done.output


def test_the_test_that_says_no_is_named(tmp_path: Path) -> None:
    """Beyond the beginning of the goal area the robot may not accelerate: the page says which test fails."""
    found = found_by(
        page("waypoint"),
        """
        const masked = () => [...document.querySelectorAll('.alternative[aria-disabled="true"]')];
        page.restart(7n);
        for (let k = 0; k < 60 && !page.episode.over; k++) byText("Step").click();
        const seen = masked().map((b) => b.querySelector("small").textContent);
        const before = page.episode.at;
        masked()[0]?.click();
        return { seen, same: page.episode.at === before, status: document.getElementById("status").textContent,
          broken: [...document.querySelectorAll("mark.broken")].length,
          ran: [...document.querySelectorAll("pre mark.ran")].map((m) => m.textContent) };
        """,
        tmp_path / "page",
    )
    assert found["same"] and found["ran"]
    if found["seen"]:
        assert all("fails by" in text for text in found["seen"])
        assert "fails" in found["status"] and found["broken"] > 0


def test_a_beginning_is_checked_against_the_assumptions(tmp_path: Path) -> None:
    found = found_by(
        page("watertank"),
        """
        page.restart(5n);
        const field = (name) => document.querySelector(`[aria-label="${name} at the beginning"]`);
        const write = (name, text) => { field(name).value = text; field(name).dispatchEvent(new Event("input")); };
        write("l", "5.5");
        const said = document.querySelector("#values p").textContent;
        const refused = byText("Begin here").disabled;
        write("l", "2.5");
        byText("Begin here").click();
        key("ArrowRight");
        return { said, refused, first: page.episode.first.x[0], recording: page.episode.recording() };
        """,
        tmp_path / "page",
    )
    assert found["said"] == "Not an initial state: l <= m fails by 0.5." and found["refused"]
    assert found["first"] == 2.5 and "bit for bit" in replayed(found["recording"], tmp_path)


def test_admissible_values_are_shown(tmp_path: Path) -> None:
    """Of an almost full tank the inflow may be no more than what leaves it."""
    found = found_by(
        page("watertank"),
        """
        const { episode, facts } = page;
        page.restart(5n);
        const state = Object.fromEntries(episode.names.map((n, k) => [n, [...episode.first.x, ...episode.first.p][k]]));
        page.restart(5n, { ...state, l: 5 });
        const said = document.querySelector(".input small").textContent;
        page.ask(0, 0.6);
        key("ArrowRight");
        return { said, q: state.q, executed: episode.now.executedInputs[0] };
        """,
        tmp_path / "page",
    )
    assert found["said"] == f"admissible: 0 to {found['q']:.5g}"
    assert abs(found["executed"] - found["q"]) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_plays(example: str, tmp_path: Path) -> None:
    assert len(page(example).encode()) < LARGEST
    clicked = found_by(page(example), BY_BUTTONS + RECORDED, tmp_path / "buttons", milliseconds=60_000)
    assert clicked["requests"] == 0 and clicked["at"] + clicked["restarts"] > 0
    replayed(clicked["recording"], tmp_path)
    keyed = found_by(
        page(example),
        """
        let restarts = 0;
        for (let k = 0; k < 100; k++) {
          if (page.episode.over) { key("n"); restarts += 1; }
          const before = page.episode.at;
          key(String(1 + (k % 9)));
          key(k % 2 ? "ArrowUp" : "ArrowDown");
          if (page.episode.at === before) key("ArrowRight");
        }
        """
        + RECORDED,
        tmp_path / "keys",
        milliseconds=60_000,
    )
    replayed(keyed["recording"], tmp_path)
    approximate = made(example).approximate
    assert keyed["at"] > 0 or keyed["restarts"] > 0 or approximate
