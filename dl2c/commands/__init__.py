"""What the commands of `dl2c` have in common: flags, failures, and how a model is described."""
