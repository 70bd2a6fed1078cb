"""The words of dL and its archives, and texts changed by whole words."""

import re
from random import Random

WORDS = """
Real Bool HP HG R B P T F implicit import kyx.math.abs kyx.math.* Definitions ProgramVariables Problem
Functions Variables SharedDefinitions ArchiveEntry Theorem Lemma Exercise Tactic End. true false if else
\\forall \\exists @invariant(x>0) ( ) { } [ ] < > = != <= >= ; , . ' + - * / ^ ++ -- ^@ × := ::= <-> -> <- &
| && || ! ? := *; x y t c f(x) p(x) a; x' (x)' x'=1 {x'=v&x<1} {x:=1;}* [a;] <a;> 0 1 0.5 2^64 1/3 1/0
x^0.5 x_ x_0 z__1 f(||) p(|x|) a{|x|} P{x>0} ._0 • ⎵ __________ abs(x) min(x,y) max(x,y) exp(x) sin(x) pi
old(x) ∀ ∃ ∧ ∨ ¬ → ← ↔ ≤ ≥ ≠ ∪ ∩ ·
/* */ // @var: @const: @safety: @progress: @stability: @episode: @choice: @fallback @invariant( bound=[0:1]
bound=[-inf:inf] role=env name="n" reward={x} penalty=-1 shape={x-1} on_failure=terminate:failure dt=0.1
max_steps=10 observe=false unit="m" plot=line def="d" allow=
"""
DICTIONARY = (*WORDS.split(), " ", "\n", "\\forall x ", " <- ", '"', '"name"', "(a,(b,c))", "?x<=c;")

SLIPS = ("==", "x = 1;", "&&", "and", "then", "while (x > 0) {", "x++;", "1e3", ".5", "5.", "my_var", "**")
"""What people write who know other languages."""

PIECE = re.compile(r'/\*.*?\*/|"[^"\n]*"|[A-Za-z_0-9]+|\s+|::=|:=|<=|>=|<->|->|\+\+|!=|.', re.DOTALL)
BRACKETS = (("(", ")"), ("{", "}"), ("!(", ")"), ("-(", ")"), ("[a;](", ")"))
MAX_CHANGES = 4
MAX_COPIES = 40


def mutated(text: str, rng: Random) -> str:
    """A text with up to `MAX_CHANGES` words changed, dropped or moved, or a part grown deep or long."""
    pieces = PIECE.findall(text) or [""]
    for _ in range(rng.randint(1, MAX_CHANGES)):
        at = rng.randrange(len(pieces))
        span = slice(at, at + rng.choice((1, 1, 2, 5, 20)))
        match rng.randrange(8):
            case 0:
                pieces[at] = rng.choice(DICTIONARY)
            case 1:
                pieces[at:at] = [" ", rng.choice(DICTIONARY), " "]
            case 2:
                pieces[at] = rng.choice(SLIPS)
            case 3:
                pieces[span] = []
            case 4:
                pieces[at:at] = pieces[span] * rng.choice((1, 1, 3, MAX_COPIES))
            case 5:
                other = rng.randrange(len(pieces))
                pieces[at], pieces[other] = pieces[other], pieces[at]
            case 6:
                pieces[span] = rng.choices(pieces, k=span.stop - span.start)
            case _:
                opening, closing = rng.choice(BRACKETS)
                depth = rng.choice((1, 3, MAX_COPIES, 300))
                pieces[span] = [opening * depth, *pieces[span], closing * depth]
        pieces = pieces or [""]
    return "".join(pieces)
