"""The language server: what an editor asks of a model while it is written."""
