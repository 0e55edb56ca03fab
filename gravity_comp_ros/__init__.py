"""Sparse gravity models for robot arms, learned from slow motion (Yu 2022)."""

__version__ = '0.1.0'
