"""Example of a custom effect: the drag of a shaft seal."""
