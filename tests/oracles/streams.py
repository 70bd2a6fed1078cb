"""The random stream of an environment (cgen/runtime/rng.h) in Python."""

from collections.abc import Sequence
from dataclasses import dataclass

WORD = 2**64 - 1


def splitmix64(state: int) -> tuple[int, int]:
    """The next state, and a number of it."""
    state = (state + 0x9E3779B97F4A7C15) & WORD
    z = state
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
    return state, z ^ (z >> 31)


def rotated(a: int, k: int) -> int:
    return ((a << k) | (a >> (64 - k))) & WORD


@dataclass
class Stream:
    """xoshiro256++ keyed by a seed and the number of an episode."""

    s: list[int]

    @staticmethod
    def of(seed: int, episode: int) -> "Stream":
        _, key = splitmix64(seed)
        state = key ^ ((episode * 0xD1342543DE82EF95) & WORD)
        words: list[int] = []
        for _ in range(4):
            state, word = splitmix64(state)
            words.append(word)
        return Stream(words)

    def copy(self) -> "Stream":
        return Stream(list(self.s))

    def unit(self) -> float:
        """A multiple of 2^-53 in [0, 1)."""
        s = self.s
        result = (rotated((s[0] + s[3]) & WORD, 23) + s[0]) & WORD
        shifted = (s[1] << 17) & WORD
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= shifted
        s[3] = rotated(s[3], 45)
        return (result >> 11) * 2.0**-53

    def draws(self, layout: Sequence[tuple[str, int]]) -> dict[str, list[float]]:
        """So many numbers for each key."""
        return {key: [self.unit() for _ in range(count)] for key, count in layout}
