"""Physical effects that a gravity model does not hold: what each looks like in the residual."""
