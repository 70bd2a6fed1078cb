"""Proofs that a trained policy asks for nothing that its model does not admit."""
