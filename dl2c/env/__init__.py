"""Environments: compiled models behind the interfaces of Gymnasium and Stable-Baselines3."""
