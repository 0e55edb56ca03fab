"""
The engine: one linear model, one prior for each term, one criterion.

    tau = Y(x; phi) beta + e,    beta ~ N(0, S),    e: sensor noise and discrepancy

`regress` finds the terms, their coefficients and covariance; `fit`, `diagnose`, `add`, `update`
and `plan` are calls of it.
"""
