"""
The ROS 2 node: the only part of the package that imports rclpy.

The way of the data, for a reader who follows it:

- a message: `run` (executor) → `node` → `messages` (faults by name) → `node_core` → `arm`;
- its torque: `feedforward` (bumpless, limits, watchdog) of the model in use (`model_in_use`);
- its sample: the gate of `data.gate` → `epoch` (means, held-out blocks, due fits);
- a fit: `learner` → the process of `jobs` (`checks`), which fits candidates and judges them
  by the checks of `acceptance`, with `hypotheses`;
- an accepted model: `learner` → `model_history` (file, rollback) and `arm`; `watch` compares it
  with new samples, and finds unannounced payloads;
- reports: `checks`, `diagnostics`, `outputs`.
"""
