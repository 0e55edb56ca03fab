"""Library of physical effects in addition to gravity, and their regressor columns."""
