"""Doubts about models that can be executed, and annotations for those that say nothing of learning."""
