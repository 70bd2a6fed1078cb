"""Gymnasium modules: over the compiled library, and in plain Python."""
