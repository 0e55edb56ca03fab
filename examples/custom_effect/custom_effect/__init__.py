"""An effect of our own: the drag of a shaft seal."""
