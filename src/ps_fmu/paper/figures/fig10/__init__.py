"""Fig 10: stability of the loop with delay."""
