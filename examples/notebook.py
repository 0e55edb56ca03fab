# %% [markdown]
# # Gravity compensation from a notebook
# Every cell runs without a robot and without ROS: `pip install gravity_comp_ros`, then
# open this file in VS Code or Jupyter (jupytext), or run `python examples/notebook.py`.

# %% Data from NumPy arrays: two links with Coulomb friction on the shoulder.
import gravity_comp_ros as gc
import numpy as np

NAMES = ['shoulder', 'elbow']
FRICTION, NOISE = 0.6, 0.05  # N·m


def motion(seed: int, payload: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return one minute of times (M,) in s, positions (M, 2) in rad and torques (M, 2) in N·m."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 60.0, 0.05)
    a, b, c, d = rng.uniform(0.0, 6.0, 4)
    q = np.column_stack([0.5 * np.sin(0.11 * t + a) + 0.1 * np.sin(0.7 * t + b),
                         0.6 * np.sin(0.09 * t + c) + 0.1 * np.sin(0.5 * t + d)])
    speed = np.gradient(q, t, axis=0)
    forearm = (4.0 + payload) * np.sin(q.sum(axis=1))
    tau = np.column_stack([(10.0 + payload) * np.sin(q[:, 0]) + forearm
                           + FRICTION * np.tanh(speed[:, 0] / 0.005), forearm])
    return t, q, tau + rng.normal(scale=NOISE, size=tau.shape)


runs = [motion(seed) for seed in (1, 2, 3)]
data = gc.Recording.from_arrays(q=[q for _, q, _ in runs], tau=[tau for *_, tau in runs],
                                t=[t for t, *_ in runs], names=NAMES)
print(data)

# %% Fit gravity to two runs, and compare on the third.
train, test = data.split(0.2)
model = gc.fit(train)
print(model)
before = gc.compare(model, test)
print(before)

# %% Diagnose: which physical effect is missing?
diagnosis = gc.diagnose(train, model)
print(diagnosis)

# %% Add the effect, and compare on the held-out run.
model = gc.add_effects(model, train, diagnosis.findings)
print(model)
after = gc.compare(model, test)
print(after)

# %% Update after a payload change, from ten seconds of motion.
t, q, tau = motion(4, payload=1.5)
tool = gc.Recording.from_arrays(q[:200], tau[:200], t[:200], names=NAMES)
stale = gc.compare(model, tool)
model = gc.update(model, tool)
print(model)

# %% Predict the gravity torque, and save the model for the node and the commands.
print('gravity torque at q = (0.5, -0.2):', model.predict([0.5, -0.2]).round(2), 'N·m')
model.save('arm.json')
