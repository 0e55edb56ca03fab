"""From samples to a model: fit, update after a payload change, refit with effects."""
