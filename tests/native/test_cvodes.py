"""The CVODES kernel: tolerances, tracks, published events, failures, and what a solver may depend on."""

import random
import shutil
import subprocess
from collections.abc import Callable
from itertools import pairwise
from math import cos, exp, inf, isfinite, isnan, sin
from pathlib import Path
from typing import Any

import pytest
from solver_program import (
    ALWAYS_STIFF,
    AUTO,
    BALL,
    BLOW_UP,
    DECAY,
    DRAIN,
    DUBINS,
    NOT_STIFF,
    NX,
    OSCILLATOR,
    PENDULUM,
    ROBERTSON,
    ROCKET,
    STIFF,
    UNDEFINED,
    Track,
    ask,
    build,
    flow,
    solver,
)

from dl2c.native.errors import CompilerFailed
from dl2c.native.sundials import find_sundials
from dl2c.native.toolchain import find_compiler


@pytest.fixture(scope="module", params=["casadi", "system"])
def program(request: Any, tmp_path_factory: Any) -> Path:
    """The program with either provider of CVODES."""
    try:
        sundials = find_sundials(request.param, find_compiler())
    except CompilerFailed as problem:
        pytest.skip(str(problem))
    output = tmp_path_factory.mktemp(request.param) / "program"
    return build(output, flags=sundials.flags, libraries=sundials.link_flags)


@pytest.fixture(scope="module")
def casadi_program(tmp_path_factory: Any) -> Path:
    return build(tmp_path_factory.mktemp("solver") / "program")


def zero(tracks: tuple[Track, ...], margin: Callable[[Callable[[int], float]], float]) -> float:
    """The first time at which a margin of the state changes its sign, by bisection on the tracks."""

    def value(track: Track, s: float) -> float:
        return margin(lambda k: track.at(k, s))

    for track in tracks:
        low, high = 0.0, 1.0
        before = value(track, low)
        if before * value(track, high) > 0.0:
            continue
        for _ in range(60):
            middle = (low + high) / 2.0
            low, high = (middle, high) if before * value(track, middle) > 0.0 else (low, middle)
        return track.start + low * track.length
    raise AssertionError("no zero")


def test_solutions_keep_to_their_tolerance(program: Path) -> None:
    for stiff in (NOT_STIFF, ALWAYS_STIFF, AUTO):
        for tolerance in (1e-5, 1e-8, 1e-11):
            answer = ask(
                program,
                solver(stiff, tolerance, tolerance / 100),
                flow(DECAY, 2.0, [1.0]),
                flow(OSCILLATOR, 6.0, [1.0, 0.0]),
            )
            decay, oscillator = answer.flows
            assert answer.done == (True, True)
            assert abs(decay[-1].end[0] - exp(-2.0)) < 40 * tolerance
            assert abs(oscillator[-1].end[0] - cos(6.0)) < 200 * tolerance
            assert abs(oscillator[-1].end[1] + sin(6.0)) < 200 * tolerance


def pendulum(time: float) -> tuple[float, float]:
    """x'' = -sin(x) - x'/10 from (1, 0), by Taylor series of order 20 over steps of at most 1/8."""
    x, v = 1.0, 0.0
    steps = int(8 * time) + 1
    for _ in range(steps):
        xs, vs, sines, cosines = [x], [v], [sin(x)], [cos(x)]
        for n in range(20):
            xs.append(vs[n] / (n + 1))
            vs.append((-sines[n] - vs[n] / 10) / (n + 1))
            turn = [(i + 1) * xs[i + 1] for i in range(n + 1)]
            sines.append(sum(cosines[n - i] * turn[i] for i in range(n + 1)) / (n + 1))
            cosines.append(-sum(sines[n - i] * turn[i] for i in range(n + 1)) / (n + 1))
        h = time / steps
        x, v = (sum(c * h**i for i, c in enumerate(series)) for series in (xs, vs))
    return x, v


def test_a_nonlinear_solution_agrees_with_its_taylor_series(program: Path) -> None:
    for stiff, most in ((NOT_STIFF, 50), (ALWAYS_STIFF, 200)):
        answer = ask(program, solver(stiff, 1e-9, 1e-11), flow(PENDULUM, 3.0, [1.0, 0.0]))
        for track in answer.flows[0]:
            for s in (0.3, 1.0):
                x, v = pendulum(track.start + s * track.length)
                assert abs(track.at(0, s) - x) < most * 1e-9
                assert abs(track.at(1, s) - v) < most * 1e-9


def test_tracks_join_and_end_at_the_stop(program: Path) -> None:
    start = [0.3, -0.2, 0.6, 0.8, 1.5, 0.1]
    tracks = ask(program, solver(), flow(DUBINS, 0.3, start)).flows[0]
    assert [c[0] for c in tracks[0].c] == start
    assert tracks[0].start == 0.0
    assert tracks[-1].start + tracks[-1].length == pytest.approx(0.3, rel=1e-15)
    for track, following in pairwise(tracks):
        assert track.end == tuple(c[0] for c in following.c)
        assert track.start + track.length == pytest.approx(following.start, rel=1e-15)
    for track in tracks:
        assert track.degree <= 6
        assert [track.at(k, 1.0) for k in range(NX)] == pytest.approx(track.end, rel=1e-14, abs=1e-15)


def test_variables_that_the_flow_does_not_move_keep_their_bits(program: Path) -> None:
    start = [1.0, 0.1, 1 / 3, -7e99, 5e-324, 0.0]
    for stiff in (NOT_STIFF, ALWAYS_STIFF):
        for track in ask(program, solver(stiff), flow(DECAY, 1.0, start)).flows[0]:
            assert list(track.end[1:]) == start[1:]
            assert not any(any(c[1:]) for c in track.c[1:])


def test_standing_variables_do_not_loosen_the_tolerance(casadi_program: Path) -> None:
    alone, beside = ask(
        casadi_program, solver(), flow(DECAY, 1.0, [1.0]), flow(DECAY, 1.0, [1.0, 5.0, 6.0, 7.0, 8.0, 9.0])
    ).flows
    assert [t.end[0] for t in alone] == [t.end[0] for t in beside]


def test_a_solver_does_not_remember_earlier_flows(program: Path) -> None:
    probe = flow(PENDULUM, 0.7, [1.0, 0.5])
    for stiff in (NOT_STIFF, ALWAYS_STIFF, AUTO):
        fresh = ask(program, solver(stiff), probe)
        used = ask(
            program,
            solver(stiff),
            flow(BLOW_UP, 2.0, [1.0]),
            probe,
            flow(UNDEFINED, 1.0, [1.0]),
            flow(OSCILLATOR, 30.0, [1.0, 0.0]),
            flow(STIFF, 0.02, [1.0, 0.0]),
            probe,
        )
        assert fresh.flows[0] == used.flows[1] == used.flows[-1]


def test_robertson_passes_its_published_roots(program: Path) -> None:
    answer = ask(program, solver(ALWAYS_STIFF, 1e-8, 1e-14), flow(ROBERTSON, 4e8, [1.0, 0.0, 0.0]))
    assert answer.done == (True,)
    assert zero(answer.flows[0], lambda x: x(2) - 0.01) == pytest.approx(0.264019078188, rel=1e-6)
    assert zero(answer.flows[0], lambda x: x(0) - 1e-4) == pytest.approx(2.07954968830e7, rel=1e-5)


def test_a_rocket_is_cut_off_and_turns_where_sundials_says(program: Path) -> None:
    burning = ask(program, solver(NOT_STIFF, 1e-10, 1e-12), flow(ROCKET, 10.0, [0.0, 0.0, 1.0], p=1.0))
    cutoff = zero(burning.flows[0], lambda x: x(0) - 4000.0)
    assert cutoff == pytest.approx(9.999726468544715, abs=1e-7)
    track = next(t for t in burning.flows[0] if t.start + t.length >= cutoff)
    state = [track.at(k, (cutoff - track.start) / track.length) for k in range(3)]
    coasting = ask(program, solver(NOT_STIFF, 1e-10, 1e-12), flow(ROCKET, 10.0, state, p=0.0))
    apex = cutoff + zero(coasting.flows[0], lambda x: x(1))
    assert apex == pytest.approx(16.19115643193773, abs=1e-6)


def test_a_ball_bounces_when_the_reference_says(program: Path) -> None:
    # Reference FMUs: dropped from 1 with g = 9.81, each bounce keeps 0.7 of the speed.
    bounces = (0.4515236409857309, 1.0836567383657542, 1.5261499065317705)
    time, height, speed = 0.0, 1.0, 0.0
    for expected in bounces:
        tracks = ask(program, solver(), flow(BALL, 2.0, [height, speed])).flows[0]
        flight = zero(tracks[1:] if height == 0.0 else tracks, lambda x: x(0))
        speed = 0.7 * (9.81 * flight - speed)
        time, height = time + flight, 0.0
        assert time == pytest.approx(expected, abs=1e-7)


def test_failures_are_reported_and_never_printed(program: Path) -> None:
    for stiff in (NOT_STIFF, ALWAYS_STIFF, AUTO):
        answer = ask(
            program,
            solver(stiff),
            flow(BLOW_UP, 2.0, [1.0]),
            flow(UNDEFINED, 1.0, [1.0]),
            flow(DRAIN, 100.0, [1.0]),
            flow(DECAY, 0.0, [1.0]) if stiff == AUTO else "",
            flow(DECAY, 1.0, [1.0]),
        )
        assert answer.done[:3] == (False, False, False)
        assert answer.done[-1]
        blow_up, undefined, drain = answer.flows[:3]
        assert 0.99 < blow_up[-1].start <= 1.0001
        assert undefined == ()
        assert all(isfinite(v) for t in (*blow_up, *drain) for c in t.c for v in c)


def test_a_stiff_flow_left_to_the_solver_goes_on_with_bdf(program: Path) -> None:
    always, auto = (
        ask(program, solver(stiff), flow(STIFF, 1.0, [1.0, 0.0])) for stiff in (ALWAYS_STIFF, AUTO)
    )
    assert always.done == auto.done == (True,)
    assert len(always.flows[0]) < 400
    assert 500 < len(auto.flows[0]) < 1000
    for answer in (always, auto):
        assert answer.flows[0][-1].end[0] == pytest.approx(1.0 - 1e-5, abs=1e-8)
    for track, following in pairwise(auto.flows[0]):
        assert track.end == tuple(c[0] for c in following.c)


def refusal(program: Path, library: Path) -> str:
    result = subprocess.run((program, library), input="", capture_output=True, text=True, check=False)
    assert result.returncode == 1
    return result.stdout


def test_vector_operations_are_those_of_sundials_to_the_bit(casadi_program: Path) -> None:
    draw = random.Random(5)
    special = (0.0, -0.0, 1.0, -1.0, inf, -inf, 1e308, 5e-324)

    def number() -> float:
        return draw.choice(special) if draw.random() < 0.3 else draw.uniform(-3.0, 3.0)

    def vectors(count: int) -> str:
        return " ".join(number().hex() for _ in range(count * NX))

    commands = ["replaced 0 0"]
    for _ in range(3000):
        a = number()
        b = draw.choice((a, -a, 1.0, -1.0, number(), number()))
        alias = draw.randrange(3)
        commands += [
            f"sum {alias} {a.hex()} {b.hex()} {vectors(2)}",
            f"norm 0 0 {vectors(2)}",
            f"min 0 0 {vectors(1)}",
        ]
        commands += [
            f"{name} {alias % 2} {a.hex()} {vectors(1)}" for name in ("scale", "add", "abs", "inverse")
        ]
    replaced, *results = ask(casadi_program, *commands).numbers
    assert replaced == (0.0, 7.0)
    assert len(results) == 7 * 3000
    for command, values in zip(commands[1:], results, strict=True):
        ours, theirs = (["nan" if isnan(v) else v.hex() for v in part] for part in (values[:NX], values[NX:]))
        assert ours == theirs, command


def test_tracks_from_nordsiecks_array_are_those_of_the_derivatives(
    casadi_program: Path, tmp_path: Path
) -> None:
    """To the bit, at every order; where only a part of the array is known too."""
    draw = random.Random(8)
    commands: list[str] = []
    for stiff in (NOT_STIFF, ALWAYS_STIFF, AUTO):
        commands += [solver(stiff, 1e-9, 1e-11), flow(ROBERTSON, 4.0, [1.0, 0.0, 0.0])]
        for kind in (DECAY, OSCILLATOR, PENDULUM, ROCKET, BALL, DUBINS, BLOW_UP):
            starts = [[draw.choice((0.0, -0.0, draw.uniform(-2, 2))) for _ in range(NX)] for _ in range(8)]
            commands += [flow(kind, draw.uniform(0.01, 3.0), x, -0.0) for x in starts]
    answer = ask(casadi_program, *commands)
    assert {t.degree for tracks in answer.flows for t in tracks} == {1, 2, 3, 4, 5, 6}
    assert answer.text.count("noted 1") == sum(map(len, answer.flows)) > 2000
    for known in (1, 4):
        asked = ask(build(tmp_path / f"program{known}", flags=[f"-DDL2C_NORDSIECK={known}"]), *commands)
        assert asked.text.count("noted 0") > 1000
        assert [part for part in asked.text.splitlines() if not part.startswith("noted")] == [
            part for part in answer.text.splitlines() if not part.startswith("noted")
        ]


def test_a_library_without_cvodes_is_refused_by_name(casadi_program: Path, tmp_path: Path) -> None:
    assert "nowhere.so" in refusal(casadi_program, tmp_path / "nowhere.so")
    empty = tmp_path / "empty.so"
    subprocess.run(("cc", "-shared", "-fPIC", "-x", "c", "/dev/null", "-o", empty), check=True)
    assert "empty.so has no function N_VMake_Serial" in refusal(casadi_program, empty)


CLASHING = ("N_VLinearSum", "N_VScale", "N_VWrmsNorm", "N_VConst", "N_VMake_Serial", "CVodeGetDky", "CVode")


def test_another_sundials_in_the_process_does_not_matter(casadi_program: Path, tmp_path: Path) -> None:
    clash = tmp_path / "clash.so"
    text = "void abort(void);\n" + "".join(f"void {name}(void) {{ abort(); }}\n" for name in CLASHING)
    subprocess.run(
        ("cc", "-shared", "-fPIC", "-w", "-x", "c", "-", "-o", clash), input=text, text=True, check=True
    )
    commands = (solver(AUTO), flow(PENDULUM, 1.0, [1.0, 0.0]), flow(STIFF, 0.1, [1.0, 0.0]))
    alone = ask(casadi_program, *commands)
    assert ask(casadi_program, *commands, LD_PRELOAD=str(clash)).text == alone.text


@pytest.mark.parametrize("command", ["gcc", "clang"])
@pytest.mark.parametrize("provider", ["casadi", "system"])
def test_the_kernel_compiles_without_warnings(command: str, provider: Any, tmp_path: Path) -> None:
    if shutil.which(command) is None:
        pytest.skip(f"{command} is not installed")
    try:
        sundials = find_sundials(provider, find_compiler({"CC": command, "PATH": "/usr/bin:/bin"}))
    except CompilerFailed as problem:
        pytest.skip(str(problem))
    build(tmp_path / "program", command, sundials.flags, sundials.link_flags)


@pytest.mark.slow
def test_sanitizers_find_nothing(casadi_program: Path, tmp_path: Path) -> None:
    checked = build(tmp_path / "checked", flags=("-fsanitize=address,undefined", "-g", "-O1"))
    commands = (
        solver(AUTO),
        flow(PENDULUM, 1.0, [1.0, 0.0]),
        flow(STIFF, 0.1, [1.0, 0.0]),
        flow(BLOW_UP, 2.0, [1.0]),
        flow(DUBINS, 0.3, [0.3, -0.2, 0.6, 0.8, 1.5, 0.1]),
        solver(ALWAYS_STIFF),
        flow(ROBERTSON, 1e3, [1.0, 0.0, 0.0]),
    )
    assert ask(checked, *commands).text == ask(casadi_program, *commands).text


def test_a_short_flow_takes_microseconds(program: Path, capsys: Any) -> None:
    start = [0.3, -0.2, 0.6, 0.8, 1.5, 0.1]
    times: list[float] = []
    for stop in (0.1, 0.5):
        answer = ask(program, solver(), flow(DUBINS, stop, start, command="time", extra="3000"))
        times.append(answer.numbers[0][0])
    with capsys.disabled():
        print(f"\n  {program.parent.name}: {times[0]:.1f} us for 0.1 s, {times[1]:.1f} us for 0.5 s")
    assert times[0] < 1000.0
