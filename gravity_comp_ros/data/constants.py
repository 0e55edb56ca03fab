"""Physical constants, each in one place."""

# ISO 80000-3, in m/s². Arms stand between 9.78 (equator) and 9.83 (poles): a weighed mass is
# right to a quarter of a per cent without the local value.
STANDARD_GRAVITY = 9.80665
