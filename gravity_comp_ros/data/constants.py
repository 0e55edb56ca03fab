"""Physical and statistical constants."""

# ISO 80000-3, in m/s². Local values are between 9.78 (equator) and 9.83 (poles): without the local
# value, the error of an estimated mass is at most a quarter of a per cent.
STANDARD_GRAVITY = 9.80665
# Half-width of a 95 % interval of a normal distribution, in standard deviations.
HALF_95 = 1.96
# Standard deviation of a normal distribution per median absolute deviation.
MAD = 1.4826
