"""The command `dl2c`, also as `python -m dl2c`: Ctrl-C is one line, while modules are imported too."""

import sys


def main() -> None:
    """Run the command line. Raises `SystemExit`."""
    try:
        from dl2c.cli import main as command

        command()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
