"""Rewards: distances, sums over predicates, tolerance, undefined values (semantics 5 and 6)."""

from fractions import Fraction

import pytest
from both_forms import Both, theorem

import dl2c

BODY = "t := 0;"

# Distances: the reward of case k, at x = 3 and v = 1, worked out by hand. ----------------------

DISTANCES = [
    ("x < 5", 2),
    ("x <= 5", 2),
    ("x > 5", -2),
    ("x >= 1", 2),
    ("x = 5", -2),
    ("x = 3", 0),
    ("x != 5", 2),
    ("x - v < 2 * v", 0),
    ("2 < 5", 3),  # constants have a distance like all terms
    ("x < 5 & v > 0", 1),  # min(2, 1)
    ("x < 5 & v > 0 & x > 2.5", 0.5),  # min(2, 1, 0.5)
    ("x < 5 & 2 < 2.5", 0.5),
    ("x < 5 | v > 0", 2),  # max(2, 1)
    ("x > 5 | v = 0 | x > 4", -1),  # max(-2, -1, -1)
    ("!(x < 5)", -2),  # x >= 5
    ("!(x = 5)", 2),  # x != 5
    ("!(x != 5)", -2),
    ("!(x < 5 & v > 0)", -1),  # max(-2, -1)
    ("!!(x < 5)", 2),
    ("x < 5 -> v > 4", -2),  # max(-2, -3)
    ("x > 5 -> v > 4", 2),  # max(2, -3)
    ("x < 5 <-> v > 4", -2),  # min(max(-2, -3), max(3, 2))
    ("x < 5 <-> v > 0", 1),  # min(max(-2, 1), max(-1, 2))
    ("x < 5 & true", 2),
    ("near", 2),  # a name: the condition that an annotation of it would stand for
    ("near(x)", 2),
    ("near(x + v)", 1),
    ("box(x, v)", 0.5),
    ("!near(x)", -2),
    ("near(x) & v > 0", 1),
    ("-near(x)", -2),
    ("2 * near(x) + box(x, v)^2", 4.25),
    ("near - x", -1),
    ("min(near(x), box(v, x))", 1.5),
    ("half(x)", 1.5),
    ("-abs(x - 7) * v", -4),
]

CASES = "\n".join(
    f"  /* @stability: reward={{{value}}} */ Bool case{k}(Real a) <-> a = {k};"
    for k, (value, _) in enumerate(DISTANCES)
)
DEFINED = """
  Bool near(Real x) <-> x <= 5;
  Bool box(Real x, Real v) <-> (x <= 3.5 & v <= 4.5);
  Real half(Real x) = x / 2;
"""


@pytest.fixture(scope="module")
def distances() -> Both:
    return Both(theorem(DEFINED + CASES, BODY))


@pytest.mark.parametrize("k", range(len(DISTANCES)), ids=[value for value, _ in DISTANCES])
def test_distance(distances: Both, k: int) -> None:
    assert distances.first(x=3, v=1, a=k).reward == DISTANCES[k][1]


# Sums ----------------------------------------------------------------------------------------

SUMS = """
  /* @safety: reward=1, penalty=-10, shape={x} */
  Bool inside(Real x) <-> x <= 5;
  /* @progress: reward={100 * v}, penalty={-v}, shape=0.25 */
  Bool there(Real x) <-> x >= 5;
  /* @stability: reward=0.5, penalty=-0.125 */
  Bool slow(Real v) <-> v <= 2;
  /* @stability: shape={-energy(x)} */
  Real energy(Real x) = x^2;
  /* @safety: on_failure=continue:failure */
  Bool silent(Real x) <-> x <= 5;
"""


@pytest.mark.parametrize(
    ("x", "v", "wanted", "cost"),
    [
        (5, 1, (1 + 5) + (100 + 0.25) + 0.5 - 25, 0),
        (4, 1, (1 + 4) + (-1 + 0.25) + 0.5 - 16, 0),
        (6, 3, (-10 + 6) + (300 + 0.25) - 0.125 - 36, 2),
    ],
)
def test_the_reward_is_the_sum_over_all_predicates(x: float, v: float, wanted: float, cost: int) -> None:
    """Reward where it holds, penalty where not, shape always; what is not given counts nothing."""
    seen = sums().first(x=x, v=v)
    assert (seen.reward, seen.cost) == (wanted, cost)


def sums() -> Both:
    return Both(theorem(SUMS, BODY))


def test_rewards_are_those_of_the_state_after_the_step() -> None:
    model = Both(theorem("/* @stability: shape={x} */ Real height(Real x) = x;", "x := x + 1;"))
    model.begin(x=3)
    assert [model.step().reward for _ in range(3)] == [4, 5, 6]


# Tolerance -----------------------------------------------------------------------------------

ATOMS = [
    # an atom, and states in which the exact one fails, the relaxed one holds and neither does
    ("x <= 1", 1 + 2e-9, 1 + 4e-9),
    ("x < 1", 1, 1 + 4e-9),
    ("x >= 1", 1 - 2e-9, 1 - 4e-9),
    ("x > 1", 1, 1 - 4e-9),
    ("x = 1", 1 + 2e-9, 1 + 4e-9),
    ("x = 1", 1 - 2e-9, 1 - 4e-9),
    ("!(x < 1)", 1 - 2e-9, 1 - 4e-9),
    ("x < 0 | x > 50 & x <= 60", 60 + 1e-7, 60 + 2e-7),
    ("x <= 0", 0.9e-9, 1.1e-9),
]
WATCHES = "\n".join(
    f"  /* @stability: reward={k + 1}, on_failure=terminate:failure */ Bool p{k}(Real x, Real a) <-> "
    f"(a = {k} -> ({atom}));"
    for k, (atom, _, _) in enumerate(ATOMS)
)


@pytest.fixture(scope="module")
def tolerant() -> Both:
    return Both(theorem(WATCHES, BODY))


@pytest.fixture(scope="module")
def strict() -> Both:
    return Both(theorem(WATCHES, BODY), tolerance=0)


@pytest.mark.parametrize("k", range(len(ATOMS)), ids=[f"{atom} at {good}" for atom, good, _ in ATOMS])
def test_annotated_predicates_hold_within_the_tolerance(tolerant: Both, strict: Both, k: int) -> None:
    """Each atom is relaxed by 1e-9 * (1 + |left| + |right|), for the truth and so for the endings."""
    _, near, far = ATOMS[k]
    assert tolerant.first(x=near, a=k).ending == ("", "none", "")
    assert tolerant.first(x=far, a=k).ending == ("terminated", "failure", f"p{k}")
    assert strict.first(x=near, a=k).ending == ("terminated", "failure", f"p{k}")


UNCHANGED = """
  /* @safety: penalty=-1 */ Bool apart(Real x) <-> x != 1;
  /* @stability: penalty=-2 */ Bool fixed(Real x) <-> (x > 50 | 2 < 2);
  /* @stability: shape={x <= 1} */ Bool any(Real x) <-> x <= 1;
"""


def test_what_tolerance_does_not_change() -> None:
    """`!=`, distances, Q and tests are exact. An atom between numbers is an atom like others."""
    model = Both(theorem(UNCHANGED, "{?x <= 1; t := 1; ++ t := 2;}", "x <= 1"))
    seen = model.first(x=1)
    assert (seen.reward, seen.cost, seen.postcondition) == (-1 + 0, 1, True)
    over = 1 + 2**-30
    model.begin(x=over)
    assert model.env.action_masks().tolist() == [False, True]
    seen = model.step(0)
    assert (seen.state["t"], seen.reward, seen.cost, seen.postcondition) == (2, -(2**-30), 0, False)
    exact = Both(theorem(UNCHANGED, BODY), tolerance=0)
    assert exact.first(x=0).reward == -2 + 1


def test_the_tolerance_may_be_chosen() -> None:
    model = Both(theorem("/* @safety: penalty=-1 */ Bool low(Real x) <-> x <= 1;", BODY), tolerance="0.25")
    assert model.model.tolerance == Fraction(1, 4)
    assert [model.first(x=x).cost for x in (1.9, 2.1)] == [0, 1]  # x <= 1 + (1 + x + 1) / 4 up to 2


# Undefined values ----------------------------------------------------------------------------

UNDEFINED = """
  /* @stability: reward={1 / x}, penalty=-7 */ Bool one(Real v) <-> v <= 1;
  /* @stability: shape={inverse(x, v)} */ Bool inverse(Real x, Real v) <-> (1 / x > v | v > 50);
  /* @stability: shape=4 */ Real four(Real x) = x;
  /* @safety: penalty=-1 */ Bool both(Real x) <-> (1 / x > 0 | !(1 / x > 0));
  /* @stability: on_success=terminate:success */ Bool won(Real a) <-> a > 5;
"""


def test_an_undefined_value_ends_the_episode_and_counts_nothing() -> None:
    model = Both(theorem(UNDEFINED, BODY))
    seen = model.first(x=2, v=0.25)
    assert (seen.reward, seen.ending) == (0.5 + 0.25 + 4, ("", "none", ""))
    seen = model.first(x=0, v=0)
    assert (seen.reward, seen.cost, seen.success) == (4 - 1, 1, False)
    assert seen.ending == ("truncated", "none", "numerical")
    seen = model.first(x=0, v=2)
    assert seen.reward == -7 + 4 - 1, "the penalty has a value, the distance has none"
    assert seen.ending == ("truncated", "none", "numerical")


def test_a_predicate_that_ends_the_episode_goes_before_an_undefined_value() -> None:
    assert Both(theorem(UNDEFINED, BODY)).first(a=6).ending == ("terminated", "success", "won")


def test_an_atom_without_a_value_is_false_and_so_is_its_negation() -> None:
    """At x = 0 neither `1/x > 0` nor `!(1/x > 0)` holds: the cost of `both` above is 1."""
    model = Both(theorem(UNDEFINED, BODY))
    assert [model.first(x=x, v=60).cost for x in (-1, 0, 1)] == [0, 1, 0]


def test_true_and_false_have_no_distance() -> None:
    for value in ("true", "x > 0 | true", "false & x > 0"):
        with pytest.raises(dl2c.CompileError, match="no distance"):
            dl2c.make(theorem(f"/* @stability: shape={{{value}}} */ Bool any(Real x) <-> x > 0;", BODY))
