"""Motion samples: slow-motion gate, sample buffer, hold-out, differentiation."""
