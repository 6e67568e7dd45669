"""Table 1 and Fig 6: the workspace."""
