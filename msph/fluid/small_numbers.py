"""Smallest divisors, which keep quotients finite where their value does not matter."""

# Smallest divisor of sums, products and squared lengths: far below all that occur.
MIN_DIVISOR = 1e-30
# Smallest sum of the weights (-) of a mean over neighbours; the sum is 1 or 3 in bulk.
MIN_WEIGHT = 1e-6
