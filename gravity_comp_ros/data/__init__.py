"""Samples of motion: the slow-motion gate, the sample buffer, hold-out, differentiation."""
