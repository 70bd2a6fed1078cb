"""What pictures show is what the model says, and any model can be drawn."""

import math
import re
import sys
from collections.abc import Mapping
from subprocess import check_output
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st
from selection import quick_among

import dl2c
from dl2c.configuration import resolve_options
from dl2c.env.opening import source_of
from dl2c.ir.arrays import margins, truths, values
from dl2c.ir.evaluate import Undefined, evaluate, truth
from dl2c.ir.logic import atoms
from dl2c.ir.model import Model
from dl2c.picture import live
from dl2c.picture.figure import Panels, episode_figure, panels_of, pixels
from dl2c.picture.regions import region
from dl2c.picture.thresholds import deadline, thresholds
from dl2c.picture.track import Track, events, symbols_at
from dl2c.pipeline import Compilation
from dl2c.source import Source

pytestmark = pytest.mark.usefixtures("unoptimised")

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")


def lowered(model: str, **options: Any) -> Model:
    return Compilation(source_of(model), resolve_options(options)).unbounded


def track(model: Model, times: list[float], values: Mapping[str, list[float]], end: str = "") -> Track:
    """States with these values; everything else is 1."""
    names = [*(v.name for v in model.variables), *(c.name for c in model.constants)]
    rest = {c.name: float(c.value) for c in model.constants if c.value is not None}
    states = tuple(
        {n: values[n][k] if n in values else rest.get(n, 1.0) for n in names} for k in range(len(times))
    )
    blocked = tuple(k == 1 for k in range(len(times) - 1))
    return Track(tuple(times), states, blocked, "success" if end else "none", end)


@pytest.mark.parametrize(
    "name", quick_among(("waypoint", "static_safety", "pendulum", "bouncing_ball"), ("waypoint", "pendulum"))
)
@settings(max_examples=20)
@given(data=st.data())
def test_arrays_agree_with_the_reference(name: str, data: st.DataObject) -> None:
    """Terms to rounding, the truth of atoms away from their boundary."""
    model = lowered(f"example:{name}")
    numbers = st.floats(-50, 50) | st.sampled_from([0.0, 1.0])
    state = {s: data.draw(numbers) for s in symbols_at(model, track(model, [0.0], {}).states[0])}
    for predicate in model.predicates:
        for atom in atoms(predicate.formula):
            try:
                sides = [float(evaluate(side, state)) for side in (atom.left, atom.right)]
            except Undefined:
                assert not truths(atom, state)
                continue
            found = [float(values(side, state)) for side in (atom.left, atom.right)]
            assert found == pytest.approx(sides, rel=1e-9, abs=1e-9)
            if not math.isclose(*sides, rel_tol=1e-9, abs_tol=1e-9):
                assert bool(truths(atom, state)) == truth(atom, state) == (float(margins(atom, state)) > 0)


def test_plot_chooses_the_panels() -> None:
    assert panels_of(lowered("example:waypoint")) == Panels(("xr", "vr", "ar", "T"), (), ())
    assert panels_of(lowered("example:static_safety")).phases == (("x", "y"),)
    plain = source_of("example:waypoint").text.replace("plot=line, ", "")
    assert panels_of(lowered(plain)).lines[:2] == ("xr", "vr")
    counted = plain.replace('unit="m/s", def="velocity"', 'unit="m/s", plot=hist, def="velocity"')
    assert panels_of(lowered(counted)) == Panels((), ("vr",), ())
    single = plain.replace('unit="m/s", def="velocity"', 'unit="m/s", plot=scatter, def="velocity"')
    assert panels_of(lowered(single)) == Panels(("vr",), (), ())


def test_thresholds_stand_where_conditions_change() -> None:
    tank = lowered("example:watertank")
    seen = track(tank, [0, 1, 2], {"l": [1, 2, 3], "goal": [2.5] * 3})
    found = {(t.text, round(t.value, 9)) for t in thresholds(tank, seen, "l", -0.5, 5.5)}
    near = "abs(l - goal) <= 0.1"
    assert found == {("0 <= l", 0.0), ("l <= m", 5.0), (near, 2.4), (near, 2.6)}


def test_a_threshold_that_moves_is_not_drawn() -> None:
    tank = lowered("example:watertank")
    seen = track(tank, [0, 1, 2], {"l": [1, 2, 3], "goal": [2.5, 2.6, 2.5]})
    assert {t.text for t in thresholds(tank, seen, "l", -0.5, 5.5)} == {"0 <= l", "l <= m"}


def test_a_deadline_is_where_the_clock_runs_out() -> None:
    waypoint = lowered("example:waypoint")
    seen = track(waypoint, [0.0, 0.5, 1.5], {"T": [5.0, 4.5, 3.5]})
    assert deadline(waypoint, seen) == pytest.approx(5.0)
    irregular = track(waypoint, [0.0, 0.5, 1.5], {"T": [5.0, 4.9, 3.5]})
    assert deadline(waypoint, irregular) is None


def test_an_event_is_a_flow_that_ends_early() -> None:
    waypoint = lowered("example:waypoint")
    seen = track(waypoint, [0.0, 0.5, 0.7, 1.2], {"t": [0, 0.5, 0.2, 0.5], "ep": [0.5] * 4})
    assert events(waypoint, seen) == [2]


def test_unsafe_and_impossible_states_are_shaded() -> None:
    acc = lowered("example:acc")
    seen = track(acc, [0.0], {"d": [10.0]})
    found = region(acc, seen, ("d", "v"), (-5.0, 5.0), (-5.0, 5.0))
    columns, rows = np.meshgrid(found.x, found.y)
    assert (found.safe == (columns > 0)).all()
    assert (found.inside == (rows >= 0)).all()


HOSTILE = source_of("example:waypoint").text.replace('"velocity"', r'"$\frac{1 _ <b> %s {0}"')


@pytest.mark.parametrize(
    "model", [HOSTILE, *(f"example:{n}" for n in ("acc", "static_safety", "thermostat"))]
)
@pytest.mark.parametrize("n", [1, 7])
def test_every_picture_can_be_drawn(model: str, n: int) -> None:
    ir = lowered(model)
    changing = {v.name: [math.sin(k + i) for k in range(n)] for i, v in enumerate(ir.variables)}
    tracks = [track(ir, [0.3 * k for k in range(n)], changing, "$end" if n > 1 else "")] * 2
    picture = pixels(episode_figure(ir, tracks))
    assert picture.dtype == np.uint8 and picture.shape[2] == 3 and picture.std() > 5


def test_what_is_overwritten_at_once_is_not_drawn() -> None:
    """The inflow before the first decision holds for no time; a level does."""
    ir = lowered("example:watertank")
    known = {"l": [1.0, 2.0, 3.0], "u": [0.6, 0.1, 0.2]}
    one = track(ir, [0.0, 1.0, 2.0], known)
    level, inflow = (axes.lines[1].get_ydata().tolist() for axes in episode_figure(ir, [one, one]).axes[:2])
    assert level == known["l"] and inflow == [0.1, 0.1, 0.2]
    assert one.values("u").tolist() == known["u"]


UNSHOWN = re.sub(r'unit="m", |/\* @scene.*?\*/', "", source_of("example:watertank").text, flags=re.DOTALL)
"""A model without a scene: its variables are shown over time."""


def test_a_model_without_a_scene_is_shown_over_time(monkeypatch: pytest.MonkeyPatch) -> None:
    env = dl2c.make(UNSHOWN, render_mode="rgb_array")
    assert env.render() is None
    env.reset(seed=1)
    frames: list[Any] = [env.render()]
    env.step([0.3])
    frames.append(env.render())
    assert frames[0].shape == frames[1].shape and (frames[0] != frames[1]).any()
    env.close()
    monkeypatch.setattr("matplotlib.pyplot.pause", lambda seconds: None)
    check_env(dl2c.make(UNSHOWN, render_mode="rgb_array"))


def test_curves_go_on_as_if_they_were_drawn_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few frames are; a curve that was continued has the pixels of one that was not."""
    drawn: list[int] = []
    whole = live.draw
    monkeypatch.setattr(live, "draw", lambda *given: (drawn.append(1), whole(*given)))
    env = dl2c.make(UNSHOWN, render_mode="rgb_array")
    env.reset(seed=1)
    for k in range(40):
        env.step([0.6 * (k % 3 == 0)])
        frame = env.render()
    assert isinstance(frame, np.ndarray) and 2 <= len(drawn) <= 12
    plots = env._screen._view._plots  # pyright: ignore
    axes = plots.figure.axes[0]
    line = axes.lines[-2].get_xydata()
    assert len(line) == 41 and line[-1].tolist() == [40.0, env.state["l"]]
    env.reset(seed=2)
    env.step([0.0])
    again = env.render()
    assert len(drawn) >= 3 and isinstance(again, np.ndarray) and (again != frame).any()
    env.close()


@pytest.mark.parametrize("model", ["example:watertank", UNSHOWN], ids=["scene", "curves"])
def test_rendering_changes_nothing(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("matplotlib.pyplot.pause", lambda seconds: None)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    plain, shown = dl2c.make(model), dl2c.make(model, render_mode="human")
    for env in (plain, shown):
        env.reset(seed=4)
        env.step([0.2])
    saved = shown.save()
    assert plain.state == shown.state
    assert plain.transition(plain.save(), [0.3])[1:3] == shown.transition(saved, [0.3])[1:3]
    assert plain.state == shown.state
    shown.restore(saved)
    assert shown.render() is None
    shown.close()


@pytest.mark.parametrize(
    "model, module, package",
    [(UNSHOWN, "matplotlib", "matplotlib"), ("example:watertank", "pygame", "pygame-ce")],
    ids=["curves", "scene"],
)
def test_what_is_missing_is_named(
    model: str, module: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a window at once, by pixels when they are asked for: Stable-Baselines3 makes all ids with pixels."""
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(gym.error.DependencyNotInstalled, match=f"pip install {package}"):
        dl2c.make(model, render_mode="human")
    env = dl2c.make(model, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    with pytest.raises(gym.error.DependencyNotInstalled, match=f"pip install {package}"):
        env.render()
    env.close()


def test_a_source_without_annotations_has_a_picture() -> None:
    text = 'Theorem "t" ProgramVariables Real x; End. Problem x >= 0 -> [{x := x + 1;}*] x >= 0 End. End.\n'
    ir = Compilation(Source("t", text), resolve_options({})).unbounded
    assert panels_of(ir).lines == ("x",)


def test_commands_import_matplotlib_without_descriptions() -> None:
    """What asks for them itself still gets them; others that import dl2c lose nothing."""
    lines = (
        "from matplotlib import artist",
        "from matplotlib.lines import Line2D",
        "assert ('markersize' in Line2D.set.__doc__) is not is_command()",
        "assert 'markersize' in artist.kwdoc(Line2D)",
    )
    drawing = "import sys, dl2c; from dl2c.interruption import is_command; sys.argv = ['elsewhere']"
    drawing += "; from dl2c.picture.figure import blank; blank().canvas.draw(); " + "; ".join(lines)
    as_command = "import sys; sys.argv, sys.orig_argv = ['-m'], ['python', '-m', 'dl2c']; "
    for before, told in (("", "False"), (as_command, "True")):
        script = f"{before}{drawing}; print(is_command())"
        assert check_output([sys.executable, "-c", script], text=True).strip() == told
