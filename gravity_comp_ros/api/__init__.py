"""Steps of the calibration loop, as called by notebooks, commands, workbench, node and fleet."""
