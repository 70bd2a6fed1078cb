"""The reference semantics: a step of a model in plain Python, which compiled code is tested against."""
