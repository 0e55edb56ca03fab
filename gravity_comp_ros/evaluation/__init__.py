"""Comparison of models with measurements, and quality of recordings."""
