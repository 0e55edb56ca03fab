"""Robot descriptions: joint axes and joint order of an arm from a URDF."""
