"""Compare a model with measurements, and judge the recordings themselves."""
