"""Experiment design: motions that resolve the open findings of earlier recordings."""
