"""The steps of the loop, each once: what notebook, commands, workbench, node and fleet call."""
