"""Scenes show what the model says is where, and cost little."""

import math
import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY
from numpy.typing import NDArray

import dl2c
from dl2c.configuration import resolve_options
from dl2c.env.opening import manifest_of, source_of
from dl2c.ir.scene import FORMS
from dl2c.native.inspect import scene_values
from dl2c.native.manifest import AxisSpec, Manifest, SceneSpec, ShapeSpec
from dl2c.picture.layout import Scale, arranged, size_of
from dl2c.picture.shapes import COLOURS, ROW
from dl2c.pipeline import Compilation
from dl2c.source import Source

EXAMPLES = sorted(path.stem for path in (REPOSITORY / "examples").glob("*.kyx"))
INF = math.inf

WORLD = """
Theorem "Any shape"
Definitions
  /* @const: bound=[1:2], unit="m" */
  Real r;
End.
ProgramVariables
  /* @var: bound=[0:10], unit="m", plot=scatter */
  Real x;
  /* @var: bound=[-5:5], unit="m", plot=scatter */
  Real y;
  Real t;
End.
SCENE
Problem
  x = 5 & y = 0 & r = 2 -> [{ t := 0; {x' = 1, t' = 1 & t <= 1} }*] x >= 0
End.
End.
"""


@pytest.fixture(autouse=True)
def compiled_quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures take their time outside of the model's C."""
    monkeypatch.setenv("CFLAGS", "-O0 -DDL2C_NO_TARGET_CLONES")


def world(scene: str, **changes: str) -> str:
    text = WORLD.replace("SCENE", f"/* @scene: {scene} */" if scene else "")
    for old, new in changes.items():
        text = text.replace(old, new)
    return text


def picture(text: str, steps: int = 0) -> tuple[Any, NDArray[np.uint8]]:
    """The environment, and its picture after some steps."""
    env = dl2c.make(text, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(steps):
        env.step(env.action_space.sample())
    pixels = env.render()
    assert isinstance(pixels, np.ndarray)
    return env, pixels


def panels(env: Any) -> Any:
    return env._screen._view._picture._panels


def share(pixels: NDArray[np.uint8], role: str, at: tuple[int, int], around: int = 0) -> float:
    """How much of a square of pixels has the colour of a role, or one between it and paper."""
    x, y = at
    part = pixels[y - around : y + around + 1, x - around : x + around + 1].reshape(-1, 3).astype(float)
    towards = np.array(COLOURS[role]) - 255.0
    mixed = (part - 255.0) @ towards / (towards @ towards)
    off = np.abs(part - 255.0 - mixed[:, None] * towards).max(axis=1)
    return float(((mixed > 0.1) & (off < 12)).mean())


# What there is --------------------------------------------------------------------


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_say_who_the_agent_is_where_it_goes_and_what_it_avoids(name: str) -> None:
    scene = manifest_of(f"example:{name}", {}).scene
    named = {role: [s.name for s in scene.shapes if s.role == role and s.name] for role in COLOURS}
    assert named["agent"] and named["unsafe"]
    assert named["goal"] or name == "forced_acceleration"  # it does not choose anything
    assert all(math.isfinite(a.low) and math.isfinite(a.high) for a in scene.axes.values())
    assert all(s.panel == FORMS[s.kind].panel for s in scene.shapes)


def test_a_manifest_keeps_its_scene(tmp_path: Path) -> None:
    manifest = manifest_of(world('disk(x, y, radius=r, heading=(1, r)), text(x, name="far")'), {})
    assert manifest.scene == SceneSpec(
        shapes=(
            ShapeSpec(
                "disk", "plane", "world", "", "m", {"x": (0,), "y": (1,), "radius": (2,), "heading": (3, 2)}
            ),
            ShapeSpec("text", "text", "world", "far", "m", {"value": (0,)}),
        ),
        axes={"x": AxisSpec(-2.0, 12.0, "m"), "y": AxisSpec(-7.0, 7.0, "m")},
        shaded=(),
    )
    path = tmp_path / "manifest.json"
    path.write_text(manifest.to_json(), encoding="utf-8")
    assert Manifest.read(path) == manifest


def axes(scene: str, **changes: str) -> dict[str, tuple[float, float, str]]:
    found = manifest_of(world(scene, **changes), {}).scene.axes
    return {name: (a.low, a.high, a.unit) for name, a in found.items()}


def test_axes_reach_as_far_as_bounds_let_shapes_go() -> None:
    assert axes("box(x, y, width=4, height=2)") == {"x": (-2.0, 12.0, "m"), "y": (-6.0, 6.0, "m")}
    assert axes("box(x, 0, width=4, height=2, heading=(1, 1))")["x"] == (-3.0, 13.0, "m")
    assert axes("segment(0, 0, 2 * x, y)") == {"x": (0.0, 20.0, ""), "y": (-5.0, 5.0, "m")}
    assert axes("polygon(0, 0, x, 0, 0, y + r)") == {"x": (0.0, 10.0, "m"), "y": (-4.0, 7.0, "m")}
    assert axes("ray(x, 0, heading=(1, y), length=r)") == {"x": (-2.0, 12.0, "m"), "y": (-2.0, 2.0, "")}
    assert axes("on_line(x, length=-3)") == {"line": (-3.0, 10.0, "m")}
    assert axes("level(x, low=-r, high=12)") == {"level": (-2.0, 12.0, "m")}
    assert axes('pointer(x), text(y, name="y")') == {}
    assert axes("point(x, y)", **{"bound=[0:10], ": ""})["x"] == (-INF, INF, "m")


def shapes(text: str) -> tuple[list[tuple[str, str, str]], tuple[str, ...]]:
    scene = Compilation(Source("t", text), resolve_options({})).lowered.model.scene
    return [(s.kind, s.role, s.name) for s in scene.shapes], scene.shaded


def test_without_an_annotation_pairs_or_positions_are_shown() -> None:
    """Else nothing; a plane is shaded where safety depends on both of its variables."""
    assert shapes(world("")) == ([("point", "agent", "x, y")], ())
    judged = {"Real r;": "Real r;\n/* @safety */ Bool p(Real x, Real y) <-> x >= y;"}
    assert shapes(world("", **judged))[1] == ("x", "y")
    lined = {", plot=scatter": ""}
    assert shapes(world("", **lined)) == ([("on_line", "agent", "x"), ("on_line", "world", "y")], ())
    assert shapes(world("", **lined, **{"{x' = 1": "{t' = 0"}, **{", t' = 1": ""}))[0] == []
    assert shapes(world("", **lined, **{'unit="m"': 'unit="s"'}))[0] == []
    assert shapes(world("point(0, 0)", **judged)) == ([("point", "world", "")], ())


# Where it is ----------------------------------------------------------------------


def scene_of(*axes: str, low: float = 0.0, high: float = 10.0) -> SceneSpec:
    kind = {"x": "point", "line": "on_line", "level": "level"}[axes[0]]
    panel = {"x": "plane"}.get(axes[0], axes[0])
    arguments = {"level": {"value": (0,)}, "line": {"x": (0,)}}.get(axes[0], {"x": (0,), "y": (1,)})
    shape = ShapeSpec(kind, panel, "agent", "", "m", arguments)
    return SceneSpec((shape,), {a: AxisSpec(low, high, "m") for a in axes}, ())


def test_both_axes_of_a_plane_have_the_same_scale() -> None:
    scene = SceneSpec(scene_of("x", "y").shapes, {"x": AxisSpec(0, 30, "m"), "y": AxisSpec(-5, 5, "m")}, ())
    plane = arranged(scene, [0.0, 0.0])["plane"]
    x, y = plane.scales["x"], plane.scales["y"]
    assert x.step == pytest.approx(-y.step)
    assert x.at(0) - x.at(10) == y.at(10) - y.at(0)
    assert plane.left <= x.at(0) < x.at(30) <= plane.left + plane.width
    assert plane.top <= y.at(5) < y.at(-5) <= plane.top + plane.height


@pytest.mark.parametrize(("low", "high"), [(-INF, INF), (-INF, 20.0), (-20.0, INF)])
def test_an_open_axis_is_that_of_the_first_state(low: float, high: float) -> None:
    line = arranged(scene_of("line", low=low, high=high), [7.0])["line"].scales["line"]
    assert line.low < 7.0 < line.high and line.high - line.low < 60
    assert line.low < low or not math.isfinite(low)
    far = arranged(scene_of("line", low=low, high=high), [math.nan])["line"].scales["line"]
    assert math.isfinite(far.low) and far.low < far.high


@pytest.mark.parametrize("ends", [(-1e300, 1e300), (5.0, 5.0), (1e20, 1e20), (-INF, INF)])
@pytest.mark.parametrize("value", [0.0, -3e250, 1e90, 7.0])
def test_any_numbers_have_an_axis(ends: tuple[float, float], value: float) -> None:
    for axis in ("line", "level"):
        scale = arranged(scene_of(axis, low=ends[0], high=ends[1]), [value])[axis].scales[axis]
        assert 0 < scale.high - scale.low < INF and len(list(scale.ticks())) < 20
        assert abs(scale.at(value)) < 10_000


def test_ticks_are_round_numbers_inside_the_axis() -> None:
    for low, high in ((0.0, 1.0), (-20.4, 20.8), (3e-5, 7e-5), (1e6, 3e6), (0.0, 4600.0)):
        ticks = list(Scale(low, high, 0.0, 500 / (high - low)).ticks())
        assert 3 <= len(ticks) <= 9
        assert all(0 <= at <= 500 and low <= float(text) <= high for at, text in ticks)


def test_shapes_are_where_the_state_says() -> None:
    """The agent has moved by one, the goal stays."""
    text = world(
        "disk(x, y, radius=r / 2, role=agent), box(2, 3, width=2, height=1, role=goal),"
        "polygon(8, -4, 9, -4, 9, -3, 8, -3, role=unsafe), segment(1, -3, 4, -3, role=unsafe)"
    )
    env, pixels = picture(text, steps=1)
    plane = panels(env)["plane"]
    at: Callable[[float, float], tuple[int, int]] = lambda x, y: (  # noqa: E731
        plane.scales["x"].at(x),
        plane.scales["y"].at(y),
    )
    assert share(pixels, "agent", at(6, 0), 5) == share(pixels, "agent", at(6.8, 0)) == 1.0
    assert share(pixels, "agent", at(4.7, 0.2)) == 0.0
    assert share(pixels, "goal", at(2, 3), 3) == share(pixels, "goal", at(2.9, 3.4)) == 1.0
    assert share(pixels, "unsafe", at(8.5, -3.5), 3) == share(pixels, "unsafe", at(2, -3)) == 1.0
    assert share(pixels, "unsafe", at(5, -3)) == share(pixels, "goal", at(2, 4)) == 0.0


def test_headings_turn_shapes_and_point_somewhere() -> None:
    env, pixels = picture(
        world(
            "box(5, 0, width=6, height=1, heading=(0, 1), role=agent),"
            "ray(1, 1, heading=(1, 0), length=2, role=goal), ray(1, -4, heading=(1, 0), role=unsafe)"
        )
    )
    plane = panels(env)["plane"]
    x, y = plane.scales["x"].at, plane.scales["y"].at
    assert share(pixels, "agent", (x(5.3), y(-2.5))) == 1.0 and share(pixels, "agent", (x(7), y(0))) == 0.0
    assert share(pixels, "goal", (x(2), y(1))) == 1.0 and share(pixels, "goal", (x(3.5), y(1))) == 0.0
    assert share(pixels, "unsafe", (plane.left + plane.width - 3, y(-4))) == 1.0


def test_lines_levels_and_dials_show_their_numbers() -> None:
    env, pixels = picture(
        world(
            "on_line(x, length=2, role=agent), on_line(8, length=1, role=goal), on_line(1, role=unsafe),"
            "level(x, low=0, high=10, role=agent), level(9, role=unsafe),"
            "pointer(0, role=agent), pointer(2, spread=0.5, role=goal)"
        )
    )
    line, level, dial = (panels(env)[name] for name in ("line", "level", "dial"))
    at, road = line.scales["line"].at, line.top + line.height - 32
    assert share(pixels, "agent", (at(6), road)) == share(pixels, "unsafe", (at(1), road)) == 1.0
    assert share(pixels, "agent", (at(4.5), road)) == 0.0
    middle = level.left + level.width // 2
    assert share(pixels, "agent", (middle, level.scales["level"].at(4.5)), 2) == 1.0
    assert share(pixels, "agent", (middle, level.scales["level"].at(5.5)), 2) == 0.0
    assert share(pixels, "unsafe", (middle, level.scales["level"].at(9))) == 1.0
    x, y = dial.middle
    assert share(pixels, "agent", (x + 40, y), 2) == 1.0 and share(pixels, "agent", (x - 40, y), 2) == 0.0
    assert share(pixels, "goal", (round(x + 40 * math.cos(2.3)), round(y - 40 * math.sin(2.3))), 2) == 1.0


def test_what_has_no_value_is_left_out() -> None:
    env, with_it = picture(world('point(x, y, role=agent), disk(1, 1, radius=1 / y, name="?")'))
    panel = panels(env)["plane"]
    inside = np.s_[panel.top + 30 : panel.top + panel.height, panel.left + 1 : panel.left + panel.width // 4]
    assert len(np.unique(with_it[inside].reshape(-1, 3), axis=0)) <= 3  # paper and its grid


def test_names_do_not_cover_each_other() -> None:
    drawn: list[Any] = []
    env, _ = picture(world(", ".join(f'point(x, y, name="number {k}")' for k in range(4))))
    view = env._screen._view._picture._painter
    surface = env._screen._view._picture._screen
    kept = view._write
    view._write = lambda text, colour: drawn.append(kept(text, colour)) or drawn[-1]
    places: list[Any] = []

    class Paper:
        def __getattr__(self, name: str) -> Any:
            return getattr(surface, name)

        def blit(self, written: Any, where: Any) -> None:
            places.append(where)

    view._labels = [("one", (0, 0, 0), (300, 200))] * 4
    view._kept = []
    view._gfx = type("Nothing", (), {"box": staticmethod(lambda *_: None)})
    view._put_labels(Paper())
    assert len({tuple(p) for p in places}) == 4 and ROW > 0
    assert not any(p.colliderect(q) for k, p in enumerate(places) for q in places[:k])


def test_unsafe_parts_of_a_plane_are_shaded() -> None:
    """Where the other numbers change what is safe, the shade follows."""
    text = re.sub(r"/\* @scene.*?\*/", "", source_of("example:dubins").text, flags=re.DOTALL)
    env, pixels = picture(text)
    plane = panels(env)["plane"]
    x, y = plane.scales["x"].at, plane.scales["y"].at
    assert share(pixels, "unsafe", (x(10.3), y(3)), 1) == 1.0
    assert share(pixels, "unsafe", (x(9), y(9)), 3) == 0.0


def test_motion_is_followed_on_its_curve() -> None:
    """Half a circle in one step, far from the straight way; nothing is drawn on that."""
    text = world(
        "disk(x, y, radius=0.2, role=agent)",
        **{
            "{x' = 1, t' = 1 & t <= 1}": "{x' = -y, y' = x - 2, t' = 1 & t <= 3}",
        },
    )
    env, pixels = picture(text, steps=1)
    plane = panels(env)["plane"]
    at = plane.scales["x"].at, plane.scales["y"].at
    place: Callable[[float], tuple[int, int]] = lambda angle: (  # noqa: E731
        at[0](2 + 3 * math.cos(angle)),
        at[1](3 * math.sin(angle)),
    )
    assert all(share(pixels, "agent", place(angle), 2) > 0 for angle in np.linspace(0.1, 2.2, 30))
    assert share(pixels, "agent", (at[0](2.0), at[1](0.2)), 6) == 0.0


def test_a_picture_says_how_the_episode_goes() -> None:
    frames: list[Any] = []
    env: Any = dl2c.make("example:watertank", render_mode="rgb_array", max_episode_steps=2)
    env.reset(seed=0)
    for _ in range(2):
        frames.append(env.render()[-48:])
        env.step([0.1])
    frames.append(env.render()[-48:])
    assert all((a != b).any() for a, b in pairwise(frames))
    assert env.render().flags.writeable


def test_values_come_from_the_library_alone() -> None:
    """The picture reads nothing but what the generated C says."""
    env, _ = picture(world("disk(2 * x, y, radius=r)"))
    library = env._batch.library
    out = np.empty(library.sizes.nscene)
    scene_values(library, *env._batch.get_state(0), out)
    read: Sequence[float] = env._screen._view._picture._evaluated(*env._batch.get_state(0))
    assert list(read) == out.tolist() == [10.0, 0.0, 2.0]


def test_sizes_fit_films() -> None:
    for name in EXAMPLES:
        width, height = size_of(manifest_of(f"example:{name}", {}).scene)
        assert width % 8 == height % 8 == 0
