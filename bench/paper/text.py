"""The words around the tables of docs/paper.md; `run` fills in what stands in braces."""

TEXT = """\
# Yu 2022, side by side

C. Yu, Z. Li, D. Yang, H. Liu, *A fast robotic arm gravity compensation updating approach for
industrial application using sparse selection and reconstruction*, Robotics and Autonomous Systems
149 (2022) 103971: its tables and figures done again, beside what else there is. This page is
written by

    OPENBLAS_NUM_THREADS=1 python -m bench.paper.run --seeds {seeds} --data FOLDER

(`pip install -r requirements/bench.txt` first). Every figure is the **worst of {seeds} seeds**
(kernel methods, which take minutes: {kernel_seeds}); *worst joint* is the joint with the largest
error, not the mean. Times are those of a whole fit of all joints, hyper-parameters and all, on
{machine}, where other work was running: compare them with each other, not with the paper's.

- **per_joint** is the paper's formulation, **potential** and **chain** are ours
  ([model.md](model.md), [chain.md](chain.md)).
- **linear regression** knows the kinematics and fits masses and first moments (Eq. (19)) to
  Pinocchio's regressor.
- **kernel ridge** and **SVR** (scikit-learn, RBF, cross-validated over blocks) work on the rows of
  that regressor (physical) or on the joint angles (raw); their features are support vectors.
- **EFD** is the explicit formula from D-H parameters with lengths off by up to 5 mm, masses by 5 %
  and centres by 1 cm; **Pinocchio** is the URDF as it is. Neither learns, and neither knows a
  payload.

## Table 3: the simulated arm of Table 1

1000 random poses with noise N(0, 0.01 tau), judged on the 200 samples of Eq. (15), without noise,
and on 1000 other poses within the joint limits. There the URDF is the truth by definition.

{table_3}

![Fig. 4: torque of J2 to J4 on Eq. (15), and what two models predict]({folder}/fig4.svg)

## Eq. (18): is friction negligible?

The paper's real arm is not public and its D-H Table 6 partly illegible. In its place stands the
iiwa, **simulated**, with masses and centres off its tables by up to 3 % and 5 mm, inertia, Coulomb
friction of 0.3 N·m and noise of 0.3 N·m on every joint. Slow motion against torque at rest (the
paper has 0.307 and 0.512 %):

{friction}

![Fig. 8: slow motion both ways and torque at rest]({folder}/fig8.svg)

## Tables 4 and 8: the "real" arm without payload

500 samples of Eq. (17) at 5 Hz, judged on 200 later ones: RMSE and nRMSE (Eq. 16) against what the
sensors say, friction and noise in it (true gravity is 0.42 N·m off there; what is less has
learned friction as though it were a pose); then against gravity alone, on the same poses and on
1000 poses over all joint limits. J1 carries next to no gravity, so its nRMSE is one of noise.

{table_4}

![Fig. 9: torque of J1 to J4 later on Eq. (17)]({folder}/fig9.svg)

## Table 5: payloads

RMSE in N·m of each joint against what the sensors say; then against gravity alone on these
poses, and anywhere. The paper takes 500 samples again after each change; *updated* models took 50
(10 s) and knew the arm from before. A learned model is told neither mass nor place of the payload.

{table_5}

![Fig. 11: 1.8 kg]({folder}/fig11.svg)

![Fig. 12: 2 kg]({folder}/fig12.svg)

![Fig. 13: 4 kg]({folder}/fig13.svg)

(The numbers of the figures are the paper's; what each of them shows here is our reading of its
experiments: simulation, friction, no payload, three payloads.)

## The solver

One L1 problem (Eqs. 8-9, J2 of the arm above, 2187 features, 500 samples, lambda
sqrt(2 ln 3^7)); the objective is computed from the problem for both. cvxpy builds all columns, as
it must.

{solvers}

## Real recordings

Public recordings of arms in fast motion (up to 2.2 rad/s), thinned to 25 Hz; two blocks of time,
a quarter of each, are held out with half a second of margin. *effects* are inertia, Coulomb and
viscous friction on every joint, learned with gravity. A value of 100 in the column before last
means that the model is no better than a constant torque.

{recordings}

Sources: UR10 and Panda from unisa-acg/inverse-dynamics-solver (BSD-3), Med 7 from
lbr-stack/dynamic_parameter_identification (MIT; 16.5 s, of which 6.5 s stand still). They are not
part of this package. 27, 24 and 16 s are little: read these rows as a test of honesty, not as
what the method can do.
"""
