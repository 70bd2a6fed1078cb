"""`python -m dl2c` is the command `dl2c`."""

from dl2c.cli import main

main()
