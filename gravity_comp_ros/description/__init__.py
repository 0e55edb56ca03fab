"""Robot descriptions: where a URDF puts the axes of an arm."""
