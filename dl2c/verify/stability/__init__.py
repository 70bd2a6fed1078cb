"""Guesses for theorems about the stability of switched systems. They are proved like any other guess."""
