"""Initial states, drawn uniformly from the set that a precondition describes."""
