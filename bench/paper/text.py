"""Text of docs/paper.md; `run` replaces the fields in braces."""

TEXT = """\
# Reproduction of Yu 2022

To compare this package with C. Yu, Z. Li, D. Yang, H. Liu, *A fast robotic arm gravity
compensation updating approach for industrial application using sparse selection and
reconstruction*, Robotics and Autonomous Systems 149 (2022) 103971, table by table, and with other
methods. The page is written by

    OPENBLAS_NUM_THREADS=1 python -m bench.paper.run --seeds {seeds} --data FOLDER

(`pip install -r requirements/bench.txt` first). Every figure is the **worst of {seeds} seeds**
(kernel methods, which take minutes: {kernel_seeds}); *worst joint* is the largest error of all
joints, not the mean. Times are those of a complete fit of all joints with the choice of
hyper-parameters, on {machine}, with other
work running: compare them with each other, not with the paper's.

- **per_joint** is the paper's formulation, **potential** and **chain** are ours
  ([method.md](method.md)). *With friction* means Coulomb friction of every joint as an effect.
- **linear regression** uses known kinematics and fits masses and first moments (Eq. (19)) with
  Pinocchio's regressor.
- **kernel ridge** and **SVR** (scikit-learn, RBF, cross-validated over blocks) use the rows of
  that regressor (physical) or the joint angles (raw) as inputs; support vectors count as features.
- **EFD** is the explicit formula from D-H parameters with errors of lengths up to 5 mm, of masses
  up to 5 % and of centres up to 1 cm. **Pinocchio** is the nominal URDF. Both are without a fit
  and without the payload.

## Table 3: the simulated arm of Table 1

1000 random poses with noise N(0, 0.01 tau), tested on the 200 samples of Eq. (15), without noise,
and on 1000 other poses within the joint limits. The arm is simulated from the URDF, so the error
of Pinocchio is 0.

{table_3}

![Fig. 4: torque of J2 to J4 on Eq. (15), and predictions of two models]({folder}/fig4.svg)

## Eq. (18): is friction negligible?

The paper's real arm is not public and its D-H Table 6 partly illegible. The substitute is a
**simulated** iiwa with masses and centres that differ from its tables by up to 3 % and 5 mm,
inertia, Coulomb friction of 0.3 N·m and noise of 0.3 N·m on every joint. The table compares slow
motion with torque at rest (the paper reports 0.307 and 0.512 %):

{friction}

![Fig. 8: slow motion in both directions and torque at rest]({folder}/fig8.svg)

## Tables 4 and 8: the "real" arm without payload

500 samples of Eq. (17) at 5 Hz, tested on 200 later ones. The columns J1 to J4 and *RMSE, worst
joint* are relative to the measured torque, with friction and noise. True gravity has an error of
0.42 N·m there; a smaller error means that the model has fitted friction as a function of the pose.
The other columns are errors relative to gravity alone, on the same poses and on 1000 poses over
the whole joint range. J1 has almost no gravity torque, so its nRMSE reflects the noise.

{table_4}

![Fig. 9: torque of J1 to J4 later on Eq. (17)]({folder}/fig9.svg)

## Table 5: payloads

RMSE in N·m of each joint relative to the measured torque; then relative to gravity alone, on these
poses and over the whole joint range. The paper records 500 samples again after each change;
*updated* models use 50 (10 s) and the model of the arm without payload. Mass and position of the
payload are not inputs of the learned models.

{table_5}

![Fig. 11: 1.8 kg]({folder}/fig11.svg)

![Fig. 12: 2 kg]({folder}/fig12.svg)

![Fig. 13: 4 kg]({folder}/fig13.svg)

The numbers of the figures are the paper's.

## The solver

One L1 problem (Eqs. 8-9, J2 of the arm above, 2187 features, 500 samples, lambda
sqrt(2 ln 3^7)); the objective is recomputed from the problem for both. cvxpy requires all columns.

{solvers}

## Real recordings

Public recordings of arms in fast motion (up to 2.2 rad/s), thinned to 25 Hz; two blocks of time,
a quarter of each, are held out with half a second of margin. *effects* are inertia, Coulomb and
viscous friction on every joint; `auto` predicts gravity alone, which fast motion does not allow.
A value of 100 in the last but one column is the error of a constant torque.

{recordings}

Sources: UR10 and Panda from unisa-acg/inverse-dynamics-solver (BSD-3), Med 7 from
lbr-stack/dynamic_parameter_identification (MIT; 16.5 s, of which 6.5 s are at rest). They are not
part of this package. Recordings of 27, 24 and 16 s are short: these rows show the validity of the
reported errors, not the accuracy of the method.
"""
