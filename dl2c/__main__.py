"""The command `dl2c`, also as `python -m dl2c`: Ctrl-C is one line, while modules are imported too."""

import gc
import os
import sys

from dl2c.interruption import INTERRUPTED, end_at_once, raise_again

OBJECTS = 300_000
"""New objects between two searches for cycles of garbage, of which compiling makes few; Python's own number,
a few hundred, takes a twentieth of the time of a build.
"""

SOON = "4"
"""How long threads of OpenBLAS, which NumPy starts, look for work before they sleep, as a power of two. With
OpenBLAS's own number each of them takes a tenth of a second when NumPy is imported.
"""


def main() -> None:
    """Run the command line. Raises `SystemExit`."""
    gc.set_threshold(OBJECTS)
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", SOON)
    end_at_once()
    try:
        from dl2c.experiments.commands import main as command

        raise_again()
        command()
    except KeyboardInterrupt:
        end_at_once()
        exec("")  # `python -m` ends by the signal after one in code of a string, but for later such code
        print("interrupted", file=sys.stderr)
        raise SystemExit(INTERRUPTED) from None
    finally:
        end_at_once()
        gc.freeze()  # else Python searches all that is left for garbage when it ends


if __name__ == "__main__":
    main()
