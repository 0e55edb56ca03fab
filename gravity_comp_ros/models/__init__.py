"""The gravity model, its noise and uncertainty, and its file."""
