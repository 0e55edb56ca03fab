"""Text of docs/paper.md; `run` replaces the fields in braces."""

TEXT = """\
# Reproduction of Yu 2022

To compare this package with C. Yu, Z. Li, D. Yang, H. Liu (Robotics and Autonomous Systems 149,
2022, 103971), table by table, and with other methods. Written by

    pip install -r requirements/bench.txt
    OPENBLAS_NUM_THREADS=1 python -m bench.paper.run --seeds {seeds} --data FOLDER

Every figure is the **worst of {seeds} seeds** (kernel ridge: {kernel_seeds}); *worst joint* is the
largest RMSE of all joints. Times are processor times of a fit of all joints, on {machine}.

- **per_joint** is the paper's formulation, **potential** and **chain** are ours
  ([method.md](method.md)). *With friction* predicts Coulomb friction of every joint as well.
- **linear regression** fits masses and first moments (Eq. (19)) with Pinocchio's regressor.
- **kernel ridge** (scikit-learn, RBF, cross-validated over blocks) uses the rows of that regressor
  as inputs.
- **EFD** is the explicit formula from D-H parameters with errors of up to 5 mm, 5 % of mass and 1
  cm of centres; **Pinocchio** is the nominal URDF. Both without the payload.

## Table 3: the simulated arm of Table 1

J2, J3, J4. 1000 random poses with noise N(0, 0.01 tau), tested on the 200 samples of Eq. (15),
without noise, and on 1000 other poses. The arm is simulated from the URDF, so the error of
Pinocchio is 0.

{table_3}

![Fig. 4: torque of J2 to J4 on Eq. (15), and predictions of two models]({folder}/fig4.svg)

## Eq. (18): is friction negligible?

The paper's real arm is not public. The substitute is a **simulated** iiwa with masses and centres
that differ from its tables by up to 3 % and 5 mm, inertia, Coulomb friction of 0.3 N·m and noise
of 0.3 N·m on every joint. Slow motion compared with torque at rest (the paper reports 0.307 and
0.512 %):

{friction}

![Fig. 8: slow motion in both directions and torque at rest]({folder}/fig8.svg)

## Tables 4 and 8: the "real" arm without payload

J1 to J4. 500 samples of Eq. (17) at 5 Hz, tested on 200 later ones. The nRMSE and the *worst
joint* are relative to the measured torque, with friction and noise. True gravity has an error of
0.42 N·m there; with a smaller error friction is fitted as a function of the pose.
The last two columns are relative to gravity alone, on these poses and over the whole joint range.

{table_4}

![Fig. 9: torque of J1 to J4 later on Eq. (17)]({folder}/fig9.svg)

## Table 5: payloads

RMSE in N·m of the worst joint relative to the measured torque / to gravity alone on these poses /
to gravity alone over the whole joint range. The paper records 500 samples again after each
change; *updated* models use 50 (10 s) and the model without payload.

{table_5}

![Fig. 11: 1.8 kg]({folder}/fig11.svg)

![Fig. 12: 2 kg]({folder}/fig12.svg)

![Fig. 13: 4 kg]({folder}/fig13.svg)

## Real recordings

Public recordings of arms in fast motion (up to 2.2 rad/s), thinned to 25 Hz; two blocks, a quarter
of the time, are held out. *effects* are Coulomb and viscous friction of every joint; inertia is
estimated and not predicted. 100 % is the error of a constant torque. Rows are missing where `add`
refuses the effects. The recordings last 27, 24 and 16 s: these rows show the validity of the band,
not the accuracy of the method.

{recordings}

Sources: UR10 and Panda from unisa-acg/inverse-dynamics-solver, Med 7 from
lbr-stack/dynamic_parameter_identification.
"""
