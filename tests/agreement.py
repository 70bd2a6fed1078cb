"""A batch against single environments: everything returned must be equal, bit for bit."""

from typing import Any

import numpy as np
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from dl2c.env.single import Dl2cEnv
from dl2c.env.vector import Dl2cVectorEnv


def spelled(infos: dict[str, Any], env: Dl2cVectorEnv) -> dict[str, Any]:
    """Vector infos with codes written out as the single environment does, masked entries None."""
    words: dict[str, Any] = {"status": env.status_names, "reason": env.reason_names}
    result = dict(infos)
    if "final_info" in infos:
        result["final_info"] = spelled(infos["final_info"], env)
    for key in infos.keys() & words.keys():
        named = [words[key][int(v)] if m else None for v, m in zip(infos[key], infos[f"_{key}"], strict=True)]
        result[key] = np.array(named, object)
    return result


def _comparable(value: Any) -> Any:
    """The same with a number in place of NaN, which equals nothing."""
    if isinstance(value, dict):
        return {key: _comparable(part) for key, part in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.nan_to_num(value, nan=-12345.0)
    return value


def assert_batch_equals_singles(
    model: str, mode: AutoresetMode, *, n: int = 4, steps: int = 60, **options: Any
) -> int:
    """Play random actions in both; how many episodes ended."""
    ours = Dl2cVectorEnv(model, n, autoreset_mode=mode, **options)
    theirs = SyncVectorEnv([lambda: Dl2cEnv(model, **options)] * n, autoreset_mode=mode)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    ours.action_space.seed(3)
    first, second = ours.reset(seed=5), theirs.reset(seed=5)
    assert data_equivalence(first[0], second[0], exact=True)
    assert data_equivalence(spelled(first[1], ours), second[1], exact=True)
    ended = 0
    for _ in range(steps):
        actions = ours.action_space.sample()
        mine, others = ours.step(actions), theirs.step(actions)
        for a, b in zip(mine[:4], others[:4], strict=True):
            assert data_equivalence(a, b, exact=True)
        assert data_equivalence(_comparable(spelled(mine[4], ours)), _comparable(others[4]), exact=True)
        ended += int((done := mine[2] | mine[3]).sum())
        if mode == AutoresetMode.DISABLED and done.any():
            pair = [e.reset(options={"reset_mask": done.copy()}) for e in (ours, theirs)]
            assert data_equivalence(pair[0][0], pair[1][0], exact=True)
            assert data_equivalence(spelled(pair[0][1], ours), pair[1][1], exact=True)
    return ended
