"""Many robots, many bags: fit and diagnose a whole folder, on one machine or several."""
