"""The paper: its published numbers, its figures and tables recomputed, its errata, and the identification from it."""
