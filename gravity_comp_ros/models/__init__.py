"""The gravity model, its noise, and its file."""
