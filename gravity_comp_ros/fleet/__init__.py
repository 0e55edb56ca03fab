"""Fit and diagnosis of many robots in parallel, on one machine or several."""
