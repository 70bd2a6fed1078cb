"""Hybrid games: who decides what, against an enumeration of all plays."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from generators.kyx_builder import lowered, model_text, paths_of
from gymnasium.spaces import Discrete, MultiDiscrete
from oracles.small_games import (
    AGENT,
    OTHER,
    Dual,
    Game,
    Often,
    Pick,
    Play,
    Set,
    State,
    Test,
    holds,
    plays,
    text,
)

import dl2c
from dl2c.diagnostics import CompileError
from dl2c.env.single import Dl2cEnv
from dl2c.ir.printer import print_block

pytestmark = pytest.mark.usefixtures("unoptimised")

# Who decides ------------------------------------------------------------------


def steps_of(program: str, modality: str = "[]") -> str:
    """What a step of a game does, with the roles."""
    model = lowered(f"true -> {modality[0]}{program}{modality[1]} x > 0")
    return " ".join(" ".join(print_block((*model.lead, *model.body))).split())


CHOICE = "0: x := 1; 1: x := 2;"
LOOP = "loop_0 /* env, at most 8 times */"


@pytest.mark.parametrize(
    ("program", "told"),
    [
        ("{x := 1; ++ x := 2;}^@", f"choice_0 /* env */ {CHOICE}"),
        ("{x := 1; -- x := 2;}", f"choice_0 /* env */ {CHOICE}"),
        ("{{x := 1; ++ x := 2;}^@}^@", f"choice_0 /* agent */ {CHOICE}"),
        ("{{x := 1; -- x := 2;}^@}*", f"choice_0 /* agent */ {CHOICE}"),
        ("{{x := 1; -- x := 2;}}*", f"choice_0 /* env */ {CHOICE}"),
        ("{{{x := 1; ++ x := 2;}^@}*}^@", f"choice_0 /* agent */ {CHOICE}"),
        ("{x := 1; ++ x := 2;}×", f"choice_0 /* agent */ {CHOICE}"),
        ("{{x := 1; -- x := 2;}}×", f"choice_0 /* env */ {CHOICE}"),
        ("{x := *;}^@", "x := *; /* assign_x, env */"),
        ("{x := 0; v := *; {v' = 1}}^@", "x := 0; v := *; /* assign_v, env */ flow 0"),
        ("{{?x > 0; {x := 1;}* v := 1;}^@ v := 2;}*", f"?x > 0; {LOOP} x := 1; v := 1; v := 2;"),
        (
            "{{{{x := 1;}^@}* x := 2;}^@ ?x = 1; {{x := 3;}^@}* x := 4;}*",
            f"{LOOP} x := 1; x := 2; ?x = 1; loop_1 /* agent, at most 8 times */ x := 3; x := 4;",
        ),
    ],
)
def test_an_odd_number_of_duals_makes_a_decision_the_other_players(program: str, told: str) -> None:
    for modality in ("[]", "<>"):
        assert steps_of(program, modality).startswith(told)


def test_demonic_choices_are_one_choice_of_the_other_player() -> None:
    assert (
        steps_of("{x := 1; -- x := 2; -- x := 3;}") == "choice_0 /* env */ 0: x := 1; 1: x := 2; 2: x := 3;"
    )


def test_choices_of_two_players_stay_apart() -> None:
    assert steps_of("{x := 1; ++ {x := 2; -- x := 3;}}") == (
        "choice_0 /* agent */ 0: x := 1; 1: choice_1 /* env */ 0: x := 2; 1: x := 3;"
    )


def test_an_annotation_says_who_decides_in_a_game_too() -> None:
    assert "/* agent */" in steps_of("{/* @choice: role=agent */ {x := 1; ++ x := 2;}}^@")
    variables = "/* @var: role=agent */ Real x; Real v;"
    model = lowered("true -> [{{x := *; v := *;}^@}*] x > 0", "", variables)
    assert [s.split("/*")[1] for s in print_block((*model.lead, *model.body))] == [
        " assign_x, agent */",
        " assign_v, env */",
    ]


def test_an_if_of_either_player_is_no_decision() -> None:
    assert "choice" not in steps_of("{if (x > 0) {x := 1;} else {x := 2;}}^@")


def test_box_and_diamond_are_the_same_game_only_with_the_same_players() -> None:
    game = "{x := 1; -- x := 2;}"
    assert lowered(f"true -> [{game}] x > 0 & <{game}> x > 1").lead
    with pytest.raises(CompileError) as refused:
        lowered(f"true -> [{game}] x > 0 & <{{x := 1; ++ x := 2;}}> x > 1")
    (problem,) = refused.value.diagnostics
    assert problem.code == "different-programs"
    assert "-- x := 2;" in str(problem.notes) and "++ x := 2;" in str(problem.notes)


def test_durations_of_the_other_player_are_drawn() -> None:
    paths = paths_of("true -> [{{x' = 1 & x <= 3}^@ {v' = 1 & v <= 2}}*] true")
    assert paths.draws == (("flow_0", 1),)
    options = {"duration": "agent"}
    paths = paths_of("true -> [{{x' = 1 & x <= 3}^@ {v' = 1 & v <= 2}}*] true", options=options)
    assert paths.draws == (("flow_0", 1),) and [i.key for i in paths.inputs] == ["duration_1"]


def test_a_drawn_duration_is_uniform() -> None:
    env = Dl2cEnv(model_text("x = 0 & v = 0 -> [{x := 0; v := 0; {x' = 1, v' = 1 & v <= 4}^@}*] x >= 0"))
    env.reset(seed=3)
    lasted = np.array([env.step(0)[4]["duration"] for _ in range(999)])
    assert 0 < lasted.min() < 0.05 and 3.95 < lasted.max() <= 4
    assert np.abs(np.quantile(lasted, [0.25, 0.5, 0.75]) - [1, 2, 3]).max() < 0.25


def test_deep_masks_do_not_look_beyond_a_drawn_duration() -> None:
    """Whether the test after it is passed is chance."""
    text = model_text(
        "x = 0 & v = 0 -> [{{v := 1; ++ v := 2;} {x := 0; {x' = v & x <= 1}^@ ?v = 2 | x > 2;}}*] x >= 0"
    )
    closed = text.replace("^@", "")
    assert dl2c.make(closed, mask_depth="step").reset(seed=1)[1]["action_mask"].tolist() == [0, 1]
    assert dl2c.make(text, mask_depth="step").reset(seed=1)[1]["action_mask"].tolist() == [1, 1]


# All plays --------------------------------------------------------------------


def other(*sides: Game) -> Dual:
    return Dual(Pick(sides))


def adds(name: str, *numbers: int) -> tuple[Set, ...]:
    return tuple(Set(name, f"{name} + {k}") for k in numbers)


@dataclass(frozen=True)
class Case:
    """A round of a game from a state, and what the agent wants."""

    game: Game
    wish: str
    state: State


CASES = {
    "filibuster": Case(Dual(Dual(other(Set("x", "0"), Set("x", "1")))), "x == 0", {"x": 0}),
    "last word": Case((other(*adds("x", 0, 1)), Pick(adds("x", 0, 1))), "x == 1", {"x": 0}),
    "first word": Case((Pick(adds("x", 0, 1, 2)), other(*adds("x", -1, 1))), "x >= 1", {"x": 0}),
    "legal moves": Case(
        (
            Pick((Set("x", "1"), Set("x", "2"), Set("x", "3"))),
            other(
                (Test("x >= 2"), Set("y", "1")),
                (Test("x <= 2"), Set("y", "2")),
                (Test("x > 3"), Set("y", "3")),
            ),
        ),
        "y == 2",
        {"x": 0, "y": 0},
    ),
    "answer": Case(
        (
            other(Set("y", "-1"), Set("y", "0"), (Test("x > 0"), Set("y", "1"))),
            Pick(((Test("y < 1"), Set("x", "x + y")), (Test("y > -1"), Set("x", "x - y")), Set("x", "7"))),
        ),
        "x >= 0",
        {"x": 0, "y": 0},
    ),
    "how often": Case(
        Pick(((Dual(Often(Set("x", "x + 1"))), Pick((Set("x", "x - 4"), Test("x > 3")))), Set("x", "2"))),
        "x > 2",
        {"x": 0},
    ),
    "how often inside": Case(
        (Pick(adds("x", 1, 2)), other(Set("x", "-x"), Often((Test("x < 4"), Set("x", "x + 2"))))),
        "x >= 4",
        {"x": 0},
    ),
    "my loop": Case(
        other(Set("x", "1"), (Dual(Often((Test("x < 3"), Set("x", "x + 1")))), Set("x", "x * x - 1"))),
        "x > 3",
        {"x": 0},
    ),
    "mine inside theirs": Case(
        Dual(
            Pick((Set("y", "1"), (Test("x == 0"), Dual(Pick((Set("x", "1"), Set("x", "2")))), Set("y", "x"))))
        ),
        "x < 2",
        {"x": 0, "y": 0},
    ),
    "theirs inside mine": Case(
        Pick(
            (
                (other(*adds("x", 1, 2)), Set("y", "x")),
                (other(*adds("x", 3, -4)), other(Test("x > 0"), Set("y", "5"))),
            )
        ),
        "x + y > 1",
        {"x": 0, "y": 0},
    ),
    "a choice in their loop": Case(
        other(
            Set("x", "9"),
            Often((Test("x < 2"), Set("x", "x + 1"), Dual(Pick((Set("y", "y + 1"), Set("y", "y - 1")))))),
        ),
        "y >= 0",
        {"x": 0, "y": 0},
    ),
}


def environment(case: Case) -> Dl2cEnv:
    start = " & ".join(f"{name} = {value}" for name, value in case.state.items())
    wish = case.wish.replace("==", "=")
    program = text(case.game).replace("==", "=")
    names = " ".join(f"Real {name};" for name in case.state)
    return Dl2cEnv(model_text(f"{start} -> <{program}> ({wish})", variables=names))


def actions(env: Dl2cEnv) -> Iterator[list[int]]:
    match env.action_space:
        case Discrete(n=n):
            yield from ([k] for k in range(int(n)))
        case MultiDiscrete(nvec=counts):
            yield from (list(map(int, a)) for a in np.ndindex(*counts))
        case space:
            raise AssertionError(space)


def before_the_agent(play: Play) -> tuple[tuple[str, int], ...]:
    """What the other player decides before the agent decides anything."""
    found: list[tuple[str, int]] = []
    for who, key, k in play.moves:
        if who == AGENT:
            break
        found.append((key, k))
    return tuple(found)


Moves = tuple[tuple[str, int], ...]


def opening(play: Play) -> Moves:
    """What the other player decides before the agent decides anything."""
    first = next((k for k, (who, _, _) in enumerate(play.moves) if who == AGENT), len(play.moves))
    return tuple((key, k) for _, key, k in play.moves[:first])


def follows(play: Play, action: dict[str, int]) -> bool:
    """Whether the agent's decisions of a play are those of an action."""
    return all(action[key] == k for key, k in play.by(AGENT).items())


def mask_of(begun: list[Play], sizes: dict[str, int]) -> list[int]:
    """An alternative is open where some play takes it, and where none meets its decision."""
    met = {key: {p.by(AGENT)[key] for p in begun if key in p.by(AGENT)} for key in sizes}
    return [int(not met[key] or k in met[key]) for key, size in sizes.items() for k in range(size)]


def assert_forced(play: Play, asked: dict[str, int], legal: list[Play]) -> None:
    """After what was decided before it, the first decision that is not the one asked for could not be."""
    n = next(k for k, (who, key, taken) in enumerate(play.moves) if who == AGENT and asked[key] != taken)
    beside = (*play.moves[:n], (AGENT, play.moves[n][1], asked[play.moves[n][1]]))
    assert not any(p.moves[: n + 1] == beside for p in legal)


@pytest.mark.parametrize("name", CASES)
def test_a_round_is_what_the_enumeration_says(name: str) -> None:
    """Every round is a play of the game and every play happens, masks are those after the opening, and
    moves win that win whatever the other player does.
    """
    case = CASES[name]
    env = environment(case)
    legal = plays(case.game, case.state)
    sizes = {d.key: len(d.alternatives) for d in env.manifest.choices}
    seen: dict[tuple[Moves, Moves], set[str]] = {}
    for action in actions(env):
        asked = dict(zip(sizes, action, strict=False))
        for seed in range(80):
            _, info = env.reset(seed=seed)
            mask = info["action_mask"].tolist() if sizes else []
            _, _, terminated, _, info = env.step(action if len(sizes) > 1 else action[0])
            assert terminated
            did = {key: k for key, k in info.get("environment", {}).items() if k >= 0}
            executed = dict(zip(sizes, np.atleast_1d(info["executed_action"]).tolist(), strict=False))
            (play,) = [p for p in legal if p.by(OTHER) == did and follows(p, executed)]
            assert env.state == play.state
            begun = [p for p in legal if opening(p) == opening(play)]
            assert mask == mask_of(begun, sizes)
            assert info["blocked"] == (not follows(play, asked))
            if info["blocked"]:
                assert_forced(play, asked, legal)
            else:
                seen.setdefault((opening(play), tuple(asked.items())), set()).add(str(play))
    assert set().union(*seen.values()) == set(map(str, legal))
    good = {str(p) for p in legal if holds(case.wish, p.state)}
    for (begun, action), happened in seen.items():
        possible = [p for p in legal if opening(p) == begun and follows(p, dict(action))]
        assert happened == set(map(str, possible))
        wins = all(holds(case.wish, p.state) for p in possible)
        assert wins == (happened <= good)


def test_the_cases_have_moves_that_win_and_moves_that_lose() -> None:
    verdicts = {holds(c.wish, p.state) for c in CASES.values() for p in plays(c.game, c.state)}
    assert verdicts == {True, False} and len(CASES) >= 10


# A whole game -----------------------------------------------------------------

NIM = model_text(
    """1 <= n & n <= 10 & won = 0 & lost = 0 -> <{{
        {?n >= 1; n := n - 1; ++ ?n >= 2; n := n - 2; ++ ?n >= 3; n := n - 3;}
        if (n = 0) { won := 1; }
        else {
            {?n >= 1; n := n - 1; -- ?n >= 2; n := n - 2; -- ?n >= 3; n := n - 3;}
            if (n = 0) { lost := 1; }
        }
    }*}> won = 1""",
    "/* @safety: on_failure=terminate:failure */ Bool fair(Real lost) <-> lost = 0;\n"
    "/* @progress: reward=1, on_success=terminate:success */ Bool taken(Real won) <-> won = 1;",
    "/* @var */ Real n, won, lost;",
)


def winning(left: int) -> set[int]:
    """The moves in Nim after which the other player cannot win: who takes the last one does."""
    return {k for k in range(1, min(3, left) + 1) if not winning(left - k)}


def test_winning_moves_of_nim_are_those_of_the_enumeration() -> None:
    """Found from what the environment does alone: moves after which every answer leaves a winning move."""
    env = Dl2cEnv(NIM)
    good: dict[int, set[int]] = {}
    for left in range(1, 11):
        good[left] = set()
        for move in range(1, 4):
            answers: set[tuple[float, str]] = set()
            for seed in range(25):
                _, info = env.reset(seed=seed, options={"state": {"n": left, "won": 0, "lost": 0}})
                assert info["action_mask"].tolist() == [int(k <= left) for k in (1, 2, 3)]
                if move <= left:
                    info = env.step(move - 1)[4]
                    answers.add((env.state["n"], info["status"]))
            if answers and all(s == "success" or (s == "none" and good[int(n)]) for n, s in answers):
                good[left].add(move)
    assert good == {left: winning(left) for left in range(1, 11)}
