"""Check of a robot description against recorded torque: faults, by hypothesis and evidence."""
