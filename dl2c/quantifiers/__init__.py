"""Quantifiers over the reals, eliminated by virtual substitution."""
