"""Export of a gravity model: C source, robot descriptions, payload settings of drives."""
