"""Table 2 and Fig 9: jitter, passive and active."""
