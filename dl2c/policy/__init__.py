"""Trained policies as data: what they observe, how they act, and the numbers of their network."""
