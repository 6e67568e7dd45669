"""Functions for your own analyses: exact covariances of linear models, the tables of the standard, images."""
