"""What no command and no FMU needs: exact covariances of linear models, the tables of the standard, images."""
