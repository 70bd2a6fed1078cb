"""Equalities of a precondition, solved for names that are then computed instead of drawn."""
