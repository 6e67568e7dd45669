"""Fig 10: the internal loop with delay."""
