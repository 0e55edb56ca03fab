"""Sparse sums over the dictionary, solved by ADMM (Yu 2022)."""
